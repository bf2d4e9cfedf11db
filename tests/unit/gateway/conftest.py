"""Fixtures: a fake backend of services, and an HTTP client."""

from collections.abc import Iterator

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app

from tests.gateway_backend import Backend
from tests.unit.gateway.gateway_clock import Clock
from tests.unit.gateway.gateway_frames import bridge

__all__ = ["bridge"]

# The fake services report only once, tests send any number of requests, and a thread may wait for
# a core while a drive command holds.
PATIENT = Settings.load(
    ["--silent-after-s", "3600", "--requests-per-s", "1000000", "--teleop-hold-s", "2"]
)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def hub() -> MemoryHub:
    return MemoryHub()


@pytest.fixture
def backend(hub: MemoryHub) -> Backend:
    """All services except the gateway, running and answering."""
    backend = Backend(hub)
    backend.start()
    return backend


@pytest.fixture
def live(hub: MemoryHub) -> Iterator[RobotMonitor]:
    """The robot monitor without its timer: tests call `tick`."""
    live = RobotMonitor(MemoryBus(hub), PATIENT)
    yield live
    live.close()


@pytest.fixture(scope="session")
def served() -> dict[str, RobotEndpoint]:
    """The robots of the shared application; empty between tests."""
    return {}


@pytest.fixture(scope="session")
def app(served: dict[str, RobotEndpoint]) -> FastAPI:
    """The application without keys.

    All tests of a process share it, since its first requests build the routes.
    """
    return create_app(RobotRegistry(served), PATIENT)


@pytest.fixture
def client(
    app: FastAPI, served: dict[str, RobotEndpoint], hub: MemoryHub, live: RobotMonitor
) -> Iterator[TestClient]:
    served["robot"] = RobotEndpoint(MemoryBus(hub), live)
    with TestClient(app, "http://localhost", raise_server_exceptions=False) as client:
        yield client
    served.clear()
