"""Why the robot must not move: stop-now, a lost lease, a planner that went away."""

from __future__ import annotations

import threading

from helios_core.errors import Conflict, HeliosError


class Halted(Exception):
    """An action has to end. `error` is set when it is somebody's fault, and then raised."""

    def __init__(self, reason: str, error: HeliosError | None = None) -> None:
        super().__init__(reason)
        self.reason, self.error = reason, error


class Halt:
    """Thread-safe. A stop is latched; what cuts an action short counts for that action only.

    A stop does both: the action that runs ends even if the latch is cleared before it has noticed.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._set = threading.Event()
        self._stopped = ""
        self._cut: Halted | None = None
        self._acting = False

    @property
    def stopped(self) -> str:
        """Why stop-now is latched; empty if it is not."""
        return self._stopped

    def stop(self, reason: str) -> None:
        with self._lock:
            self._stopped = reason
            if self._acting and self._cut is None:
                self._cut = Halted(reason)
            self._set.set()

    def clear(self) -> None:
        with self._lock:
            self._stopped = ""
            if self._cut is None:
                self._set.clear()

    def cut(self, reason: str, error: HeliosError | None = None) -> bool:
        """End the action that runs, if one does; whether one did."""
        with self._lock:
            if self._acting and self._cut is None:
                self._cut = Halted(reason, error)
                self._set.set()
            return self._acting

    def begin(self) -> None:
        """An action begins. Raises Conflict while stop-now is latched."""
        with self._lock:
            if self._stopped:
                raise Conflict(f"the robot is stopped ({self._stopped}); clear the stop first")
            self._acting, self._cut = True, None
            self._set.clear()

    def end(self) -> None:
        with self._lock:
            self._acting, self._cut = False, None
            if not self._stopped:
                self._set.clear()

    def check(self) -> None:
        """Raises Halted when there is a reason to."""
        with self._lock:
            if self._cut is not None:  # it may hold the error, which says more
                raise self._cut
            if self._stopped:
                raise Halted(self._stopped)

    def rest(self, seconds: float) -> None:
        """Wait; a reason to halt ends it, and is raised."""
        self._set.wait(seconds)
        self.check()
