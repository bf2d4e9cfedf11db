"""What holds a task back: a pause that somebody asked for, a limit of time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from helios_planner.task import TaskCancelled, TimeIsUp


class Hold:
    """Of one running task. Thread-safe: asked by its worker, set from anywhere."""

    def __init__(self, limit_s: float, ends_s: float, cancelled: threading.Event) -> None:
        """limit_s: as it was asked for, 0 for none; ends_s: when it is over, seconds since 1970."""
        self._limit_s, self._ends_s, self._cancelled = limit_s, ends_s, cancelled
        self._go = threading.Event()
        self._go.set()
        self._turn = threading.Lock()  # orders pauses and the beginnings of actions

    def pause(self) -> None:
        """When this returns, no action is begun until `resume`; one that was begun goes on."""
        with self._turn:
            self._go.clear()

    def resume(self) -> None:
        with self._turn:
            self._go.set()

    @property
    def paused(self) -> bool:
        return not self._go.is_set()

    def begin(self, start: Callable[[], bool]) -> bool | None:
        """What `start` returns, which is called unless paused; None where paused. A pause that is
        asked for meanwhile waits until `start` has returned."""
        with self._turn:
            return None if self.paused else start()

    def check(self) -> None:
        """Raises TimeIsUp when the task's time is over; its cause is that of the step budget."""
        if self._limit_s and time.time() > self._ends_s:
            raise TimeIsUp(f"the task's {self._limit_s:g} s are used up")

    def wait(self, tell: Callable[[bool], None]) -> None:
        """While paused: tell so, and wait. Raises TaskCancelled and TaskFailed."""
        if not self.paused:
            return
        tell(True)
        while not self._go.wait(0.1):
            self._check_all()
        tell(False)

    def rest(self, seconds: float) -> None:
        """Wait so long. Raises TaskCancelled and TaskFailed."""
        self._cancelled.wait(seconds)
        self._check_all()

    def _check_all(self) -> None:
        if self._cancelled.is_set():
            raise TaskCancelled
        self.check()
