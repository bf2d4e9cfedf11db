"""The action DoTask: a cancel from ROS reaches the task, whenever it comes and whatever fails."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Coroutine
from types import SimpleNamespace
from typing import Any

import helios_ros2.task_interface
import pytest
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CANCEL, GET_TASK, SUBMIT
from helios_ros2.task_interface import MOST_CALLS, DoTaskAction, PlannerCalls

from tests.support import wait_until
from tests.unit.ros2.ros2_stage import Future


class Goal:
    """Goal handle of rclpy. Its request for a cancel counts only once `_on_cancel` has returned."""

    def __init__(self) -> None:
        self.goal_id, self.is_cancel_requested, self.ended = "goal 1", False, ""
        self.request = SimpleNamespace(instruction="bring a cup", time_limit_s=0.0)

    def publish_feedback(self, _: Any) -> None: ...

    def succeed(self) -> None:
        self.ended = "succeeded"

    def canceled(self) -> None:
        self.ended = "canceled"

    def abort(self) -> None:
        self.ended = "aborted"


class Inline(PlannerCalls):
    """Runs each call at once."""

    def start(self, call: Callable[[], object]) -> bool:
        call()
        return True


class Stage:
    """The action on a bus with a planner that has one task."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        modules = {"task": SimpleNamespace(Future=Future)}
        monkeypatch.setattr(helios_ros2.task_interface, "rclpy_module", modules.__getitem__)
        hub = MemoryHub()
        planner, self.goal = MemoryBus(hub), Goal()
        self.action = action = DoTaskAction.__new__(DoTaskAction)
        ros: Any = SimpleNamespace(executor=None)
        action._bus, action._ros = MemoryBus(hub), ros
        action._kind = SimpleNamespace(Result=SimpleNamespace, Feedback=SimpleNamespace)
        action._lock, action._goals = threading.Lock(), {}
        action._cancelled, action._accept = deque(), "accept"
        action._calls = Inline()
        self.task = pb.Task(id="a", state="running")
        self.cancels = 0
        self.planner_is_away = False
        self.on_submit: Callable[[], object] = lambda: None
        planner.serve(SUBMIT, self._submit)
        planner.serve(CANCEL, self._cancel)
        planner.serve(GET_TASK, lambda _: self.task)

    def _submit(self, _: pb.SubmitRequest) -> pb.Task:
        self.on_submit()
        return self.task

    def _cancel(self, request: pb.TaskRequest) -> pb.Task:
        self.cancels += 1
        assert request.id == "a"
        if self.planner_is_away:
            raise Unavailable("the planner is away")
        self.task.state = "cancelled"
        return self.task

    def runs(self) -> Coroutine[Any, Any, Any]:
        """The goal, up to its wait for the end of the task."""
        running = self.action._execute(self.goal)
        running.send(None)
        return running

    def result(self, running: Coroutine[Any, Any, Any]) -> Any:
        """Result of the goal, after a look at the task."""
        self.action._look()
        with pytest.raises(StopIteration) as end:
            running.send(None)
        return end.value.value


def test_a_cancel_that_comes_while_the_task_is_submitted_cancels_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stage = Stage(monkeypatch)
    stage.on_submit = lambda: stage.action._on_cancel(stage.goal)
    running = stage.runs()
    stage.goal.is_cancel_requested = True  # by rclpy, after the check of `_execute`
    assert stage.cancels == 1
    assert stage.result(running).state == "cancelled"
    assert stage.goal.ended == "canceled"


def test_a_cancel_that_the_planner_does_not_take_is_tried_again_and_the_result_is_orderly(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    stage = Stage(monkeypatch)
    stage.goal.is_cancel_requested = True
    stage.planner_is_away = True
    with caplog.at_level(logging.WARNING):
        running = stage.runs()
    assert "the task a could not be cancelled" in caplog.text
    stage.planner_is_away = False
    stage.action._look()
    assert stage.cancels == 2
    assert stage.result(running).state == "cancelled"
    assert stage.goal.ended == "canceled"
    stage.action._look()
    assert stage.cancels == 2


def test_a_goal_that_nobody_cancels_runs_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch)
    running = stage.runs()
    stage.action._look()
    stage.task.state = "succeeded"
    assert stage.result(running).succeeded
    assert (stage.cancels, stage.goal.ended) == (0, "succeeded")


def test_calls_that_wait_for_the_planner_leave_the_caller_free_and_are_bounded() -> None:
    calls, go_on, running = PlannerCalls(), threading.Event(), threading.Semaphore(0)

    def hangs() -> None:
        running.release()
        go_on.wait(20)

    assert all(calls.start(hangs) for _ in range(MOST_CALLS))
    for _ in range(MOST_CALLS):
        assert running.acquire(timeout=20)
    assert not calls.start(hangs)
    go_on.set()
    wait_until(lambda: calls.start(lambda: None), 60, "a thread is free again")


def test_a_goal_that_finds_too_many_calls_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch)
    monkeypatch.setattr(stage.action._calls, "start", lambda _: False)
    with pytest.raises(StopIteration) as end:
        _ = stage.runs()
    assert (end.value.value.state, stage.goal.ended) == ("refused", "aborted")
