"""A backend and a client for every test."""

from collections.abc import Iterator

import pytest
from fastapi.testclient import TestClient
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.app import create_app
from helios_gateway.fleet import Fleet, Served
from helios_gateway.live import Live
from helios_gateway.settings import Settings

from tests.gateway_backend import Backend

PATIENT = Settings.load(["--silent-after-s", "3600"])  # made-up services report once


@pytest.fixture
def hub() -> MemoryHub:
    return MemoryHub()


@pytest.fixture
def backend(hub: MemoryHub) -> Backend:
    """Every service but the gateway, up and answering."""
    backend = Backend(hub)
    backend.start()
    return backend


@pytest.fixture
def live(hub: MemoryHub) -> Iterator[Live]:
    """Without its ticker: tests call `tick`."""
    live = Live(MemoryBus(hub), PATIENT)
    yield live
    live.close()


@pytest.fixture
def client(hub: MemoryHub, live: Live) -> Iterator[TestClient]:
    app = create_app(Fleet({"robot": Served(MemoryBus(hub), live)}), PATIENT)
    with TestClient(app, "http://localhost", raise_server_exceptions=False) as client:
        yield client
