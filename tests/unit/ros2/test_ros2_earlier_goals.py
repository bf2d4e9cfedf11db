"""Goals that an earlier bridge left behind: they are cancelled before the first motion."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import helios_ros2.driver
import helios_ros2.earlier_goals
import pytest
from helios_core.errors import Unavailable
from helios_core.robot import Action, Forward, Observe
from helios_ros2.driver import Ros2Driver
from helios_ros2.earlier_goals import REFUSED, EarlierGoals, end_earlier
from helios_ros2.nav2_motion import Nav2Motion
from helios_ros2.settings import Ros2Settings
from helios_ros2.stop_latch import NotDone

from tests.unit.ros2.ros2_stage import CancelServer, Graph, earlier_goals, ros_action


class Robot:
    """Driver with one action, of the hand or of Nav2, whose cancel server the test plays. It notes
    what happens, in order."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, server: CancelServer, nav2: bool = False
    ) -> None:
        graph, self.happened = Graph(), list[str]()
        monkeypatch.setattr(helios_ros2.driver, "ZenohNode", lambda *_: graph)
        monkeypatch.setattr(helios_ros2.driver, "EARLIER_WITHIN_S", 0.1)
        self.driver = Ros2Driver(Ros2Settings(transport="zenoh"))
        action = ros_action()
        action.earlier = earlier_goals(server)
        if nav2:
            self.driver._nav2 = Nav2Motion.__new__(Nav2Motion)
            self.driver._nav2._actions = {"spin": action}
        else:
            self.driver._manipulation._actions = {"pick": action}
        here = SimpleNamespace(stamp_ns=1, world_epoch=0, T_world_base=[[0.0] * 4] * 4)
        senses = SimpleNamespace(connect=lambda _: "lens", here=lambda: here)
        monkeypatch.setattr(self.driver, "_senses", senses)
        monkeypatch.setattr(self.driver, "_describe", lambda _: self.happened.append("described"))
        monkeypatch.setattr(self.driver, "_come_to_rest", lambda: self.happened.append("at rest"))
        monkeypatch.setattr(self.driver, "_remember", lambda _id, _start, why: why)
        monkeypatch.setattr(self.driver, "_do", self._do)

    def act(self, action: Action) -> str:
        """Do an action. Returns why it was not done, and forgets what happened before."""
        self.happened.clear()
        return str(self.driver.act(action, "a"))

    def _do(self, action: Action) -> None:
        self.happened.append(type(action).__name__)


def test_all_goals_are_cancelled_as_soon_as_the_server_is_seen_and_only_once() -> None:
    server = CancelServer(is_there=False)
    goals = earlier_goals(server)
    goals.look()
    assert not server.asked
    server.is_there = True
    for _ in range(4):
        goals.look()
    assert [request for request, _ in server.asked] == ["all goals"]
    assert goals.ended


@pytest.mark.parametrize("nav2", [False, True])
def test_the_robot_is_described_once_the_earlier_goals_are_cancelled_and_the_base_rests(
    monkeypatch: pytest.MonkeyPatch, nav2: bool
) -> None:
    server = CancelServer()
    robot = Robot(monkeypatch, server, nav2)
    robot.driver.describe()
    assert len(server.asked) == 1
    assert robot.happened == ["at rest", "described"]
    assert robot.act(Forward(0.5)) == ""
    assert robot.happened == ["Forward", "at rest"]
    assert len(server.asked) == 1


def test_an_action_that_nobody_serves_delays_neither_start_nor_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = Robot(monkeypatch, CancelServer(is_there=False))
    monkeypatch.setattr(helios_ros2.driver, "EARLIER_WITHIN_S", 1e6)
    robot.driver.describe()
    assert robot.happened == ["described"]
    assert robot.act(Forward(0.5)) == ""


def test_a_server_seen_after_the_start_is_asked_and_the_base_rests_before_the_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    server = CancelServer(is_there=False)
    robot = Robot(monkeypatch, server)
    robot.driver.describe()
    server.is_there = True
    assert robot.act(Forward(0.5)) == ""
    assert robot.happened == ["at rest", "Forward", "at rest"]


@pytest.mark.parametrize("refuses", [False, True])
def test_while_a_server_has_not_cancelled_the_robot_starts_and_looks_but_does_not_move(
    monkeypatch: pytest.MonkeyPatch, refuses: bool
) -> None:
    monkeypatch.setattr(helios_ros2.earlier_goals, "AGAIN_S", 0.05)
    server = CancelServer(answers=refuses)
    server.return_code = REFUSED
    robot = Robot(monkeypatch, server)
    robot.driver.describe()
    assert robot.happened == ["described"]
    why = robot.act(Forward(0.5))
    assert robot.happened == ["at rest"]
    reason = "it refuses" if refuses else "it has not answered"
    assert f"the action /spin was asked to cancel its earlier goals: {reason}" in why
    assert "restart the action's server" in why
    assert robot.act(Observe()) == ""
    server.answers, server.return_code = True, 0
    monkeypatch.setattr(helios_ros2.driver, "EARLIER_WITHIN_S", 60.0)
    assert robot.act(Forward(0.5)) == ""


def test_a_stop_ends_the_wait_for_the_earlier_goals(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot(monkeypatch, CancelServer(answers=False))
    robot.driver._latch.begin()
    robot.driver._latch.stop("a cat")
    with pytest.raises(NotDone, match="a cat"):
        end_earlier(robot.driver._manipulation.earlier_goals(), 1e6, robot.driver._latch.rest)


def test_a_lost_request_is_repeated_and_only_the_newest_answer_counts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A request that the server reads later would cancel the goals of this bridge."""
    monkeypatch.setattr(helios_ros2.earlier_goals, "AGAIN_S", 0.01)
    server = CancelServer(answers=False)
    goals = earlier_goals(server)
    goals.look()
    time.sleep(0.02)
    goals.look()
    assert len(server.asked) == 2
    server.answer(0)
    goals.look()
    assert not goals.ended
    monkeypatch.setattr(helios_ros2.earlier_goals, "AGAIN_S", 60.0)
    server.answer(-1)
    goals.look()
    assert goals.ended


def test_without_poses_the_rest_is_awaited_again(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot(monkeypatch, CancelServer())

    def silent() -> None:
        raise Unavailable("no pose")

    monkeypatch.setattr(robot.driver, "_come_to_rest", silent)
    with pytest.raises(Unavailable):
        robot.driver.describe()
    monkeypatch.setattr(robot.driver, "_come_to_rest", lambda: robot.happened.append("at rest"))
    robot.driver.describe()
    assert robot.happened == ["at rest", "described"]


def test_the_cancel_service_is_that_of_the_action(monkeypatch: pytest.MonkeyPatch) -> None:
    made, kind = list[tuple[object, str]](), SimpleNamespace(Request=lambda: None)
    kinds = {"action_msgs/srv/CancelGoal": kind}
    monkeypatch.setattr(helios_ros2.earlier_goals, "interface", kinds.__getitem__)

    def create_client(of: object, name: str) -> CancelServer:
        made.append((of, name))
        return CancelServer()

    node = SimpleNamespace(create_client=create_client)
    looks = list[object]()
    ros: Any = SimpleNamespace(node=node, every=lambda _period_s, look: looks.append(look))
    goals = EarlierGoals(ros, "/robot1/spin")
    assert made == [(kind, "/robot1/spin/_action/cancel_goal")]
    assert looks == [goals.look]
