"""Returns of the services that answer keyframes: they have lost those sent meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.topics import status_topic

SERVICES = ("detector", "objectmap", "map2d")


class ServiceReturns:
    """Time of the newest return of a service. Bus threads write it, the task's thread reads it.

    A service returns when its connection is back, or when a new process of it is ready.
    """

    def __init__(self, bus: Bus, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._newest_s = -1e9
        self._known: set[str] = set()  # instances that were alive once
        self._ready: dict[str, str] = {}  # service -> its newest instance that was ready
        self._registrations = [
            bus.watch(self._on_alive),
            *(bus.subscribe(status_topic(service), self._on_status) for service in SERVICES),
        ]

    def since(self, at_s: float) -> bool:
        """True if a service has returned after a time of the clock."""
        with self._lock:
            return self._newest_s > at_s

    def close(self) -> None:
        for registration in self._registrations:
            registration.close()

    def _on_alive(self, service: str, instance: str, alive: bool) -> None:
        if not alive or service not in SERVICES:
            return
        with self._lock:
            if instance in self._known:  # the same process: only its connection was lost
                self._newest_s = self._clock()
            self._known.add(instance)

    def _on_status(self, status: pb.ServiceStatus) -> None:
        if status.state != "ready":
            return
        with self._lock:
            before = self._ready.get(status.service)
            self._ready[status.service] = status.instance
            if before not in (None, status.instance):
                self._newest_s = self._clock()
