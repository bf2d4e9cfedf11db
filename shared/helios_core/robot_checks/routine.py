"""Motion that shows a robot's set-up: one turn on the spot, and a short drive if it is allowed."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from helios_core.geometry import lift_pixels
from helios_core.robot import Action, Capture, Forward, Turn
from helios_core.types import RobotDescription

TURN_RAD = math.radians(30)
LEAST_TURN_RAD = math.radians(1)  # a robot that turns less far at a time has no turns
DRIVE_M, DRIVES, LONGEST = 0.3, 8, 4  # one drive; drives in all, and one after another
MARGIN_M = 0.35  # beyond the footprint, left free at the end of a drive
LOW_M = 0.06  # lower points are floor
BESIDE_M = 0.08  # beside the footprint, to either side

Moves = Generator[Action, float, None]


@dataclass(frozen=True)
class MoveLimits:
    """Properties of a `RobotDescription` that the routine needs."""

    can_move: bool = True
    max_turn_rad: float = TURN_RAD
    min_forward_m: float = 0.0
    max_forward_m: float = DRIVE_M

    @classmethod
    def of(cls, robot: RobotDescription) -> MoveLimits:
        return cls(robot.can_move, robot.max_turn_rad, robot.min_forward_m, robot.max_forward_m)

    @property
    def lacks_turns(self) -> bool:
        """True for a robot that moves but offers no turns. The routine has no motion for it."""
        return self.can_move and not self.max_turn_rad >= LEAST_TURN_RAD


def moves(robot: MoveLimits, drive: bool) -> Moves:
    """Actions of the routine. Send the free distance ahead (m) after each action.

    A full turn to the left; then, with `drive`, a turn to where most room is, and short drives
    there and back, as far as there is room. Nothing if the robot does not move or lacks turns.
    """
    if not robot.can_move or robot.lacks_turns:
        return
    step = min(TURN_RAD, robot.max_turn_rad)
    turns = math.ceil(2 * math.pi / step - 1e-6)
    step = 2 * math.pi / turns
    room_m = []
    for _ in range(turns):
        room_m.append((yield Turn(step)))
    if not drive:
        return
    best = int(np.argmax(room_m)) + 1  # turns after which it looks there
    left = best <= turns // 2
    for _ in range(best if left else turns - best):
        room_m.append((yield Turn(step if left else -step)))
    yield from _drives(robot, step, room_m[-1])


def _drives(robot: MoveLimits, step_rad: float, ahead_m: float) -> Moves:
    """Drives away from the start and back, until there are `DRIVES` or no room is left."""
    each_m = min(max(DRIVE_M, robot.min_forward_m), robot.max_forward_m)
    left = DRIVES
    while left:
        driven = 0
        while driven < LONGEST and left and ahead_m > each_m + MARGIN_M:
            ahead_m = yield Forward(each_m)
            driven, left = driven + 1, left - 1
        if not driven:
            return
        if left:
            for _ in range(round(math.pi / step_rad)):
                ahead_m = yield Turn(step_rad)


def free_ahead_m(capture: Capture, robot: RobotDescription) -> float:
    """Free distance in front of the footprint, as far as the image shows it, m.

    0 if the image shows no floor or obstacle ahead.
    """
    small = capture.depth_m[::4, ::4]
    c = capture.camera
    camera = type(c)(c.fx / 4, c.fy / 4, c.cx / 4, c.cy / 4, small.shape[1], small.shape[0])
    points = lift_pixels(small, camera, capture.T_world_cam).reshape(-1, 3)
    points = points[np.isfinite(points).all(1)]
    from_base = (points - capture.T_world_base[:3, 3]) @ capture.T_world_base[:3, :3]
    half_m = robot.inner_radius_m + BESIDE_M
    front_m = robot.footprint_radius_m
    lane = from_base[(np.abs(from_base[:, 1]) < half_m) & (from_base[:, 0] > front_m)]
    if len(lane) < 50:
        return 0.0
    high = lane[(lane[:, 2] > LOW_M) & (lane[:, 2] < robot.height_m)]
    end_m = float(np.quantile(high[:, 0], 0.01)) if len(high) >= 20 else float(lane[:, 0].max())
    return max(0.0, end_m - front_m)
