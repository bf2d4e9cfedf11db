"""Actions that end early: by stop-now or by the watchdog."""

from __future__ import annotations

import sys
import threading

import pytest
from helios_bridge import robot_stop
from helios_core import proto as pb
from helios_core.errors import Conflict, DeadlineExceeded, Unavailable
from helios_core.robot import Action, ActionResult
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


class Polling(LineRobot):
    """Looks for a stop only at the end of a step of its motion."""

    def act(self, action: Action, action_id: str) -> ActionResult:
        self.done.append(action)
        self.hold.wait(30)
        return ActionResult(not self.stopped, self.stopped)

    def stop(self, reason: str) -> None:
        self.stopped = reason


def acting(stage: Stage) -> tuple[threading.Thread, list[pb.ActionResult]]:
    """Thread in which an action runs until the robot's `hold` is set, and its result."""
    results: list[pb.ActionResult] = []
    stage.robot.hold.clear()
    runner = threading.Thread(target=lambda: results.append(stage.drive("a")))
    runner.start()
    wait_until(lambda: stage.robot.done, 60, "the action runs")
    return runner, results


def test_a_stop_that_is_cleared_at_once_still_ends_the_running_action() -> None:
    stage = Stage(Polling())
    runner, results = acting(stage)
    stage.other.call(STOP, pb.StopRequest(reason="a child"), 1)
    clearing = threading.Thread(target=lambda: stage.other.call(CLEAR_STOP, pb.Empty(), 10))
    clearing.start()
    clearing.join(0.1)
    stage.robot.hold.set()
    runner.join(30)
    clearing.join(30)
    assert (results[0].succeeded, results[0].reason) == (False, "a child")
    assert stage.drive("b").succeeded


def test_a_stop_is_not_cleared_while_its_action_does_not_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(robot_stop, "ACTION_ENDS_WITHIN_S", 0.01)
    stage = Stage(Polling())
    runner, _ = acting(stage)
    stage.other.call(STOP, pb.StopRequest(reason="a child"), 1)
    with pytest.raises(Conflict, match="an action still runs"):
        stage.other.call(CLEAR_STOP, pb.Empty(), 10)
    assert stage.robot.stopped == "a child"
    stage.robot.hold.set()
    runner.join(30)


def test_an_action_that_came_before_a_stop_does_not_begin_after_its_clear() -> None:
    stage = Stage()
    stage.drive("first")
    refused: list[Conflict] = []

    def drive() -> None:
        with pytest.raises(Conflict) as error:
            stage.drive("late", left_s=30)
        refused.append(error.value)

    with stage.bridge._turn:  # such as an image that is being taken
        runner = threading.Thread(target=drive)
        runner.start()
        wait_until(lambda: runner.ident and waits_for(runner, "_act"), 60, "the action waits")
        stage.other.call(STOP, pb.StopRequest(reason="a child"), 5)
        stage.other.call(CLEAR_STOP, pb.Empty(), 5)
    runner.join(30)
    assert "before the action began" in refused[0].message
    assert len(stage.robot.done) == 1


def waits_for(thread: threading.Thread, function: str) -> bool:
    """True if the innermost Python function of a thread has this name."""
    frame = sys._current_frames().get(thread.ident or 0)
    return frame is not None and frame.f_code.co_name == function


def test_a_stop_that_the_robot_took_before_the_end_of_a_clear_is_told_it_again() -> None:
    """The second stop takes effect before the clear does; only its reply is late."""
    stage = Stage()
    clearing, clear, reply = threading.Event(), threading.Event(), threading.Event()
    stops: list[str] = []

    def slow_stop(reason: str) -> None:
        LineRobot.stop(stage.robot, reason)
        stops.append(reason)
        if reason.endswith("a dog") and len(stops) == 2:
            reply.wait(30)

    def slow_clear() -> None:
        clearing.set()
        clear.wait(30)
        LineRobot.clear_stop(stage.robot)

    def refused_clear() -> None:
        with pytest.raises(Conflict, match="a dog"):
            stage.other.call(CLEAR_STOP, pb.Empty(), 30)

    stage.robot.stop, stage.robot.clear_stop = slow_stop, slow_clear
    stage.other.call(STOP, pb.StopRequest(reason="a child"), 5)
    clearer = threading.Thread(target=refused_clear)
    clearer.start()
    assert clearing.wait(30)
    with pytest.raises(DeadlineExceeded):
        stage.other.call(STOP, pb.StopRequest(reason="a dog"), 5)
    clear.set()
    clearer.join(30)
    assert stage.robot.stopped == "a dog"
    assert stage.bridge.state().stopped
    reply.set()


def test_one_thread_at_a_time_clears_a_stop() -> None:
    stage = Stage()
    clearing, go_on = threading.Event(), threading.Event()

    def slow_clear() -> None:
        clearing.set()
        go_on.wait(30)
        LineRobot.clear_stop(stage.robot)

    stage.robot.clear_stop = slow_clear
    stage.other.call(STOP, pb.StopRequest(reason="a child"), 5)
    first = threading.Thread(target=lambda: stage.other.call(CLEAR_STOP, pb.Empty(), 30))
    first.start()
    assert clearing.wait(30)
    with pytest.raises(Conflict, match="somebody else clears the stop"):
        stage.other.call(CLEAR_STOP, pb.Empty(), 5)
    go_on.set()
    first.join(30)
    assert not stage.bridge.state().stopped


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
