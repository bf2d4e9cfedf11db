"""What a service says of itself: its state, the reason, its figures."""

from __future__ import annotations

import statistics
import threading
from collections import deque
from typing import Literal, TypeGuard, get_args

HealthState = Literal["starting", "waiting", "ready", "degraded", "stopping"]


def is_health_state(text: str) -> TypeGuard[HealthState]:
    """Whether a text is a state that a service may say of itself."""
    return text in get_args(HealthState)


class Health:
    """Thread-safe. Begins as starting."""

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
        """Not ready, through no fault: says for what it waits."""
        self._set("waiting", reason)

    def degraded(self, reason: str) -> None:
        """Running, but something is wrong that a person should mend."""
        self._set("degraded", reason)

    def stopping(self) -> None:
        """It was asked to end; nothing that is said later changes that."""
        self._set("stopping", "stopping", last=True)

    def failed(self, reason: str) -> None:
        """It ends because of this; nothing that is said later changes that."""
        self._set("degraded", reason, last=True)

    def count(self, name: str, by: float = 1) -> None:
        """Raise a counter."""
        with self._lock:
            self._counters[name] = self._counters.get(name, 0) + by

    def set(self, name: str, value: float) -> None:
        """A figure as it is now."""
        with self._lock:
            self._counters[name] = value

    def sample(self, name: str, value: float) -> None:
        """A figure of which the median over the last 256 is published as `<name>_median`."""
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
