"""A time in which no task is begun, since somebody replaces what tasks rely on."""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Callable

from helios_core.errors import Conflict, InvalidInput

LONGEST_S = 600.0
LONGEST_WHY = 200


class Reservation:
    """At most one, which ends by itself. For use under the lock of the planner's queue."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._token, self._why, self._ends_s = "", "", 0.0

    @property
    def why(self) -> str:
        """What tasks wait for now; empty for nothing."""
        return self._why if self._token and self._clock() < self._ends_s else ""

    def begin(self, why: str, for_s: float) -> str:
        """Its token. Raises InvalidInput, and Conflict while there is another one."""
        if not (math.isfinite(for_s) and 0 < for_s <= LONGEST_S):
            raise InvalidInput(f"for_s is {for_s}; wanted more than 0 and at most {LONGEST_S:g} s")
        if not 0 < len(why) <= LONGEST_WHY:
            raise InvalidInput(f"why has {len(why)} letters; wanted 1 to {LONGEST_WHY}")
        if self.why:
            raise Conflict(f"{self.why} at this moment; try again when that is over")
        self._token, self._why = uuid.uuid4().hex, why
        self._ends_s = self._clock() + for_s
        return self._token

    def end(self, token: str) -> None:
        """Without effect for one that is over."""
        if token == self._token:
            self._token = ""
