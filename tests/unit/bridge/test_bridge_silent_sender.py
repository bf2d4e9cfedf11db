"""An action whose sender is silent ends without a latched stop; a stop meanwhile stays latched."""

from __future__ import annotations

import threading

import pytest
from helios_core import proto as pb
from helios_core.errors import Conflict
from helios_core.topics import ACT, LEASE, STOP

from tests.support import wait_until
from tests.unit.bridge.bridge_stage import LineRobot, Stage


def act(stage: Stage, action_id: str, beats: bool) -> pb.ActionResult:
    token = stage.other.call(LEASE, pb.LeaseRequest(holder="planner"), 1).token
    request = pb.ActionRequest(
        action_id=action_id, lease_token=token, time_remaining_s=20, beats=beats,
        action=pb.Action(forward=pb.Action.Forward(distance_m=0.5)),
    )  # fmt: skip
    return stage.other.call(ACT, request, 10)


def test_the_action_of_a_silent_sender_ends_and_the_next_one_starts() -> None:
    stage = Stage(heartbeat_s=0.1)
    stage.robot.hold.clear()
    ended = act(stage, "a", beats=True)
    assert not ended.succeeded
    assert "silent" in ended.reason
    assert not stage.bridge.state().stopped
    assert stage.health.metrics()["halts"] == 1
    assert act(stage, "b", beats=False).succeeded


def test_the_action_of_a_sender_without_heartbeats_runs_on() -> None:
    stage = Stage(heartbeat_s=0.05)
    stage.robot.hold.clear()
    threading.Timer(0.5, stage.robot.hold.set).start()
    assert act(stage, "a", beats=False).succeeded


def test_a_stop_during_the_halt_stays_latched() -> None:
    class Slow(LineRobot):
        """Its stop for a silent sender takes until a person has stopped it, too."""

        def __init__(self) -> None:
            super().__init__()
            self.asked, self.go_on = threading.Event(), threading.Event()

        def stop(self, reason: str) -> None:
            if "silent" in reason:
                self.asked.set()
                self.go_on.wait(10)
            super().stop(reason)

    robot = Slow()
    stage = Stage(robot, heartbeat_s=0.1)
    robot.hold.clear()
    acting = threading.Thread(target=act, args=(stage, "a", True))
    acting.start()
    assert robot.asked.wait(10)
    stage.other.call(STOP, pb.StopRequest(reason="a child"), 5)
    robot.go_on.set()
    acting.join(10)
    assert stage.bridge.state().stopped
    with pytest.raises(Conflict, match="a child"):
        act(stage, "b", beats=False)
    wait_until(lambda: bool(robot.stopped), 5, "the robot is stopped")
