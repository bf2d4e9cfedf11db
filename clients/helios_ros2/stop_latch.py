"""The latched stop of the driver."""

from __future__ import annotations

import threading


class NotDone(Exception):
    """Raised when an action could not be completed; one sentence."""


class StopLatch:
    """Latched stop. Thread-safe: `stop` comes from any thread while an action runs."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._reason = ""
        self._cut = threading.Event()  # ends the running action, also if the stop is cleared soon
        self._why = ""

    @property
    def reason(self) -> str:
        """Reason of the stop; empty if not stopped."""
        return self._reason

    def stop(self, reason: str) -> None:
        with self._lock:
            self._reason = self._why = reason or "stop-now"
            self._cut.set()

    def clear(self) -> None:
        with self._lock:
            self._reason = ""

    def begin(self) -> None:
        """Begin an action. Raises NotDone while stopped."""
        with self._lock:
            if self._reason:
                raise NotDone(f"stopped: {self._reason}; clear the stop first")
            self._cut.clear()

    def rest(self, seconds: float) -> None:
        """Wait up to `seconds`. Raises NotDone at once when the robot is stopped."""
        if self._cut.wait(seconds):
            raise NotDone(f"stopped: {self._why}; clear the stop first")

    def check(self) -> None:
        """Raises NotDone if the robot was stopped since `begin`."""
        self.rest(0.0)
