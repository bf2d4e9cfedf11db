"""Usage counter of the models. Idle models are unloaded, working ones never; a stream frame is
skipped while other work runs. Thread-safe."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator


class ModelUsage:
    """Usage counter of one set of models."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._working = 0
        self._used_s, self._unloaded = time.monotonic(), False

    @contextlib.contextmanager
    def work(self) -> Iterator[None]:
        """Count the block as work."""
        with self._lock:
            self._working += 1
        try:
            yield
        finally:
            self._done()

    @contextlib.contextmanager
    def work_if_free(self) -> Iterator[bool]:
        """Count the block as work if no other work runs; else yield False."""
        with self._lock:
            free = self._working == 0
            self._working += free
        try:
            yield free
        finally:
            if free:
                self._done()

    def claim_idle(self, after_s: float) -> bool:
        """True once after `after_s` seconds without work, then False until work runs again."""
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
