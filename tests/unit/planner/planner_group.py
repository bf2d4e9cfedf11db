"""Several planners on one hub with fake peers, in sequence or in parallel; some of them die."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helios_core import proto as pb
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import ACT, Method, Rep, Req
from helios_planner.service import PlannerService
from planner_bus import hasty, lose_patience_soon
from planner_peers import Peers
from planner_world import FakeWorld


class MortalBus(MemoryBus):
    """Blocks its caller for ever at the first action for which `dies_at` is true. With `answered`
    the robot has done the action by then, and its result is lost."""

    dies_at: Callable[[pb.ActionRequest], bool] | None = None
    answered = True
    dead = threading.Event()

    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep:
        if not isinstance(request, pb.ActionRequest) or method.name != ACT.name:
            return super().call(method, request, timeout_s)
        dies = self.dies_at is not None and self.dies_at(request)
        if dies and not self.answered:
            self._die()
        reply = super().call(method, request, timeout_s)
        if dies:
            self._die()
        return reply

    def _die(self) -> None:
        self.dead.set()
        threading.Event().wait()


class PlannerGroup:
    """Planners on one hub with fake peers, in sequence or in parallel."""

    def __init__(self, state_dir: Path) -> None:
        self.state_dir, self.hub = state_dir, MemoryHub()
        self.planners: list[PlannerService] = []
        self.healths: list[Health] = []

    def peers(self, world: FakeWorld, robot: str = "robot") -> Peers:
        return Peers(self.hub, world, robot=robot)

    def planner(self, robot: str = "robot", **settings: Any) -> MemoryBus:
        """Start a planner; return a bus to call it. Its health is the last of `healths`."""
        given = hasty(self.state_dir / robot, **settings)
        self.healths.append(Health())
        self.planners.append(PlannerService(MemoryBus(self.hub, robot), given, self.healths[-1]))
        return MemoryBus(self.hub, robot)

    def mortal(
        self, dies_at: Callable[[pb.ActionRequest], bool], answered: bool = True
    ) -> tuple[MortalBus, MemoryBus]:
        """Start a planner that dies; return its own bus and a bus to call it."""
        bus = MortalBus(self.hub)
        bus.dies_at, bus.answered = dies_at, answered
        bus.dead = threading.Event()
        PlannerService(bus, hasty(self.state_dir / "robot"), Health())
        return bus, MemoryBus(self.hub)

    def close(self) -> None:
        for planner in self.planners:
            planner.close()


@pytest.fixture
def group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[PlannerGroup]:
    lose_patience_soon(monkeypatch)
    group = PlannerGroup(tmp_path)
    yield group
    group.close()
