"""Check of actions against the limits of a robot."""

from __future__ import annotations

import math

from helios_core.robot import Action, Forward, Pick, Place, Tilt, Turn
from helios_core.types import RobotDescription

_SLACK = 1e-6  # tolerance (m, rad) for floating-point sums of angles and lengths


def limit_violation(action: Action, robot: RobotDescription) -> str:
    """Reason, as one sentence, why the action exceeds the robot's limits; empty if it does not."""
    match action:
        case Forward(distance_m):
            low, back = robot.min_forward_m, distance_m < 0
            high, way = (robot.max_back_m, "back") if back else (robot.max_forward_m, "forward")
            if not low - _SLACK <= abs(distance_m) <= high + _SLACK:
                return f"{way} {abs(distance_m):.3g} m is outside {low:g} to {high:g} m"
        case Turn(angle_rad):
            low, high = robot.min_turn_rad, robot.max_turn_rad
            if not low - _SLACK <= abs(angle_rad) <= high + _SLACK:
                return (
                    f"turn {math.degrees(angle_rad):.3g}° is outside {math.degrees(low):g}° to "
                    f"{math.degrees(high):g}° to either side"
                )
        case Tilt(angle_rad):
            low, high = robot.tilt_range_rad
            if not low - _SLACK <= angle_rad <= high + _SLACK:
                return f"tilt {angle_rad:.3g} rad is outside {low:g} to {high:g} rad"
        case Pick(point, _) | Place(point):
            if not all(map(math.isfinite, point)):
                return f"the point {tuple(map(float, point))} is nowhere; give three finite numbers"
        case _:
            pass
    return ""
