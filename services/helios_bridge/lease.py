"""Lease on the robot: one holder at a time, a token that rises with every grant, and an expiry."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from helios_core.errors import Conflict


class Lease:
    """Thread-safe lease. `first_token` must rise from one start of the bridge to the next."""

    def __init__(
        self, duration_s: float, first_token: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.duration_s = duration_s
        self._clock = clock
        self._lock = threading.Lock()
        self._token, self._holder, self._ends_s = first_token, "", 0.0

    def grant(self, holder: str, take: bool = False) -> int:
        """Grant a new token. Raises Conflict if another holder has the lease, unless `take`."""
        with self._lock:
            if self._held() and self._holder != holder and not take:
                left = self._ends_s - self._clock()
                raise Conflict(
                    f"{self._holder} drives the robot, for {left:.0f} s more unless it goes on; "
                    "wait until it has ended, or set take in the LeaseRequest to end it"
                )
            self._token += 1
            self._holder, self._ends_s = holder, self._clock() + self.duration_s
            return self._token

    def check(self, token: int) -> None:
        """Check and renew the lease. Raises Conflict for an older, missing or expired token."""
        with self._lock:
            if token != self._token:
                holder = self._holder or "nobody"
                raise Conflict(
                    f"lease {token} is not the present one ({holder} has it); ask for a new one"
                )
            if not self._held():
                raise Conflict(
                    f"lease {token} ran out after {self.duration_s:g} s; ask for a new one"
                )
            self._ends_s = self._clock() + self.duration_s

    def renew(self, token: int) -> None:
        """Renew after a long action, unless another holder has taken the lease meanwhile."""
        with self._lock:
            if token == self._token and self._holder:
                self._ends_s = self._clock() + self.duration_s

    def release(self, token: int) -> None:
        """Release the lease; no effect for a token that is not the current one."""
        with self._lock:
            if token == self._token:
                self._holder, self._ends_s = "", 0.0

    def _held(self) -> bool:
        return bool(self._holder) and self._clock() < self._ends_s
