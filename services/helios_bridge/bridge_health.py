"""Health of the bridge, reported from several threads."""

from __future__ import annotations

import threading
from typing import get_args

from helios_core.health import STOP_FAILS, Health, HealthState


class BridgeHealth:
    """Health in which driver faults take precedence over all other states. Thread-safe.

    A failing stop precedes all: a stream frame does not prove that the robot stands or can drive.
    """

    def __init__(self, health: Health) -> None:
        self._health = health
        self._lock = threading.Lock()
        self._stop = ""  # fault of the driver's stop, "" for none
        self._faults: dict[str, str] = {}  # method of the driver -> its fault
        self._setup = ""  # what is wrong with the robot's set-up
        # Last state without regard to images and driver faults.
        self._said: tuple[HealthState, str] = health.state
        self._without_image: tuple[HealthState, str] | None = None  # state while no image comes

    def ready(self, note: str = "") -> None:
        self._say("ready", note)

    def waiting(self, reason: str) -> None:
        self._say("waiting", reason)

    def degraded(self, reason: str) -> None:
        self._say("degraded", reason)

    def no_image(self, state: HealthState, reason: str) -> None:
        """Report that no image comes, until `image_came` or another state."""
        with self._lock:
            self._without_image = (state, reason)
            self._tell()

    def image_came(self) -> None:
        """End the report of `no_image`, whichever thread took the image: the state before it
        holds again."""
        with self._lock:
            if self._without_image is not None:
                self._without_image = None
                self._tell()

    def stop_fails(self, reason: str) -> None:
        """Report a failing stop until `stop_works`."""
        with self._lock:
            self._stop = reason
            self._tell()

    def stop_works(self) -> None:
        with self._lock:
            if self._stop:
                self._stop = ""
                self._tell()

    def setup(self, wrong: str) -> None:
        """Report what is wrong with the robot's set-up, beside the state; empty: nothing."""
        with self._lock:
            self._setup = wrong
            self._tell()

    def driver_fails(self, method: str, reason: str) -> None:
        """Report a fault of a driver method until `driver_works` for the same method."""
        with self._lock:
            self._faults.pop(method, None)  # the newest fault is reported
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

    def _say(self, state: HealthState, reason: str) -> None:
        with self._lock:
            self._said, self._without_image = (state, reason), None
            self._tell()

    def _tell(self) -> None:
        self._health.set(STOP_FAILS, float(bool(self._stop) or "stop" in self._faults))
        fault = self._stop or (list(self._faults.values())[-1] if self._faults else "")
        state, reason = ("degraded", fault) if fault else self._without_image or self._said
        if state == "ready":
            reason = "; ".join(filter(None, (reason, self._setup)))
        match state:
            case "ready":
                self._health.ready(reason)
            case "waiting":
                self._health.waiting(reason)
            case "degraded":
                self._health.degraded(reason)
            case "starting":  # no state was said yet, and a fault of the driver may be over
                if self._health.state[0] != "starting":
                    self._health.waiting(reason)
            case "stopping":  # it is the last state, and stays
                pass
            case _:
                known = ", ".join(get_args(HealthState))
                raise ValueError(f"the bridge cannot be {state!r}; say one of {known}")
