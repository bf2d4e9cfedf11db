"""The robot's clock, as its messages show it: also a simulated one. No I/O."""

from __future__ import annotations

import time
from collections.abc import Callable


class RobotClock:
    """Time of the robot in ns: the newest stamp, and the time since it arrived."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._stamp_ns, self._arrived_s = 0, 0.0

    def note(self, stamp_ns: int) -> None:
        """Note the stamp of a message that has just arrived."""
        self._stamp_ns, self._arrived_s = stamp_ns, self._clock()

    def now_ns(self) -> int:
        """Present time; 0 before the first message."""
        if not self._stamp_ns:
            return 0
        return self._stamp_ns + int((self._clock() - self._arrived_s) * 1e9)
