"""Health of a service: state, reason and metrics."""

from __future__ import annotations

import statistics
import threading
from collections import deque
from typing import Literal, TypeGuard, get_args

# Metric of the bridge: 1 while the robot cannot be stopped, so it must get no task.
STOP_FAILS = "stop_fails"

HealthState = Literal["starting", "waiting", "ready", "degraded", "stopping"]


def is_health_state(text: str) -> TypeGuard[HealthState]:
    """True if the text names a health state."""
    return text in get_args(HealthState)


class Health:
    """Health state and metrics of one service; initially "starting". Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._state: HealthState = "starting"
        self._reason = "starting"
        self._ended = False
        self._counters: dict[str, float] = {}
        self._samples: dict[str, deque[float]] = {}
        self.changed = threading.Event()

    @property
    def state(self) -> tuple[HealthState, str]:
        """(state, reason)"""
        with self._lock:
            return self._state, self._reason

    def ready(self, note: str = "") -> None:
        self._set("ready", note)

    def waiting(self, reason: str) -> None:
        """Set state waiting: not ready, without a fault. `reason` names the missing condition."""
        self._set("waiting", reason)

    def degraded(self, reason: str) -> None:
        """Set state degraded: running with a fault that an operator should repair."""
        self._set("degraded", reason)

    def stopping(self) -> None:
        """Set state stopping, after a request to end. Later state changes are ignored."""
        self._set("stopping", "stopping", last=True)

    def failed(self, reason: str) -> None:
        """Set state degraded: the service ends for this reason. Later changes are ignored."""
        self._set("degraded", reason, last=True)

    def count(self, name: str, by: float = 1) -> None:
        """Increase a counter."""
        with self._lock:
            self._counters[name] = self._counters.get(name, 0) + by

    def set(self, name: str, value: float) -> None:
        """Set a metric to its present value."""
        with self._lock:
            self._counters[name] = value

    def sample(self, name: str, value: float) -> None:
        """Add a sample; `<name>_median` publishes the median of the last 256."""
        with self._lock:
            self._samples.setdefault(name, deque(maxlen=256)).append(value)

    def metrics(self) -> dict[str, float]:
        with self._lock:
            out = dict(self._counters)
            samples = {name: list(values) for name, values in self._samples.items()}
        return out | {f"{n}_median": statistics.median(v) for n, v in samples.items() if v}

    def _set(self, state: HealthState, reason: str, last: bool = False) -> None:
        with self._lock:
            if self._ended:
                return
            self._ended = last
            if (state, reason) == (self._state, self._reason):
                return
            self._state, self._reason = state, reason
        self.changed.set()
