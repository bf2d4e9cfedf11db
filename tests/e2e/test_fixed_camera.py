"""Tests a task on a robot with a fixed camera that does not see the floor near the robot."""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from pathlib import Path

from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings as BridgeSettings
from helios_core import proto as pb
from helios_core.geometry import Pinhole, camera_on_base
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Action, ActionResult, Capture
from helios_core.topics import GET_TASK, SUBMIT, TASK
from helios_core.types import RobotDescription
from helios_detector.model_loading import open_scorer
from helios_detector.service import DetectorService
from helios_examples.paint_detector import PaintDetector
from helios_examples.room import look
from helios_examples.room_robot import ROBOT, RoomRobot
from helios_map2d.service import Map2DService
from helios_map2d.settings import Settings as Map2DSettings
from helios_objectmap.service import ObjectMapService
from helios_objectmap.settings import ObjectMapSettings
from helios_planner.motion_planning.costmap import blind_m
from helios_planner.service import PlannerService
from helios_planner.settings import Settings as PlannerSettings

WIDE = Pinhole(fx=100, fy=100, cx=79.5, cy=59.5, width=160, height=120)
LEVEL = replace(ROBOT, camera=WIDE, camera_height_m=0.5, tilt_range_rad=(0.0, 0.0))


class LevelRobot(RoomRobot):
    """The example robot with a camera 0.5 m above the floor that looks straight ahead."""

    def describe(self) -> RobotDescription:
        return LEVEL

    def capture(self) -> Capture:
        self._tilt_rad = 0.0
        base = super().capture()
        T_world_cam = camera_on_base(base.T_world_base, LEVEL.camera_height_m, 0.0)
        color, depth_m = look(WIDE, T_world_cam)
        return replace(base, color=color, depth_m=depth_m, camera=WIDE, T_world_cam=T_world_cam)

    def act(self, action: Action, action_id: str) -> ActionResult:
        result = super().act(action, action_id)
        self.blocked = getattr(self, "blocked", 0) + result.reason.startswith("blocked")
        return result


def test_a_robot_with_a_fixed_level_camera_leaves_its_start_and_finds_the_target(
    tmp_path: Path,
) -> None:
    assert blind_m(LEVEL) > LEVEL.footprint_radius_m + 0.5
    hub, ended, robot = MemoryHub(), threading.Event(), LevelRobot()
    bus = MemoryBus(hub)
    bus.subscribe(TASK, lambda t: ended.set() if t.state in ("succeeded", "failed") else None)
    map2d = Map2DService(MemoryBus(hub), Map2DSettings.load([]), Health())
    objects = ObjectMapService(MemoryBus(hub), ObjectMapSettings(agent="helios-paper"), Health())
    objects.warm_up()
    detector = DetectorService(MemoryBus(hub), PaintDetector(), open_scorer("lexical"), Health())
    settings = BridgeSettings(stream_hz=0, lockstep=True)
    bridge = BridgeService(MemoryBus(hub), robot, settings, Health())
    planner = PlannerService(
        MemoryBus(hub), PlannerSettings(agent="helios-paper", state_dir=tmp_path), Health()
    )
    try:
        id = bus.call(SUBMIT, pb.SubmitRequest(instruction="find the shelf"), 30).id
        assert ended.wait(120), "the task did not end"
        task = bus.call(GET_TASK, pb.TaskRequest(id=id), 10)
        assert task.state == "succeeded", task.message
        x_m, y_m = robot.state().T_world_base[:2, 3]
        assert math.hypot(x_m, y_m) > 0.5  # it started at the origin
        assert robot.blocked == 0
    finally:
        for service in (planner, detector, bridge, objects, map2d):
            service.close()
