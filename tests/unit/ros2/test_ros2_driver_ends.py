"""The end of the driver: it cancels what runs, and ends although ROS does not answer."""

from __future__ import annotations

import threading
from functools import partial
from types import SimpleNamespace
from typing import Any

import helios_ros2.driver
import pytest
from helios_core.errors import Internal
from helios_ros2.action_call import RosAction
from helios_ros2.driver import Ros2Driver
from helios_ros2.nav2_motion import Nav2Motion
from helios_ros2.settings import Ros2Settings
from helios_ros2.stop_latch import NotDone

from tests.support import wait_until
from tests.unit.ros2.ros2_stage import Future, Graph, ros_action


class Stage:
    """Driver with one action, of the hand or of Nav2, on a node that stands for ROS."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, action: RosAction, nav2: bool) -> None:
        self.graph = Graph()
        monkeypatch.setattr(helios_ros2.driver, "ZenohNode", lambda *_: self.graph)
        self.driver = Ros2Driver(Ros2Settings(transport="zenoh"))
        if nav2:
            self.driver._nav2 = Nav2Motion.__new__(Nav2Motion)
            self.driver._nav2._actions = {"spin": action}
        else:
            self.driver._manipulation._actions = {"pick": action}

    def goal(self, answer: Future) -> Any:
        """Handle of an accepted goal; a cancel is answered by `answer`."""

        def cancel() -> Future:
            self.graph.happened.append("cancel")
            return answer

        return SimpleNamespace(accepted=True, cancel_goal_async=cancel, get_result_async=Future)


@pytest.mark.parametrize("nav2", [False, True])
def test_closing_cancels_the_running_goal_and_waits_for_the_answer_before_the_node_ends(
    monkeypatch: pytest.MonkeyPatch, nav2: bool
) -> None:
    monkeypatch.setattr(helios_ros2.driver, "CANCEL_WITHIN_S", 30.0)
    action, answer = ros_action(), Future()
    stage = Stage(monkeypatch, action, nav2)
    action._goal = stage.goal(answer)
    closing = threading.Thread(target=stage.driver.close)
    closing.start()
    wait_until(lambda: "cancel" in stage.graph.happened, 60, "the goal is cancelled")
    stage.graph.happened.append("answer")
    answer.set_result(True)
    closing.join(30)
    assert stage.graph.happened == ["cancel", "answer", "close"]


def test_closing_cancels_a_goal_that_is_accepted_only_now(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(helios_ros2.driver, "CANCEL_WITHIN_S", 30.0)
    sent, answer = Future(), Future()
    action = ros_action(sent)
    stage = Stage(monkeypatch, action, nav2=False)
    latch, ended = stage.driver._latch, list[NotDone]()

    def run() -> None:
        with pytest.raises(NotDone) as why:
            action.run(object(), latch, 60.0)
        ended.append(why.value)

    latch.begin()
    threading.Thread(target=run).start()
    wait_until(lambda: action._sent is sent, 60, "the goal is sent")
    closing = threading.Thread(target=stage.driver.close)
    closing.start()
    wait_until(lambda: ended, 60, "nobody waits for the goal any more")
    answer.set_result(True)
    sent.set_result(stage.goal(answer))
    closing.join(30)
    assert stage.graph.happened[0] == "cancel"
    assert stage.graph.happened[-1] == "close"


def fails() -> Future:
    raise RuntimeError("the context is invalid")


@pytest.mark.parametrize("fault", ["no answer", "an error"])
def test_closing_ends_the_node_although_ros_does_not_take_the_cancel(
    monkeypatch: pytest.MonkeyPatch, fault: str, caplog: pytest.LogCaptureFixture
) -> None:
    action = ros_action()
    stage = Stage(monkeypatch, action, nav2=False)
    goal = stage.goal(Future())
    if fault == "an error":
        goal.cancel_goal_async = fails
    action._goal = goal
    stage.driver.close()
    assert stage.graph.happened == (["cancel", "close"] if fault == "no answer" else ["close"])
    assert ("the context is invalid" in caplog.text) == (fault == "an error")


@pytest.mark.parametrize("cancel", ["answered", "fails"])
def test_a_goal_whose_result_fails_is_cancelled_and_known_until_it_is(
    monkeypatch: pytest.MonkeyPatch, cancel: str
) -> None:
    sent, answer = Future(), Future()
    action = ros_action(sent)
    stage = Stage(monkeypatch, action, nav2=False)
    goal = stage.goal(answer)
    answer.set_result(True)
    takes, goal.get_result_async = goal.cancel_goal_async, fails
    if cancel == "fails":
        goal.cancel_goal_async = fails
    sent.set_result(goal)
    stage.driver._latch.begin()
    with pytest.raises(RuntimeError, match="the context is invalid"):
        action.run(object(), stage.driver._latch, 60.0)
    goal.cancel_goal_async = takes
    stage.driver.stop("a cat")
    assert stage.graph.happened == ["cancel"]


def test_a_goal_that_could_not_be_sent_is_not_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    action = ros_action(Future())
    sent = action._client.send_goal_async(None)
    monkeypatch.setattr(sent, "done", lambda: True)
    monkeypatch.setattr(sent, "exception", lambda: RuntimeError("lost"))
    monkeypatch.setattr(sent, "result", fails)
    stage = Stage(monkeypatch, action, nav2=False)
    stage.driver._latch.begin()
    with pytest.raises(RuntimeError, match="the context is invalid"):
        action.run(object(), stage.driver._latch, 60.0)
    stage.driver.stop("a cat")


def test_a_stop_cancels_every_motion_although_one_cannot_be_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    action = ros_action()
    stage = Stage(monkeypatch, action, nav2=True)
    action._goal = stage.goal(Future())

    def raises(text: str) -> None:
        raise RuntimeError(text)

    monkeypatch.setattr(stage.driver._velocity, "halt", lambda: raises("no velocity"))
    with pytest.raises(RuntimeError, match="no velocity"):
        stage.driver.stop("a cat")
    assert stage.graph.happened == ["cancel"]
    no_hand = [partial(raises, "no hand")]
    monkeypatch.setattr(stage.driver._manipulation, "cancels", lambda _: no_hand)
    with pytest.raises(Internal, match="RuntimeError: no velocity; RuntimeError: no hand"):
        stage.driver.stop("a cat")
    assert stage.graph.happened == ["cancel", "cancel"]
