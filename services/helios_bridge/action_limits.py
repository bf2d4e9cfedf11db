"""Check of actions against the longest move and turn in the robot's description.

The planner and the gateway keep these limits themselves. The bridge is the last process before the
driver, so it keeps them for every client of the bus.
"""

from __future__ import annotations

import math

from helios_core.errors import InvalidInput
from helios_core.robot import Action, Forward, Turn
from helios_core.types import RobotDescription

SLACK = 1e-6  # tolerance (m, rad) for sums of floating-point numbers


def check_limits(action: Action, robot: RobotDescription) -> None:
    """Raise InvalidInput if the action moves or turns farther than the robot's description says."""
    match action:
        case Forward(distance_m) if distance_m > robot.max_forward_m + SLACK:
            raise InvalidInput(
                f"forward.distance_m is {distance_m:.4g}; the robot {robot.name!r} takes at most "
                f"{robot.max_forward_m:g} (max_forward_m); send several moves"
            )
        case Forward(distance_m) if distance_m < -robot.max_back_m - SLACK:
            raise InvalidInput(
                f"forward.distance_m is {distance_m:.4g}; the robot {robot.name!r} moves back by "
                f"at most {robot.max_back_m:g} m (max_back_m); turn it round instead"
            )
        case Turn(angle_rad) if abs(angle_rad) > robot.max_turn_rad + SLACK:
            raise InvalidInput(
                f"turn.angle_rad is {angle_rad:.4g}; the robot {robot.name!r} turns by at most "
                f"{robot.max_turn_rad:.4g} (max_turn_rad, {math.degrees(robot.max_turn_rad):.3g}°) "
                "to either side; send several turns"
            )
        case _:
            pass
