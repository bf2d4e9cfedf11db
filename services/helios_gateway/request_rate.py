"""Limit on the requests of each client in a second."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable


class RequestRate:
    """Counts requests by client in each second of a monotonic clock.

    A jump of the wall clock changes nothing. Not thread-safe.
    """

    def __init__(self, most_per_s: int, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._most, self._clock_s = most_per_s, clock_s
        self._second = 0
        self._counts: Counter[str] = Counter()

    def allows(self, client: str) -> bool:
        """Count a request; False if the client has made too many in this second."""
        second = int(self._clock_s())
        if second != self._second:
            self._second, self._counts = second, Counter()
        self._counts[client] += 1
        return self._counts[client] <= self._most
