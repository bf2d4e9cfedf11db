"""Actions that end early: by stop-now or by the watchdog."""

from __future__ import annotations

import threading

import pytest
from helios_core import proto as pb
from helios_core.errors import Conflict, Unavailable
from helios_core.topics import CLEAR_STOP, STOP

from tests.support import wait_until
from tests.unit.bridge.bridge_stage import LineRobot, Stage


def test_stop_now_ends_the_running_action_latches_and_needs_an_explicit_clear() -> None:
    stage = Stage()
    stage.robot.hold.clear()
    results: list[pb.ActionResult] = []
    runner = threading.Thread(target=lambda: results.append(stage.drive("a")))
    runner.start()
    wait_until(lambda: stage.robot.done, 60, "the action runs")
    stage.other.call(STOP, pb.StopRequest(reason="a child in the way"), 1)
    runner.join(5)
    assert not results[0].succeeded
    assert stage.bridge.state().stopped
    with pytest.raises(Conflict, match="a child in the way"):
        stage.drive("b")
    stage.other.call(CLEAR_STOP, pb.Empty(), 1)
    assert stage.drive("b").succeeded


def test_the_watchdog_stops_an_action_that_exceeds_its_time_limit() -> None:
    stage = Stage()
    stage.bridge.start()
    stage.robot.hold.clear()
    result = stage.drive("a", left_s=0.2)
    assert not result.succeeded
    assert "outlived" in result.reason
    stage.bridge.close()


def test_the_watchdog_survives_a_robot_that_does_not_answer() -> None:
    stage = Stage()

    def deaf(reason: str) -> None:
        LineRobot.stop(stage.robot, reason)
        raise Unavailable("the robot is away")

    stage.bridge.start()
    stage.robot.stop = deaf
    for action_id in ("a", "b"):
        stage.robot.hold.clear()
        assert "outlived" in stage.drive(action_id, left_s=0.2).reason
        stage.other.call(CLEAR_STOP, pb.Empty(), 1)
    stage.bridge.close()


def test_a_stop_during_the_clear_of_another_stop_stays_latched() -> None:
    """A clear takes time, since the robot is reached over a network.

    At its end the driver forgets every stop.
    """
    stage = Stage()
    asked, go_on = threading.Event(), threading.Event()

    def slow() -> None:
        asked.set()
        go_on.wait(5)
        LineRobot.clear_stop(stage.robot)

    stage.robot.clear_stop = slow
    stage.other.call(STOP, pb.StopRequest(reason="a child"), 1)
    said: list[Conflict] = []

    def clear() -> None:
        with pytest.raises(Conflict) as refused:
            stage.other.call(CLEAR_STOP, pb.Empty(), 10)
        said.append(refused.value)

    clearing = threading.Thread(target=clear)
    clearing.start()
    assert asked.wait(5)
    stage.other.call(STOP, pb.StopRequest(reason="a dog"), 1)
    go_on.set()
    clearing.join(5)
    assert "a dog" in said[0].message
    assert stage.robot.stopped == "a dog"
    with pytest.raises(Conflict, match="a dog"):
        stage.drive("a")
    stage.other.call(CLEAR_STOP, pb.Empty(), 10)
    assert stage.drive("b").succeeded


def test_the_first_stop_reason_is_kept_when_further_stops_follow() -> None:
    stage = Stage()
    for reason in ("a child", "helios stop", "a child", ""):
        stage.other.call(STOP, pb.StopRequest(reason=reason), 1)
    assert stage.bridge.state().message == "a child; helios stop; stop-now"
    stage.other.call(CLEAR_STOP, pb.Empty(), 1)
    stage.other.call(STOP, pb.StopRequest(reason="a dog"), 1)
    assert stage.bridge.state().message == "a dog"
    for n in range(50):
        stage.other.call(STOP, pb.StopRequest(reason=f"reason {n}"), 1)
    said = stage.bridge.state().message
    assert said.startswith("a dog; ")
    assert len(said) <= 200
