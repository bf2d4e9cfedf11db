"""Run a gateway on a free port over fake services, for tests of its HTTP clients."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.api_keys import ApiKeys
from helios_gateway.service import Gateway, bind
from helios_gateway.settings import Settings

from tests.gateway_backend import Backend

# Fake services report once, and tests do not wait for the next tick.
QUICK = ("--tick-s", "0.05", "--silent-after-s", "3600", "--teleop-hold-s", "2")


@dataclass
class Served:
    """A running gateway with its fake services."""

    port: int
    backend: Backend
    gateway: Gateway

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"


@contextmanager
def served(*flags: str, port: int = 0, backend: Backend | None = None) -> Iterator[Served]:
    """Run a gateway with these flags; `backend`: fake services that outlive the gateway."""
    hub = MemoryHub()
    if backend is None:
        backend = Backend(hub)
        backend.start()
        backend.alive("gateway", 4199)
    else:
        hub = backend.hub
    listener = bind("127.0.0.1", port)
    settings = Settings.load([*QUICK, *flags])
    gateway = Gateway(
        MemoryBus(hub),
        Health(),
        settings,
        listener,
        ApiKeys(settings.keys),
        lambda name: MemoryBus(hub, name),
    )
    try:
        yield Served(listener.getsockname()[1], backend, gateway)
    finally:
        gateway.close()
