"""Turning on the spot, pointing the head, and the looks around that both make up."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from helios_core.geometry import wrap_angle
from helios_core.robot import Observe, Tilt, Turn
from helios_core.types import RobotDescription

from helios_planner.ground.grid import GroundMap, Pose2
from helios_planner.ground.motion import MotionRules
from helios_planner.moving.mishaps import Mishaps
from helios_planner.robot.body import Body
from helios_planner.settings import Settings


class OnTheSpot:
    """Turns a Body where it stands, and looks."""

    def __init__(self, body: Body, settings: Settings) -> None:
        robot = body.description
        self.body, self.settings = body, settings
        self.rules = MotionRules(
            footprint_m=robot.footprint_radius_m,
            margin_m=settings.margins_m[0],
            saturation_m=settings.saturation_m,
            speck_m2=settings.speck_m2,
            min_forward_m=robot.min_forward_m,
            max_forward_m=robot.max_forward_m,
            min_turn_rad=robot.min_turn_rad,
            max_turn_rad=robot.max_turn_rad,
        )
        self.mishaps = Mishaps(body)

    def turn_to(self, yaw_rad: float) -> None:
        """Turn on the spot until the heading is within the smallest turn."""
        for _ in range(16):
            error = wrap_angle(yaw_rad - self.body.pose().yaw_rad)
            if abs(error) < self.rules.min_turn_rad:
                return
            most = self.rules.max_turn_rad
            if not self._turn(float(np.clip(error, -most, most))):
                return

    def _turn(self, angle_rad: float) -> bool:
        """Turn on the spot; False when that would touch something."""
        self.mishaps.act(Turn(angle_rad))
        return True

    def tilt(self, tilt_rad: float) -> bool:
        """Point the head; whether that took an action."""
        low, high = self.body.description.tilt_range_rad
        wanted = float(np.clip(tilt_rad, low, high))
        if abs(wanted - self.body.tilt_rad()) < math.radians(2):
            return False
        self.mishaps.act(Tilt(wanted))
        return True

    def look_around(self) -> None:
        """A full turn; the ground next to the robot is looked at on the way."""
        self._full_turn(down_only=False)

    def turn_around(self, stop: Callable[[], bool]) -> None:
        """A full turn with the head as while driving, until `stop`."""
        turns = math.ceil(2 * math.pi / self.rules.max_turn_rad - 1e-6)
        for _ in range(turns):
            if stop() or not self._turn(2 * math.pi / turns):
                return

    def look_down_around(self) -> bool:
        """Look at the ground next to the robot, all around; False when it is known already."""
        if not near_ground_unknown(self.body.ground(), self.body.pose(), self.rules.footprint_m):
            return False
        self._full_turn(down_only=True)
        self.tilt(self.settings.travel_tilt_rad)
        return True

    def _full_turn(self, down_only: bool) -> None:
        robot = self.body.description
        turns = math.ceil(2 * math.pi / self.rules.max_turn_rad - 1e-6)
        step = 2 * math.pi / turns
        apart = max(1, int(0.85 * robot.camera.hfov_rad / step))  # turns between two looks down
        travel, down = self.settings.travel_tilt_rad, down_tilt_rad(robot)
        both = not down_only and down > travel + math.radians(5)
        if not self.tilt(down if down_only else travel):
            self.mishaps.act(Observe())
        for k in range(turns):
            if both and k % apart == 0:
                self.tilt(down)
                self.tilt(travel)
            if not self._turn(step):
                return


def down_tilt_rad(robot: RobotDescription) -> float:
    """Tilt at which the ground at the rim is at the image's lower edge."""
    # A little within the rim: the image's lower edge is straight, the rim is round.
    rim_m = 0.8 * robot.footprint_radius_m - robot.camera_forward_m
    rim = math.atan2(robot.camera_height_m, rim_m)
    return float(np.clip(rim - robot.camera.vfov_rad / 2, *robot.tilt_range_rad))


def near_ground_unknown(ground: GroundMap, pose: Pose2, footprint_m: float) -> bool:
    """Whether more than 2 % of the ground up to 0.7 m beyond a robot's rim was never seen."""
    reach_m = footprint_m + 0.7
    ground = ground.padded(pose.x_m, pose.y_m, reach_m + 0.1)
    row, column = ground.cells_of(np.array([pose.xy]))[0]
    n = int(reach_m / ground.cell_m)
    part = ground.occupancy[row - n : row + n + 1, column - n : column + n + 1]
    return bool((part < 0).mean() > 0.02)
