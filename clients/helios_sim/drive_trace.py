"""True positions of the base during its newest drives, and the pace of the physics.

The stamps are those of the system's monotonic clock, which all processes of one machine share.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

NEWEST = 50_000  # physics steps kept


class DriveTrace:
    """Records each physics step of a drive. Thread-safe for readers.

    `begun` and `actions` count the actions that have begun and ended.
    """

    def __init__(
        self,
        pace: float = 0.0,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """pace: simulated seconds per second of a drive; 0 for as fast as possible."""
        self._pace, self._clock_ns, self._sleep = pace, clock_ns, sleep
        self._lock = threading.Lock()
        self._steps: deque[tuple[int, float, float]] = deque(maxlen=NEWEST)
        self._began_ns, self._began_s = 0, 0.0
        self.begun = self.actions = 0

    def begin(self, simulated_s: float, x_m: float, y_m: float) -> None:
        """Note the start of a drive, at this time of the physics."""
        self._began_ns, self._began_s = self._clock_ns(), simulated_s
        self._note(x_m, y_m)

    def step(self, simulated_s: float, x_m: float, y_m: float) -> None:
        """Note a physics step, and wait until its time has come."""
        if self._pace > 0:
            due_ns = self._began_ns + round((simulated_s - self._began_s) / self._pace * 1e9)
            if (ahead_ns := due_ns - self._clock_ns()) > 0:
                self._sleep(ahead_ns / 1e9)
        self._note(x_m, y_m)

    def since(self, stamp_ns: int) -> NDArray[np.float64]:
        """Steps [n, 3] after a stamp: seconds after it, x and y in metres, in the true world."""
        with self._lock:
            newer = [((t - stamp_ns) / 1e9, x, y) for t, x, y in self._steps if t > stamp_ns]
        return np.array(newer, dtype=np.float64).reshape(-1, 3)

    def _note(self, x_m: float, y_m: float) -> None:
        with self._lock:
            self._steps.append((self._clock_ns(), x_m, y_m))
