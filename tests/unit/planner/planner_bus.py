"""Start a planner with fake peers, and call it over the bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helios_core import proto as pb
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import GET_TASK, SUBMIT
from helios_planner.robot import client, rpc
from helios_planner.service import PlannerService
from helios_planner.settings import Settings
from helios_planner.tasks import run_control
from planner_flat import MOVE, flat_with_mug
from planner_peers import Peers
from planner_world import FakeWorld

from tests.support import wait_until

Start = Callable[..., tuple[PlannerService, MemoryBus, Peers]]


def lose_patience_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "ACK_PATIENCE_S", 0.2)
    for module in (client, rpc, rpc, run_control, run_control):
        monkeypatch.setattr(module, "RETRY_S", 0.02)


def hasty(state_dir: Path, **settings: Any) -> Settings:
    """Make settings with short timeouts."""
    given = {"agent": "helios-paper", **settings}  # its settings are the defaults
    return Settings(state_dir=state_dir, ack_timeout_s=0.4, away_s=0.4, **given)


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    """Start a planner with fake peers and short timeouts."""
    lose_patience_soon(monkeypatch)
    running: list[PlannerService] = []

    def go(
        world: FakeWorld | None = None, names: tuple[str, ...] = (), **settings: Any
    ) -> tuple[PlannerService, MemoryBus, Peers]:
        hub = MemoryHub()
        peers = Peers(hub, world or flat_with_mug(), names)
        running.append(PlannerService(MemoryBus(hub), hasty(tmp_path, **settings), Health()))
        return running[-1], MemoryBus(hub), peers

    yield go
    for service in running:
        service.close()


def submit(
    bus: MemoryBus, text: str = MOVE, max_steps: int = 0, agent: str = "", time_limit_s: float = 0.0
) -> pb.Task:
    request = pb.SubmitRequest(
        instruction=text, max_steps=max_steps, agent=agent, time_limit_s=time_limit_s
    )
    return bus.call(SUBMIT, request, 5)


def task(bus: MemoryBus, id: str) -> pb.Task:
    return bus.call(GET_TASK, pb.TaskRequest(id=id), 5)


def ended(bus: MemoryBus, id: str) -> pb.Task:
    wait_until(lambda: task(bus, id).state in ("succeeded", "failed", "cancelled"), 120, "it ended")
    return task(bus, id)
