"""Conditions that halt the robot: stop-now, a lost lease, a planner that went away."""

from __future__ import annotations

import threading

from helios_core.errors import Conflict, HeliosError


class Halted(Exception):
    """Raised to end the current action. If `error` is set, the driver raises it instead."""

    def __init__(self, reason: str, error: HeliosError | None = None) -> None:
        super().__init__(reason)
        self.reason, self.error = reason, error


class Halt:
    """Halt state of the robot. Thread-safe. `stop` is latched; `cut` ends only the current action.

    `stop` does both, so the current action ends even if the latch is cleared before its next check.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._set = threading.Event()
        self._stopped = ""
        self._cut: Halted | None = None
        self._acting = False

    @property
    def stopped(self) -> str:
        """Reason of the latched stop-now; empty if not latched."""
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
        """End the current action; True if there is one."""
        with self._lock:
            if self._acting and self._cut is None:
                self._cut = Halted(reason, error)
                self._set.set()
            return self._acting

    def begin(self) -> None:
        """Begin an action. Raises Conflict while stop-now is latched."""
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
        """Raises Halted if the action was cut or stop-now is latched."""
        with self._lock:
            if self._cut is not None:  # checked first, as it may carry the error
                raise self._cut
            if self._stopped:
                raise Halted(self._stopped)

    def rest(self, seconds: float) -> None:
        """Wait up to `seconds`. Raises Halted at once when a halt condition occurs."""
        self._set.wait(seconds)
        self.check()
