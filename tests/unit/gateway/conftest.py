"""Makes the helpers beside the tests importable; a backend and a client for every test."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.app import create_app
from helios_gateway.live import Live
from helios_gateway.settings import Settings

sys.path.insert(0, str(Path(__file__).parent))

from gateway_backend import Backend


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
    live = Live(MemoryBus(hub), Settings.load([]))
    yield live
    live.close()


@pytest.fixture
def client(hub: MemoryHub, live: Live) -> Iterator[TestClient]:
    app = create_app(MemoryBus(hub), live, Settings.load([]))
    with TestClient(app, raise_server_exceptions=False) as client:
        yield client
