"""Errors of the bridge for the author of a driver that is not correct yet."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helios_bridge.driver_loading import load_driver
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings
from helios_core.errors import InvalidInput
from helios_core.geometry import camera_on_base
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Capture
from helios_core.topics import ROBOT_DESCRIPTION
from helios_core.types import RobotDescription

from tests.support import wait_until
from tests.unit.bridge.bridge_stage import LineRobot, Stage

SOURCE = """
from helios_core.robot import RobotDriver
class Unfinished(RobotDriver):
    def describe(self): ...
    def state(self): ...
    def capture(self): ...
    def act(self, action, action_id): ...
    def clear_stop(self): ...
class Demanding(Unfinished):
    def __init__(self, serial_port): ...
    def stop(self, reason): ...
class Other: ...
"""


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("own_robot_of_a_test:Unfinished", "lacks the method stop; write every abstract method"),
        ("own_robot_of_a_test:Demanding", "serial_port"),
        ("own_robot_of_a_test:Other", "is the class Other; wanted a class .*RobotDriver"),
        ("own_robot_of_a_test:Missing", "Missing"),
        ("own_robot_with_a_slip:Robot", "SyntaxError"),
        ("no_such_package:Robot", "no_such_package"),
        ("robot", "wanted one of sim, replay, spot, ros2, push, bus or package:Class"),
    ],
)
def test_a_driver_that_cannot_be_created_is_refused_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, said: str
) -> None:
    (tmp_path / "own_robot_of_a_test.py").write_text(SOURCE)
    (tmp_path / "own_robot_with_a_slip.py").write_text("class Robot(")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InvalidInput, match=said):
        load_driver(Settings(driver=name), MemoryBus(MemoryHub()))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"max_depth_m": 0.0}, "max_depth_m 0; wanted a number from 0.001"),
        ({"footprint_radius_m": 300.0}, "footprint_radius_m 300; wanted a number from 0 to 10"),
        ({"height_m": float("nan")}, "height_m nan"),
    ],
)
def test_an_impossible_robot_description_is_refused_before_publication(
    wrong: dict[str, float], said: str
) -> None:
    class Wrong(LineRobot):
        def describe(self) -> RobotDescription:
            return replace(super().describe(), **wrong)

    bus, heard = MemoryBus(MemoryHub()), []
    bus.subscribe(ROBOT_DESCRIPTION, heard.append)
    with pytest.raises(InvalidInput, match=said):
        BridgeService(bus, Wrong(), Settings(), Health())
    assert heard == []


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"color": np.zeros((12, 16, 3))}, r"color is float64 \(12, 16, 3\); give uint8"),
        ({"color": np.zeros((16, 12, 3), np.uint8)}, r"color is uint8 \(16, 12, 3\)"),
        ({"depth_m": np.zeros((12, 16), np.uint16)}, "depth_m is uint16 .* metres"),
        ({"depth_m": np.zeros((24, 32), np.float32)}, r"give float32 \(12, 16\)"),
        ({"T_world_cam": np.eye(3)}, "T_world_cam is no rigid"),
        ({"T_world_base": np.diag([1.0, 1.0, -1.0, 1.0])}, "T_world_base is no rigid"),
        ({"T_world_base": np.diag([1.0, -1.0, -1.0, 1.0])}, "T_world_base leans by 180 degrees"),
        ({"T_world_cam": camera_on_base(np.eye(4), 500.0, 0.5)}, "height of 500.0 m"),
    ],
)
def test_an_invalid_image_is_refused_before_publication(
    wrong: dict[str, np.ndarray], said: str
) -> None:
    class Wrong(LineRobot):
        def capture(self) -> Capture:
            return replace(super().capture(), **wrong)

    stage = Stage(Wrong())
    with pytest.raises(InvalidInput, match=said):
        stage.drive("a")
    assert stage.keyframes == []


def test_a_driver_fault_is_reported_and_the_stream_continues_after_the_fault() -> None:
    class Faulty(LineRobot):
        good = False

        def capture(self) -> Capture:
            if not self.good:
                raise ZeroDivisionError("a slip")
            return super().capture()

    robot, health = Faulty(), Health()
    bridge = BridgeService(MemoryBus(MemoryHub()), robot, Settings(stream_hz=50), health)
    bridge.start()
    try:
        wait_until(lambda: "ZeroDivisionError: a slip" in health.state[1], 60, "the fault is said")
        assert health.state[0] == "degraded"
        robot.good = True
        wait_until(lambda: health.state[0] == "ready", 60, "the stream goes on")
    finally:
        bridge.close()
