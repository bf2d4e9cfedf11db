"""The bridge checks the robot's set-up with its keyframes, and says in words what is wrong."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings
from helios_core import proto as pb
from helios_core.codec import action_to_proto
from helios_core.errors import Conflict
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Action, Observe, Turn
from helios_core.topics import ACT, CONTEXT, LEASE, ROBOT_CHECKS
from helios_examples.room_robot import RoomRobot
from helios_sim.injected_faults import Faults, FaultyRobot

from tests.support import wait_until

CALL_S = 60.0


class Stage:
    """Bridge with a room robot that has faults, and a client that turns it."""

    def __init__(self, faults: str, checks: bool = True) -> None:
        self.health, hub = Health(), MemoryHub()
        self.bus = MemoryBus(hub)
        robot = FaultyRobot(RoomRobot(), Faults.of(faults))
        options = Settings(stream_hz=0, checks=checks)
        self.bridge = BridgeService(MemoryBus(hub), robot, options, self.health, first_number=0)
        self.bridge.start()
        self._token = self.bus.call(LEASE, pb.LeaseRequest(holder="test"), CALL_S).token
        self._actions = 0

    def act(self, action: Action) -> None:
        self._actions += 1
        request = pb.ActionRequest(
            action_id=str(self._actions),
            lease_token=self._token,
            time_remaining_s=CALL_S,
            action=action_to_proto(action),
        )
        assert self.bus.call(ACT, request, CALL_S).succeeded

    def checks(self, restart: bool = False) -> dict[str, pb.RobotCheck]:
        reply = self.bus.call(ROBOT_CHECKS, pb.RobotChecksRequest(restart=restart), CALL_S)
        self.images = reply.images
        return {check.name: check for check in reply.checks}


@pytest.fixture
def stages() -> Iterator[list[Stage]]:
    made: list[Stage] = []
    yield made
    for stage in made:
        stage.bridge.close()


def test_the_first_keyframes_of_a_task_show_what_is_wrong(stages: list[Stage]) -> None:
    stages.append(stage := Stage("pitch_deg=1.6"))
    for _ in range(7):
        stage.act(Turn(0.4))
    wait_until(lambda: "1.6 deg further down" in stage.health.state[1], 60, "the bridge says so")
    assert stage.health.state[0] == "ready"  # the robot may go on
    assert stage.checks()["pitch"].verdict == "wrong"


def test_a_healthy_robot_has_no_remark(stages: list[Stage]) -> None:
    stages.append(stage := Stage(""))
    for _ in range(4):
        stage.act(Turn(0.4))
    assert {check.verdict for check in stage.checks().values()} <= {"ok", "not measured"}
    assert stage.health.state == ("ready", "")


def test_a_new_search_and_a_restart_begin_anew(stages: list[Stage]) -> None:
    stages.append(stage := Stage(""))
    for _ in range(3):
        stage.act(Observe())
    stage.checks()
    assert stage.images == 3
    stage.bus.publish(CONTEXT, pb.SearchContext(id="another"))
    stage.act(Observe())
    stage.checks()
    assert stage.images == 1
    stage.checks(restart=True)
    assert stage.images == 1  # the one taken by the restart
    stage.act(Turn(0.4))
    stage.checks()
    assert stage.images == 2


def test_checks_can_be_off(stages: list[Stage]) -> None:
    stages.append(stage := Stage("", checks=False))
    with pytest.raises(Conflict, match="does not check"):
        stage.checks()
