"""What the models are doing: counted, so that they are unloaded when idle and never while they
work, and so that a stream frame is skipped while something else is worked on. Thread-safe."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator


class ModelUsage:
    """One for each set of models."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._working = 0
        self._used_s, self._unloaded = time.monotonic(), False

    @contextlib.contextmanager
    def work(self) -> Iterator[None]:
        """Counts as work while it lasts."""
        with self._lock:
            self._working += 1
        try:
            yield
        finally:
            self._done()

    @contextlib.contextmanager
    def work_if_free(self) -> Iterator[bool]:
        """False, and no work, where something is worked on already."""
        with self._lock:
            free = self._working == 0
            self._working += free
        try:
            yield free
        finally:
            if free:
                self._done()

    def claim_idle(self, after_s: float) -> bool:
        """Whether nothing was asked for that long; True once, until there is work again."""
        with self._lock:
            idle = self._working == 0 and time.monotonic() - self._used_s > after_s
            if not idle or self._unloaded:
                return False
            self._unloaded = True
            return True

    def _done(self) -> None:
        with self._lock:
            self._working -= 1
            self._used_s, self._unloaded = time.monotonic(), False
