"""Test rig: a bridge on a MemoryBus with a fake robot, and a client that drives it."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings
from helios_core import proto as pb
from helios_core.geometry import Pinhole, camera_on_base, se2_to_se3
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import (
    Action,
    ActionResult,
    Capture,
    EndOfRecording,
    Forward,
    RobotDriver,
)
from helios_core.topics import ACT, KEYFRAME, LEASE
from helios_core.types import RobotDescription, RobotState

CAMERA = Pinhole(8.0, 8.0, 8.0, 6.0, 16, 12)


class LineRobot(RobotDriver):
    """Drives along x. With `frames` it is a recording of that many frames."""

    def __init__(self, frames: int | None = None) -> None:
        self.x_m = 0.0
        self.done: list[Action] = []
        self.stopped = ""
        self.hold = threading.Event()
        self.hold.set()
        self.left = frames

    def describe(self) -> RobotDescription:
        movable = self.left is None
        return RobotDescription("line", 0.3, 1.0, CAMERA, 1.0, 0.8, 5.0, can_move=movable)

    def state(self) -> RobotState:
        return RobotState(se2_to_se3(self.x_m, 0, 0), stopped=bool(self.stopped))

    def capture(self) -> Capture:
        if self.left is not None:
            if self.left == 0:
                raise EndOfRecording
            self.left -= 1
        base = se2_to_se3(self.x_m, 0, 0)
        return Capture(
            stamp_ns=len(self.done) + 1,
            color=np.zeros((12, 16, 3), np.uint8),
            depth_m=np.full((12, 16), 1.5, np.float32),
            camera=CAMERA,
            T_world_cam=camera_on_base(base, 1.0, 0.5),
            T_world_base=base,
        )

    def act(self, action: Action, action_id: str) -> ActionResult:
        self.done.append(action)
        self.hold.wait(5)
        if self.stopped:
            return ActionResult(False, self.stopped)
        if isinstance(action, Forward):
            self.x_m += action.distance_m
        return ActionResult(True, moved_m=self.x_m, steps=len(self.done))

    def stop(self, reason: str) -> None:
        self.stopped = reason
        self.hold.set()

    def clear_stop(self) -> None:
        self.stopped = ""


class Stage:
    """A bridge with its robot, and a client that drives it."""

    def __init__(self, robot: LineRobot | None = None, **settings: Any) -> None:
        hub = MemoryHub()
        self.robot = robot or LineRobot()
        self.bus, self.other = MemoryBus(hub), MemoryBus(hub)
        self.health = Health()
        values: dict[str, Any] = {"stream_hz": 0.0, **settings}
        self.bridge = BridgeService(self.bus, self.robot, Settings(**values), self.health, 0)
        self.keyframes: list[pb.Frame] = []
        self.other.subscribe(KEYFRAME, self.keyframes.append)
        self.token = 0

    def drive(
        self,
        action_id: str,
        distance_m: float = 0.5,
        left_s: float = 5,
        no_keyframe: bool = False,
        action: pb.Action | None = None,
    ) -> pb.ActionResult:
        """Drive ahead, or do another action."""
        if not self.token:
            self.token = self.other.call(LEASE, pb.LeaseRequest(holder="planner"), 1).token
        request = pb.ActionRequest(
            action_id=action_id,
            lease_token=self.token,
            time_remaining_s=left_s,
            action=action or pb.Action(forward=pb.Action.Forward(distance_m=distance_m)),
            no_keyframe=no_keyframe,
        )
        return self.other.call(ACT, request, 10)
