"""Odometry that dies while other nodes keep /tf alive; a stop before an action is accepted."""

from __future__ import annotations

import itertools
import json
import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import helios_ros2.driver
import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput, Unavailable
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Action, Forward
from helios_core.topics import CANCEL
from helios_ros2.action_call import RosAction
from helios_ros2.driver import Ros2Driver
from helios_ros2.offered_qos import Qos
from helios_ros2.robot_input import RobotInput
from helios_ros2.settings import Ros2Settings
from helios_ros2.stop_latch import NotDone, StopLatch
from helios_ros2.task_interface import TaskInterface
from helios_ros2.velocity_motion import VelocityMotion

MS = 1_000_000
SILENT_S = 0.2
CAMERA = "camera"


def xyz(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> SimpleNamespace:
    return SimpleNamespace(x=x, y=y, z=z)


def transform(parent: str, child: str, ns: int, x_m: float = 0.0) -> SimpleNamespace:
    stamp = SimpleNamespace(sec=ns // 10**9, nanosec=ns % 10**9)
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp, frame_id=parent), child_frame_id=child,
        transform=SimpleNamespace(
            translation=xyz(x_m), rotation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
        ),
    )  # fmt: skip


class Graph:
    """Stands for a ROS node: every topic has a publisher, and the test sends its messages."""

    domain = "ROS_DOMAIN_ID is 0"

    def __init__(self) -> None:
        self.handlers: dict[str, Callable[[Any], None]] = {}
        self.sent: list[tuple[float, float]] = []

    def every(self, _period_s: float, look: Callable[[], None]) -> None:
        look()

    def has_interface(self, _kind: str) -> bool:
        return True

    def graph(self) -> dict[str, list[str]]:
        return {"/camera/color/image_raw": ["x"], "/camera/color/camera_info": ["y"]}

    def offered(self, topic: str) -> list[tuple[str, Qos]]:
        kinds = {"/tf": "tf2_msgs/msg/TFMessage", "/tf_static": "tf2_msgs/msg/TFMessage"}
        return [(kinds[topic], Qos())] if topic in kinds else []

    def start(self) -> None: ...

    def close(self) -> None: ...

    def requested(self, _topic: str) -> list[tuple[str, Qos]]:
        return [("geometry_msgs/msg/Twist", Qos())]

    def subscribe(self, topic: str, _kind: str, handler: Callable[[Any], None], *_: Any) -> Any:
        self.handlers[topic] = handler
        return SimpleNamespace(close=lambda: None)

    def publisher(self, *_: Any) -> Any:
        return SimpleNamespace(publish=lambda m: self.sent.append((m.linear.x, m.angular.z)))

    def interface(self, _kind: str) -> Any:
        return lambda: SimpleNamespace(linear=xyz(), angular=xyz())


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
        info = SimpleNamespace(
            header=SimpleNamespace(frame_id=CAMERA), k=[300.0, 0, 160, 0, 300, 120, 0, 0, 1],
            d=[], width=320, height=240, distortion_model="plumb_bob", r=[], p=[],
            binning_x=0, binning_y=0,
            roi=SimpleNamespace(width=0, height=0, x_offset=0, y_offset=0),
        )  # fmt: skip
        self.senses._on_info("color", info)
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


class Future:
    """Future of rclpy, as far as `RosAction` uses it."""

    def __init__(self) -> None:
        self._result: Any = None
        self._callbacks: list[Callable[[Any], None]] = []

    def done(self) -> bool:
        return self._result is not None

    def result(self) -> Any:
        return self._result

    def add_done_callback(self, call: Callable[[Any], None]) -> None:
        self._callbacks.append(call)

    def set(self, result: Any) -> None:
        self._result = result
        for call in self._callbacks:
            call(self)


@pytest.mark.parametrize("accepted", [True, False])
@pytest.mark.parametrize("ends", ["stop", "timeout"])
def test_a_goal_accepted_after_a_stop_is_cancelled(accepted: bool, ends: str) -> None:
    sent, cancelled = Future(), []
    client = SimpleNamespace(server_is_ready=lambda: True, send_goal_async=lambda _: sent)
    action = RosAction.__new__(RosAction)
    action.name, action._kind, action._client, action._goal = "/spin", "x/action/Spin", client, None
    latch = StopLatch()
    latch.begin()
    if ends == "stop":
        latch.stop("a person")
    with pytest.raises(NotDone):
        action.run(object(), latch, 0.05)
    handle = SimpleNamespace(accepted=accepted, cancel_goal_async=lambda: cancelled.append(True))
    sent.set(handle)
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
        (task("a", "queued"), ""), (task("a", "running"), "a"), (task("b", "queued"), "a"),
        (task("c", "cancelled"), "a"), (task("a", "paused"), "a"), (task("a", "succeeded"), ""),
        (task("b", "running"), "b"),
    ):  # fmt: skip
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
