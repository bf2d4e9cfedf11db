"""Complete driver with an arm. Run it with
`helios up --robot helios_examples.arm_robot:ArmRobot --detector paint`.

Base and camera are those of `room_robot.py`. The arm is computed: it picks the box if it is in
reach, shows it to the camera, and puts it down.
"""

import time
from dataclasses import replace

import numpy as np
from helios_core.geometry import camera_on_base
from helios_core.robot import Capture, Forward, Pick, Place, Show, Turn
from helios_core.types import RobotDescription, RobotState

from helios_examples.room import THINGS, look
from helios_examples.room_robot import CAMERA, ROBOT, RoomRobot

SHOW_BASE_M = (0.6, 0.0, 0.9)  # in front of the camera
ARM = replace(
    ROBOT, name="arm robot", reach_m=0.9, can_pick=True, can_place=True, show_base_m=SHOW_BASE_M
)
TABLE, (BOX_M, RED), (SHELF_M, GREEN) = THINGS
FURNITURE = (TABLE, (np.minimum(SHELF_M, (9.0, 9.0, 0.8)), GREEN))  # the camera sees both tops
SIZE_M = BOX_M[1] - BOX_M[0]
GRASP_M = 0.1  # greatest distance between the point of a Pick and the box
ARM_S = 0.2  # duration of each motion of the arm


class ArmRobot(RoomRobot):
    def __init__(self) -> None:
        super().__init__()
        self._box_m = BOX_M.mean(0)  # centre in the world, while nobody holds it
        self._held, self._shown = "", False

    def describe(self) -> RobotDescription:
        return ARM

    def state(self) -> RobotState:
        return replace(super().state(), held=self._held)

    def capture(self) -> Capture:
        T_world_base = self.state().T_world_base
        T_world_cam = camera_on_base(T_world_base, ARM.camera_height_m, self._tilt_rad)
        box_m = (T_world_base @ (*SHOW_BASE_M, 1))[:3] if self._shown else self._box_m
        box = (np.array([box_m - SIZE_M / 2, box_m + SIZE_M / 2]), RED)
        hidden = self._held and not self._shown  # the arm carries it out of view
        color, depth_m = look(CAMERA, T_world_cam, FURNITURE if hidden else (*FURNITURE, box))
        return Capture(time.time_ns(), color, depth_m, CAMERA, T_world_cam, T_world_base)

    def _do(self, action) -> str:
        if isinstance(action, Forward | Turn | Place):
            self._shown = False
        if not isinstance(action, Pick | Place | Show):
            return super()._do(action)
        if self._stopped.wait(ARM_S):
            return self._why
        if isinstance(action, Pick):
            return self._pick(np.array(action.point_world_m), action.class_name)
        if not self._held:
            return "the gripper is empty; pick something first"
        if isinstance(action, Place):
            return self._place(np.array(action.point_world_m))
        self._shown = True  # all sides of the box look alike, so its turn changes nothing
        return ""

    def _pick(self, point_m, class_name: str) -> str:
        if self._held:
            return f"the gripper holds a {self._held}; place it first"
        if why_not := self._out_of_reach(point_m):
            return why_not
        if np.linalg.norm(self._box_m - point_m) > GRASP_M:
            return "the gripper closed and holds nothing"
        self._held = class_name  # the name that HELIOS gave it
        return ""

    def _place(self, point_m) -> str:
        if why_not := self._out_of_reach(point_m):
            return why_not
        below_m = [
            corners_m[1, 2]
            for corners_m, _ in FURNITURE
            if (corners_m[0, :2] < point_m[:2]).all() and (corners_m[1, :2] > point_m[:2]).all()
        ]
        self._box_m = np.array([*point_m[:2], max(below_m, default=0.0) + SIZE_M[2] / 2])
        self._held = ""
        return ""

    def _out_of_reach(self, point_m) -> str:
        """Why the arm does not reach a point; "" if it does."""
        away_m = np.linalg.norm(point_m[:2] - self.state().T_world_base[:2, 3])
        if away_m <= ARM.reach_m:
            return ""
        return f"the point is {away_m:.2f} m away; the arm reaches {ARM.reach_m} m"
