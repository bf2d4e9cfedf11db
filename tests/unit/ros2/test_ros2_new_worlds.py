"""New origins and clocks that go back: which begin a new world, and what a running motion does."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import helios_ros2.driver
import pytest
from helios_core.robot import Action, Forward
from helios_ros2.driver import Ros2Driver
from helios_ros2.robot_input import RobotInput
from helios_ros2.settings import Ros2Settings
from helios_ros2.stop_latch import NotDone, StopLatch
from helios_ros2.velocity_motion import VelocityMotion

from tests.unit.ros2.ros2_stage import CAMERA, MS, Graph, camera_info, transform

S = 1_000_000_000
SETTINGS = Ros2Settings(pose="tf", silent_s=60.0)


class Robot:
    """odom -> base_link -> neck -> camera, and base_link -> wheel; the test sends each pose."""

    def __init__(self) -> None:
        self.graph: Any = Graph()
        self.senses = RobotInput(self.graph, SETTINGS)
        self.ns, self.x_m = 100 * S, 0.0
        mount = SimpleNamespace(transforms=[transform("neck", CAMERA, 0)])
        self.graph.handlers["/tf_static"](mount)
        for parent, child in (("odom", "base_link"), ("base_link", "neck"), ("base_link", "wheel")):
            self.send(parent, child, self.ns)
        self.senses._on_info("color", camera_info())
        self.senses.connect(10.0)
        self.drives(0.0)

    def send(self, parent: str, child: str, ns: int) -> None:
        found = transform(parent, child, ns, self.x_m if child == "base_link" else 0.0)
        self.graph.handlers["/tf"](SimpleNamespace(transforms=[found]))

    def drives(self, far_m: float) -> None:
        self.x_m += far_m
        self.ns += 50 * MS
        self.send("odom", "base_link", self.ns)


class Passing(StopLatch):
    """Each rest lets the robot do what comes next, instead of time passing."""

    def __init__(self, does: Callable[[], None]) -> None:
        super().__init__()
        self._does = does

    def rest(self, seconds: float) -> None:
        self._does()


def test_a_tf_frame_beside_base_and_camera_whose_clock_goes_back_begins_no_new_world() -> None:
    robot = Robot()
    before = robot.senses.here()
    robot.send("base_link", "wheel", 3 * S)
    assert robot.senses.world_epoch == 0
    assert robot.senses.here() is before


@pytest.mark.parametrize(
    ("parent", "child"), [("odom", "base_link"), ("odom", "/base_link"), ("base_link", "neck")]
)
def test_a_tf_frame_of_base_or_camera_whose_clock_goes_back_begins_a_new_world_and_is_named(
    parent: str, child: str, caplog: pytest.LogCaptureFixture
) -> None:
    robot = Robot()
    with caplog.at_level(logging.WARNING):
        robot.send(parent, child, 3 * S)
    assert robot.senses.world_epoch == 1
    assert f"the clock of the TF frame {child.lstrip('/')} went back" in caplog.text


@pytest.mark.parametrize(
    "move", [lambda motion: motion.forward(2.0), lambda motion: motion.turn(math.pi)]
)
def test_a_motion_by_velocities_halts_when_the_poses_jump(
    move: Callable[[VelocityMotion], None],
) -> None:
    robot = Robot()
    steps = iter([0.02, 0.02, 3.0])  # the last one is a new origin
    latch = Passing(lambda: robot.drives(next(steps)))
    motion = VelocityMotion(robot.graph, SETTINGS, robot.senses, latch)
    with pytest.raises(NotDone, match="poses jumped during the motion"):
        move(motion)
    assert robot.senses.world_epoch == 1
    assert robot.graph.sent[0] != (0.0, 0.0)
    assert robot.graph.sent[-1] == (0.0, 0.0)


def test_a_result_tells_no_distance_between_poses_of_two_origins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(helios_ros2.driver, "ZenohNode", lambda *_: Graph())
    driver = Ros2Driver(Ros2Settings(transport="zenoh", pose="tf"))
    robot = Robot()
    driver._senses = robot.senses
    monkeypatch.setattr(driver, "_come_to_rest", lambda: None)
    far_m = iter([0.4, 3.0])

    def do(_: Action) -> None:
        robot.drives(next(far_m))

    monkeypatch.setattr(driver, "_do", do)
    assert driver.act(Forward(0.4), "a").moved_m == pytest.approx(0.4)
    assert driver.act(Forward(0.4), "b").moved_m == 0.0
