"""Fixtures: a router, and buses on it that close at the end of a test."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest
import zenoh
from helios_core.bus import Bus
from helios_core.errors import Unavailable
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.zenoh_bus import ZenohBus
from helios_core.zenoh_config import client_config

from tests.support import ENDS_WITHIN_S, free_port, wait_until

MakeBus = Callable[[str], Bus]


@pytest.fixture(scope="session")
def router() -> Iterator[str]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    process = subprocess.Popen([sys.executable, "-m", "helios_core.router", "--listen", endpoint])
    yield endpoint
    process.terminate()
    assert process.wait(ENDS_WITHIN_S) == 0


@pytest.fixture(params=["memory", "zenoh"])
def make_bus(request: pytest.FixtureRequest, router: str) -> Iterator[MakeBus]:
    made: list[Bus] = []
    hub = MemoryHub()

    def make(robot: str) -> Bus:
        made.append(MemoryBus(hub, robot) if request.param == "memory" else _open(router, robot))
        return made[-1]

    yield make
    for bus in made:
        bus.close()


@pytest.fixture
def zenoh_bus(router: str) -> Iterator[ZenohBus]:
    """A bus of robot "r"."""
    bus = _open(router, "r")
    yield bus
    bus.close()


@pytest.fixture
def session(router: str, zenoh_bus: ZenohBus) -> Iterator[zenoh.Session]:
    """A bare Zenoh session on the router of `zenoh_bus`."""
    session = zenoh.open(client_config(router))
    yield session
    session.close()


def _open(router: str, robot: str) -> ZenohBus:
    opened: list[ZenohBus] = []

    def try_open() -> bool:
        try:
            opened.append(ZenohBus(router, robot))
        except Unavailable:
            return False
        return True

    wait_until(try_open, 60, "the router answers")
    return opened[0]
