"""Faults of a robot's set-up, injected into the simulated robot on purpose.

`FaultyRobot` wraps a driver and falsifies what it reports: poses, depth, colour, intrinsics, times.
The robot and the world behind it stay as they are.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix, Pinhole, invert, se2_to_se3, yaw_of
from helios_core.robot import Action, ActionResult, Capture, Pick, Place, RobotDriver
from helios_core.types import RobotDescription, RobotState


@dataclass(frozen=True)
class Faults:
    """Sizes of the injected faults; 0: none."""

    pitch_deg: float = 0.0  # the camera looks further down than its pose says
    roll_deg: float = 0.0  # it leans further to the right than its pose says
    height_m: float = 0.0  # it is higher than its pose says
    depth_percent: float = 0.0  # depth reads too long
    delay_ms: float = 0.0  # images are older than their poses
    shift_px: float = 0.0  # the colour image lies to the right of the depth image
    turn_percent: float = 0.0  # the poses turn too far
    drive_percent: float = 0.0  # the poses drive too far
    intrinsics_percent: float = 0.0  # the intrinsics are of an image larger by this

    @classmethod
    def of(cls, text: str) -> Faults:
        """Faults from text such as "pitch_deg=2,delay_ms=40". Raises InvalidInput."""
        known = [field.name for field in fields(cls)]
        out: dict[str, float] = {}
        for part in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = part.partition("=")
            try:
                size = float(value)
            except ValueError:
                size = math.nan
            if name not in known or not math.isfinite(size):
                raise InvalidInput(
                    f"{part!r} is no fault; wanted NAME=SIZE with a name of {', '.join(known)}"
                )
            out[name] = size
        return cls(**out)

    def __str__(self) -> str:
        sizes = {field.name: getattr(self, field.name) for field in fields(self)}
        return ",".join(f"{name}={size:g}" for name, size in sizes.items() if size)


class FaultyRobot(RobotDriver):
    """Driver whose reports have injected faults. As thread-safe as the driver that it wraps."""

    def __init__(self, robot: RobotDriver, faults: Faults) -> None:
        self._robot, self._faults = robot, faults
        self._lock = threading.Lock()
        self._true: Matrix | None = None  # T_world_base of the wrapped driver, when last read
        self._claimed = np.eye(4)

    def describe(self) -> RobotDescription:
        described = self._robot.describe()
        return replace(described, camera=self._camera(described.camera))

    def state(self) -> RobotState:
        state = self._robot.state()
        return replace(state, T_world_base=self._claimed_base(state.T_world_base))

    def capture(self) -> Capture:
        return self._falsified(self._robot.capture())

    def act(self, action: Action, action_id: str) -> ActionResult:
        return self._robot.act(self._believed(action), action_id)

    def act_and_watch(
        self, action: Action, action_id: str, hz: float
    ) -> tuple[ActionResult, tuple[Capture, ...]]:
        result, seen = self._robot.act_and_watch(self._believed(action), action_id, hz)
        return result, self._delayed([self._falsified(capture) for capture in seen])

    def stop(self, reason: str) -> None:
        self._robot.stop(reason)

    def clear_stop(self) -> None:
        self._robot.clear_stop()

    def close(self) -> None:
        self._robot.close()

    # --- faults -------------------------------------------------------------------------------
    def _claimed_base(self, T_world_base: Matrix) -> Matrix:
        """Pose that the robot claims: each motion since the last call is exaggerated."""
        f = self._faults
        if not (f.turn_percent or f.drive_percent):
            return T_world_base
        with self._lock:
            if self._true is None:
                self._true = self._claimed = T_world_base
            motion = invert(self._true) @ T_world_base
            longer = 1.0 + f.drive_percent / 100.0
            turned = yaw_of(motion) * (1.0 + f.turn_percent / 100.0)
            x_m, y_m = motion[0, 3] * longer, motion[1, 3] * longer
            self._claimed = self._claimed @ se2_to_se3(x_m, y_m, turned)
            self._true = T_world_base
            return self._claimed

    def _believed(self, action: Action) -> Action:
        """The action with its point in the world of the wrapped driver."""
        if not isinstance(action, Pick | Place):
            return action
        true = self._robot.state().T_world_base
        T_true_claimed = true @ invert(self._claimed_base(true))
        x, y, z = T_true_claimed[:3, :3] @ action.point_world_m + T_true_claimed[:3, 3]
        return replace(action, point_world_m=(float(x), float(y), float(z)))

    def _falsified(self, capture: Capture) -> Capture:
        f = self._faults
        T_base_cam = invert(capture.T_world_base) @ capture.T_world_cam
        T_base_cam[2, 3] -= f.height_m
        pitch, roll = math.radians(f.pitch_deg), math.radians(f.roll_deg)
        back = cv2.Rodrigues(np.array([0.0, -pitch, 0.0]))[0]
        back = back @ cv2.Rodrigues(np.array([-roll, 0.0, 0.0]))[0]
        T_base_cam[:3, :3] = back @ T_base_cam[:3, :3]
        T_world_base = self._claimed_base(capture.T_world_base)
        color = capture.color
        if f.shift_px:
            moved = np.array([[1.0, 0.0, f.shift_px], [0.0, 1.0, 0.0]])
            size = (capture.camera.width, capture.camera.height)
            color = cv2.warpAffine(color, moved, size, borderMode=cv2.BORDER_REPLICATE)
        return replace(
            capture,
            color=color.astype(np.uint8, copy=False),
            depth_m=capture.depth_m * np.float32(1.0 + f.depth_percent / 100.0),
            camera=self._camera(capture.camera),
            T_world_base=T_world_base,
            T_world_cam=T_world_base @ T_base_cam,
        )

    def _camera(self, camera: Pinhole) -> Pinhole:
        k = 1.0 + self._faults.intrinsics_percent / 100.0
        return replace(
            camera,
            fx=k * camera.fx,
            fy=k * camera.fy,
            cx=k * (camera.cx + 0.5) - 0.5,
            cy=k * (camera.cy + 0.5) - 0.5,
        )

    def _delayed(self, seen: Sequence[Capture]) -> tuple[Capture, ...]:
        """Captures with the poses of `delay_ms` later."""
        delay_ns = round(self._faults.delay_ms * 1e6)
        if not delay_ns or len(seen) < 2:
            return tuple(seen)
        stamps = np.array([capture.stamp_ns for capture in seen], float)
        poses = np.array([[*c.T_world_base[:2, 3], yaw_of(c.T_world_base)] for c in seen], float)
        poses[:, 2] = np.unwrap(poses[:, 2])
        out = []
        for capture in seen:
            later = capture.stamp_ns + delay_ns
            T_world_base = se2_to_se3(*(float(np.interp(later, stamps, p)) for p in poses.T))
            T_base_cam = invert(capture.T_world_base) @ capture.T_world_cam
            out.append(
                replace(
                    capture,
                    stamp_ns=later,
                    T_world_base=T_world_base,
                    T_world_cam=T_world_base @ T_base_cam,
                )
            )
        return tuple(out)
