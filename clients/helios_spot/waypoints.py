"""Forward and Turn as waypoints on the ground of the vision frame: goals, progress, time limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from helios_core.geometry import Matrix, wrap_angle, yaw_of
from helios_core.robot import Forward, Turn

NEAR_M = 0.05  # a goal within this distance is reached
NEAR_RAD = math.radians(3)
SLACK_S = 5.0  # time to start walking and to settle


@dataclass(frozen=True)
class Waypoint:
    """A pose on the ground; x, y and yaw are the same in the vision frame and the world."""

    x_m: float
    y_m: float
    yaw_rad: float

    @classmethod
    def of(cls, T_world_base: Matrix) -> Waypoint:
        return cls(float(T_world_base[0, 3]), float(T_world_base[1, 3]), yaw_of(T_world_base))


def goal_of(action: Forward | Turn, start: Waypoint) -> Waypoint:
    """The waypoint at which the unobstructed action ends."""
    if isinstance(action, Turn):
        return Waypoint(start.x_m, start.y_m, wrap_angle(start.yaw_rad + action.angle_rad))
    return Waypoint(
        start.x_m + action.distance_m * math.cos(start.yaw_rad),
        start.y_m + action.distance_m * math.sin(start.yaw_rad),
        start.yaw_rad,
    )


def between(a: Waypoint, b: Waypoint) -> tuple[float, float]:
    """(distance in metres, shorter turn in radians, left positive) from a to b."""
    return math.hypot(b.x_m - a.x_m, b.y_m - a.y_m), wrap_angle(b.yaw_rad - a.yaw_rad)


def reached(goal: Waypoint, here: Waypoint) -> bool:
    """True if `here` is within `NEAR_M` and `NEAR_RAD` of the goal."""
    off_m, off_rad = between(here, goal)
    return off_m <= NEAR_M and abs(off_rad) <= NEAR_RAD


def time_allowed_s(start: Waypoint, goal: Waypoint, speed_m_s: float, turn_rad_s: float) -> float:
    """Time limit of the walk in seconds: three times that at full speed, plus `SLACK_S`."""
    far_m, far_rad = between(start, goal)
    return 3.0 * (far_m / speed_m_s + abs(far_rad) / turn_rad_s) + SLACK_S
