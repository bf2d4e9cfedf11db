"""An action whose sender is silent ends without a latched stop; a stop meanwhile stays latched."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import pytest
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings
from helios_core import proto as pb
from helios_core.bus import Registration
from helios_core.errors import Conflict, Unavailable
from helios_core.health import Health
from helios_core.heartbeat import HALTED
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import ACT, LEASE, STOP
from helios_core.types import RobotDescription, RobotState

from tests.support import wait_until
from tests.unit.bridge.bridge_stage import LineRobot, Stage


def act(stage: Stage, action_id: str, beats: bool) -> pb.ActionResult:
    token = stage.other.call(LEASE, pb.LeaseRequest(holder="planner"), 1).token
    request = pb.ActionRequest(
        action_id=action_id,
        lease_token=token,
        time_remaining_s=20,
        beats=beats,
        action=pb.Action(forward=pb.Action.Forward(distance_m=0.5)),
    )
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


class Slow(LineRobot):
    """Its stop for a silent sender takes until the test goes on."""

    def __init__(self) -> None:
        super().__init__()
        self.asked, self.go_on = threading.Event(), threading.Event()

    def stop(self, reason: str) -> None:
        if "silent" in reason:
            self.asked.set()
            self.hold.set()  # the action ends at once, the call of stop does not
            self.go_on.wait(10)
        super().stop(reason)


def test_a_driver_that_comes_back_late_from_a_halt_may_act_again() -> None:
    robot = Slow()
    stage = Stage(robot, heartbeat_s=0.1, stop_timeout_s=0.1)
    robot.hold.clear()
    act(stage, "a", beats=True)
    with pytest.raises(Unavailable, match="has not come back from ending an action"):
        act(stage, "b", beats=False)
    robot.go_on.set()
    wait_until(lambda: not stage.bridge._stopping.halting, 60, "it has come back")
    wait_until(lambda: not robot.stopped, 60, "its stop is cleared")
    assert act(stage, "c", beats=False).succeeded


class Unheard(LineRobot):
    """Its first two stops for a silent sender fail, as over a radio link that is down."""

    failures = 2

    def stop(self, reason: str) -> None:
        if "silent" in reason and self.failures:
            self.failures -= 1
            raise Unavailable("the robot does not answer")
        super().stop(reason)


def test_a_halt_that_fails_is_tried_again_while_the_action_runs() -> None:
    robot = Unheard()
    stage = Stage(robot, heartbeat_s=0.1)
    robot.hold.clear()
    ended = act(stage, "a", beats=True)
    assert not ended.succeeded
    assert robot.failures == 0
    assert stage.health.metrics()["halts"] == 1
    wait_until(lambda: not stage.bridge._stopping.halting, 60, "the halt is over")
    wait_until(lambda: not robot.stopped, 60, "its stop is cleared")
    assert act(stage, "b", beats=False).succeeded


def test_a_halt_that_always_failed_is_no_fault_once_the_action_is_over() -> None:
    robot = Unheard()
    robot.failures = 10**6
    stage = Stage(robot, heartbeat_s=0.1)
    robot.hold.clear()
    acting = threading.Thread(target=act, args=(stage, "a", True))
    acting.start()
    wait_until(lambda: stage.health.state[0] == "degraded", 60, "the halt fails")
    robot.hold.set()
    acting.join(10)
    wait_until(lambda: not stage.bridge._stopping.halting, 60, "the halt is over")
    wait_until(lambda: stage.health.state[0] != "degraded", 60, "the fault is over")


@pytest.mark.parametrize(
    ("message", "stays"), [(f"{HALTED} for 3.9 s", False), ("a person pressed the button", True)]
)
def test_a_bridge_clears_the_halt_of_one_that_died_and_no_other_stop(
    message: str, stays: bool
) -> None:
    class Stopped(LineRobot):
        asked = 0

        def state(self) -> RobotState:
            self.asked += 1
            if self.asked < 4:
                raise Unavailable("nobody serves world/state")
            return replace(super().state(), message=self.stopped)

    robot = Stopped()
    robot.asked = 10
    robot.stopped = message
    stage = Stage(robot)
    robot.asked = 0  # the robot is silent at first
    stage.bridge.start()
    wait_until(lambda: robot.asked >= 4, 60, "the robot answers")
    stage.bridge.close()
    assert bool(robot.stopped) is stays


def test_the_action_of_a_sender_without_heartbeats_runs_on() -> None:
    stage = Stage(heartbeat_s=0.05)
    stage.robot.hold.clear()
    threading.Timer(0.5, stage.robot.hold.set).start()
    assert act(stage, "a", beats=False).succeeded


def test_a_stop_during_the_halt_stays_latched() -> None:
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
    wait_until(lambda: bool(robot.stopped), 60, "the robot is stopped")


def test_a_stop_does_not_wait_for_a_driver_that_is_slow_to_clear_a_halt() -> None:
    class SlowToClear(LineRobot):
        def __init__(self) -> None:
            super().__init__()
            self.clearing, self.go_on = threading.Event(), threading.Event()

        def clear_stop(self) -> None:
            self.clearing.set()
            self.go_on.wait(10)
            super().clear_stop()

    robot = SlowToClear()
    stage = Stage(robot, heartbeat_s=0.1, stop_timeout_s=2.0)
    robot.hold.clear()
    acting = threading.Thread(target=act, args=(stage, "a", True))
    acting.start()
    assert robot.clearing.wait(10)
    stage.other.call(STOP, pb.StopRequest(reason="a child"), 5)
    assert robot.stopped == "a child"
    robot.go_on.set()
    acting.join(10)
    wait_until(lambda: robot.stopped == "a child", 60, "the robot is stopped again")
    assert stage.bridge.state().stopped
    with pytest.raises(Conflict, match="a child"):
        act(stage, "b", beats=False)


def test_a_bridge_whose_robot_is_away_leaves_no_subscription() -> None:
    class Away(LineRobot):
        def describe(self) -> RobotDescription:
            raise Unavailable("the robot is switched off")

    class Counting(MemoryBus):
        subscriptions = 0

        def subscribe(self, *args: Any, **kwargs: Any) -> Registration:
            self.subscriptions += 1
            return super().subscribe(*args, **kwargs)

    bus = Counting(MemoryHub())
    with pytest.raises(Unavailable, match="switched off"):
        BridgeService(bus, Away(), Settings(stream_hz=0.0), Health())
    assert bus.subscriptions == 0
