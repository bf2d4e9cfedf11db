"""Odometry that dies while other nodes keep /tf alive; a stop before an action is accepted."""

from __future__ import annotations

import itertools
import json
import threading
import time
from types import SimpleNamespace
from typing import Any

import helios_ros2.driver
import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput, Unavailable
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Action, Forward
from helios_core.topics import CANCEL
from helios_ros2.driver import Ros2Driver
from helios_ros2.robot_input import RobotInput
from helios_ros2.settings import Ros2Settings
from helios_ros2.stop_latch import NotDone, StopLatch
from helios_ros2.task_interface import TaskInterface
from helios_ros2.velocity_motion import VelocityMotion

from tests.unit.ros2.ros2_stage import CAMERA, MS, Future, Graph, camera_info, ros_action, transform

SILENT_S = 0.2


class Robot:
    """Robot whose odometry can die, while a node of its wheels goes on publishing on /tf."""

    def __init__(self) -> None:
        self.graph: Any = Graph()
        self.senses = RobotInput(self.graph, Ros2Settings(pose="tf", silent_s=SILENT_S))
        self.odometry = True
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Robot:
        self._thread.start()
        self.senses._on_info("color", camera_info())
        self.senses.connect(10.0)
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()

    def dies(self) -> None:
        """Let the odometry die, and wait until nothing has come for a while."""
        self.odometry = False
        end_s = time.monotonic() + 10
        while time.monotonic() < end_s:
            self.senses.here()
            threading.Event().wait(0.02)

    def _run(self) -> None:
        for k in itertools.count():
            ns = 10**9 + 20 * MS * k
            found = [transform("base_link", "wheel", ns)]
            if self.odometry:
                found.append(transform("odom", "base_link", ns, 0.001 * k))
            self.graph.handlers["/tf"](SimpleNamespace(transforms=found))
            self.graph.handlers["/tf_static"](
                SimpleNamespace(transforms=[transform("base_link", CAMERA, 0)])
            )
            if self._ending.wait(0.02):
                return


def test_a_drive_ends_soon_after_the_odometry_dies_on_a_tf_that_goes_on() -> None:
    with Robot() as robot:
        motion = VelocityMotion(robot.graph, Ros2Settings(), robot.senses, StopLatch())
        threading.Timer(0.3, lambda: setattr(robot, "odometry", False)).start()
        with pytest.raises(Unavailable, match="no new pose of the base for") as why:
            motion.forward(5.0)
        assert robot.graph.sent[-1] == (0.0, 0.0)
    assert "/tf (tf2_msgs/msg/TFMessage" in str(why.value)
    assert "its last stamp is" in str(why.value)


def test_the_pose_comes_back_with_the_odometry() -> None:
    with Robot() as robot:
        robot.odometry = False
        waiting = threading.Event()
        waiting.wait(2 * SILENT_S)
        with pytest.raises(Unavailable):
            robot.senses.here()
        robot.odometry = True
        newest = robot.senses._history[-1].stamp_ns
        robot.senses.wait_newer(newest, 10.0)
        assert robot.senses.here().stamp_ns > newest


@pytest.mark.parametrize("accepted", [True, False])
@pytest.mark.parametrize("ends", ["stop", "timeout"])
def test_a_goal_accepted_after_a_stop_is_cancelled(accepted: bool, ends: str) -> None:
    sent, cancelled = Future(), []
    action, latch = ros_action(sent), StopLatch()
    latch.begin()
    if ends == "stop":
        latch.stop("a person")
    with pytest.raises(NotDone):
        action.run(object(), latch, 0.05)

    def cancel() -> Future:
        cancelled.append(True)
        return Future()

    sent.set_result(SimpleNamespace(accepted=accepted, cancel_goal_async=cancel))
    assert cancelled == ([True] if accepted else [])


def test_an_action_after_which_the_poses_fail_is_not_done_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(helios_ros2.driver, "ZenohNode", lambda *_: Graph())
    driver = Ros2Driver(Ros2Settings(transport="zenoh", pose="tf", silent_s=SILENT_S))
    done: list[Action] = []
    monkeypatch.setattr(driver, "_do", done.append)
    with Robot() as robot:
        driver._senses = robot.senses
        monkeypatch.setattr(driver, "_come_to_rest", robot.dies)
        with pytest.raises(Unavailable, match="no new pose"):
            driver.act(Forward(0.5), "a")
        again = driver.act(Forward(0.5), "a")
    assert len(done) == 1
    assert not again.succeeded
    assert "no new pose" in again.reason


def task(id: str, state: str) -> pb.Task:
    return pb.Task(id=id, state=state)


def test_a_waiting_task_is_not_the_present_one_of_the_ros_topics() -> None:
    told = TaskInterface.__new__(TaskInterface)
    sent: list[str] = []
    told._present, told.action = "", None
    told._text = lambda data: data
    told._task = SimpleNamespace(publish=lambda data: sent.append(json.loads(data)["id"]))
    for each, present in (
        (task("a", "queued"), ""),
        (task("a", "running"), "a"),
        (task("b", "queued"), "a"),
        (task("c", "cancelled"), "a"),
        (task("a", "paused"), "a"),
        (task("a", "succeeded"), ""),
        (task("b", "running"), "b"),
    ):
        told._on_task(each)
        assert told._present == present
    assert sent == ["a", "a", "a", "a", "b"]


def test_the_ros_service_cancel_ends_the_running_task() -> None:
    hub = MemoryHub()
    planner, told = MemoryBus(hub), TaskInterface.__new__(TaskInterface)
    asked: list[str] = []

    def cancel(request: pb.TaskRequest) -> pb.Task:
        asked.append(request.id)
        return pb.Task(id=request.id, state="cancelled")

    planner.serve(CANCEL, cancel)
    told._bus, told._present = MemoryBus(hub), ""
    with pytest.raises(InvalidInput, match="no task runs"):
        told._cancel()
    told._present = "a"
    assert told._cancel() == "the task a is cancelled"
    assert asked == ["a"]
