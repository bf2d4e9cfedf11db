"""Who may drive: one holder, a token that rises with every grant, an end unless renewed."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from helios_core.errors import Conflict


class Lease:
    """Thread-safe. `first_token` must rise from one start of the bridge to the next."""

    def __init__(
        self, duration_s: float, first_token: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.duration_s = duration_s
        self._clock = clock
        self._lock = threading.Lock()
        self._token, self._holder, self._ends_s = first_token, "", 0.0

    def grant(self, holder: str, take: bool = False) -> int:
        """A new token. Raises Conflict while somebody else holds it, unless `take`."""
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
        """Renews it. Raises Conflict for an older token, none, or one that has run out."""
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
        """After a long action: its driver keeps the lease, if nobody has taken it meanwhile."""
        with self._lock:
            if token == self._token and self._holder:
                self._ends_s = self._clock() + self.duration_s

    def release(self, token: int) -> None:
        """Give it back; without effect for a token that is not the present one."""
        with self._lock:
            if token == self._token:
                self._holder, self._ends_s = "", 0.0

    def _held(self) -> bool:
        return bool(self._holder) and self._clock() < self._ends_s
