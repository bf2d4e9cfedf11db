"""Complete driver: `helios up --robot helios_examples.room_robot:RoomRobot --detector paint`

It needs no hardware: `room.py` replaces motors and camera. Nothing slips there.
"""

import math
import threading
import time

from helios_core.geometry import Pinhole, camera_on_base, se2_to_se3, wrap_angle
from helios_core.robot import ActionResult, Capture, Forward, Observe, RobotDriver, Tilt, Turn
from helios_core.types import RobotDescription, RobotState

from helios_examples.room import fits, look

CAMERA = Pinhole(fx=140, fy=140, cx=79.5, cy=59.5, width=160, height=120)
ROBOT = RobotDescription(
    name="room robot", footprint_radius_m=0.25, height_m=1.3, camera=CAMERA, camera_height_m=1.2,
    max_depth_m=5.0, tilt_range_rad=(-0.3, 1.0), reach_m=0.0, can_pick=False, can_place=False,
)  # fmt: skip
STEP_M, STEP_RAD, STEP_S = 0.01, 0.02, 0.01  # 1 m/s, 2 rad/s


class RoomRobot(RobotDriver):
    def __init__(self) -> None:
        self._x_m, self._y_m, self._yaw_rad, self._tilt_rad = 0.0, 0.0, 0.0, 0.4
        self._stopped, self._why = threading.Event(), ""
        self._results: dict[str, ActionResult] = {}

    def describe(self) -> RobotDescription:
        return ROBOT

    def state(self) -> RobotState:
        base = se2_to_se3(self._x_m, self._y_m, self._yaw_rad)  # the same origin at every start
        return RobotState(base, self._tilt_rad, stopped=self._stopped.is_set(), origin_id="room")

    def capture(self) -> Capture:
        T_world_base = self.state().T_world_base
        T_world_cam = camera_on_base(T_world_base, ROBOT.camera_height_m, self._tilt_rad)
        color, depth_m = look(CAMERA, T_world_cam)
        return Capture(time.time_ns(), color, depth_m, CAMERA, T_world_cam, T_world_base)

    def act(self, action, action_id: str) -> ActionResult:
        if action_id not in self._results:  # each id is executed once
            x_m, y_m, yaw_rad = self._x_m, self._y_m, self._yaw_rad
            why_not = self._why if self._stopped.is_set() else self._do(action)
            moved_m = math.hypot(self._x_m - x_m, self._y_m - y_m)  # measured, not as requested
            turned_rad, steps = wrap_angle(self._yaw_rad - yaw_rad), len(self._results) + 1
            done = ActionResult(not why_not, why_not, moved_m, turned_rad, steps=steps)
            self._results[action_id] = done
        return self._results[action_id]

    def stop(self, reason: str) -> None:  # may come while `act` runs
        self._why = f"stopped: {reason}; clear the stop first"
        self._stopped.set()

    def clear_stop(self) -> None:
        self._stopped.clear()

    def _do(self, action) -> str:
        """Execute an action. Returns the reason of a failure, "" on success."""
        if isinstance(action, Forward) and action.distance_m >= 0:
            return self._move(action.distance_m, 0.0)
        if isinstance(action, Turn):
            return self._move(0.0, action.angle_rad)
        if isinstance(action, Tilt):
            self._tilt_rad = min(max(action.angle_rad, -0.3), 1.0)
        return "" if isinstance(action, Tilt | Observe) else f"this robot cannot do {action}"

    def _move(self, ahead_m: float, left_rad: float) -> str:
        steps = math.ceil(max(abs(ahead_m) / STEP_M, abs(left_rad) / STEP_RAD, 1))
        for _ in range(steps):
            if self._stopped.wait(STEP_S):
                return self._why
            x_m, y_m = self.state().T_world_base[:2] @ (ahead_m / steps, 0, 0, 1)
            if not fits(x_m, y_m, ROBOT.footprint_radius_m):
                return "blocked; look, and go another way"
            yaw_rad = wrap_angle(self._yaw_rad + left_rad / steps)
            self._x_m, self._y_m, self._yaw_rad = x_m, y_m, yaw_rad
        return ""
