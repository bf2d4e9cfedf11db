"""Rate limit for warnings that may repeat many times a second; it counts the suppressed ones."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Hashable

EVERY_S = 30.0
MOST_KINDS = 64  # most kinds in memory; at the limit all are cleared and logged anew


class LogRateLimit:
    """Rate limiter of one logger's warnings. Thread-safe."""

    def __init__(
        self,
        log: logging.Logger,
        every_s: float = EVERY_S,
        clock: Callable[[], float] | None = None,
    ) -> None:
        self._log, self._every_s, self._clock = log, every_s, clock or time.monotonic
        self._lock = threading.Lock()
        self._logged: dict[Hashable, tuple[float, int]] = {}  # kind -> (logged at, suppressed)

    def warn(self, kind: Hashable, message: str, error: BaseException | None = None) -> None:
        """Log the message with the traceback of `error`: the first of each kind, then one per
        `every_s`."""
        now_s = self._clock()
        with self._lock:
            logged_s, since = self._logged.get(kind, (None, 0))
            due = logged_s is None or now_s - logged_s >= self._every_s
            if len(self._logged) >= MOST_KINDS:
                self._logged.clear()
            self._logged[kind] = (now_s, 0) if due else (logged_s or now_s, since + 1)
        if due:
            more = f" (and {since} times since it was last said)" if since else ""
            self._log.warning("%s%s", message, more, exc_info=error)
