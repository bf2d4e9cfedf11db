"""The bridge's health, of which several threads speak."""

from __future__ import annotations

import threading

from helios_core.health import Health


class BridgeHealth:
    """As Health, but what is wrong with the driver outweighs all that is said meanwhile, its stop
    most of all: a frame of the stream is no sign that the robot stands, or that it can drive.
    Thread-safe."""

    def __init__(self, health: Health) -> None:
        self._health = health
        self._lock = threading.Lock()
        self._stop = ""  # what is wrong with it
        self._faults: dict[str, str] = {}  # method of the driver -> what is wrong with it
        self._said = health.state  # last, of everything else

    def ready(self, note: str = "") -> None:
        self._say("ready", note)

    def waiting(self, reason: str) -> None:
        self._say("waiting", reason)

    def degraded(self, reason: str) -> None:
        self._say("degraded", reason)

    def stop_fails(self, reason: str) -> None:
        """Until `stop_works`."""
        with self._lock:
            self._stop = reason
            self._tell()

    def stop_works(self) -> None:
        with self._lock:
            if self._stop:
                self._stop = ""
                self._tell()

    def driver_fails(self, method: str, reason: str) -> None:
        """Until `driver_works` for the same method."""
        with self._lock:
            self._faults.pop(method, None)  # the newest is said
            self._faults[method] = reason
            self._tell()

    def driver_works(self, method: str) -> None:
        with self._lock:
            if self._faults.pop(method, None) is not None:
                self._tell()

    def count(self, name: str) -> None:
        self._health.count(name)

    def sample(self, name: str, value: float) -> None:
        self._health.sample(name, value)

    def _say(self, state: str, reason: str) -> None:
        with self._lock:
            self._said = (state, reason)
            self._tell()

    def _tell(self) -> None:
        fault = self._stop or (list(self._faults.values())[-1] if self._faults else "")
        state, reason = ("degraded", fault) if fault else self._said
        {"waiting": self._health.waiting, "degraded": self._health.degraded}.get(
            state, self._health.ready
        )(reason)
