"""Check of a requested move against the robot's limits."""

from __future__ import annotations

from helios_core.errors import InvalidInput

from helios_gateway.api_models import RobotDescription
from helios_gateway.teleop.messages import MOST_M, MOST_RAD, DriveRequest

_SLACK = 1e-6  # tolerance for floating-point sums


def check_move(asked: DriveRequest, robot: RobotDescription) -> None:
    """Raise InvalidInput for a move outside the robot's own limits."""
    if asked.turn_rad:
        name, value, unit = "turn_rad", asked.turn_rad, "rad"
        low, high = robot.min_turn_rad, min(MOST_RAD, robot.max_turn_rad or 0.0)
    else:
        name, value, unit = "forward_m", asked.forward_m, "m"
        longest_m = robot.max_forward_m if value > 0 else robot.max_back_m
        low, high = robot.min_forward_m, min(MOST_M, longest_m or 0.0)
    low = low or 0.0
    if high <= 0:
        way = "turns on the spot" if asked.turn_rad else "drives back" if value < 0 else "drives"
        raise InvalidInput(f"{name} is {value:g}; this robot never {way}: ask for another move")
    if not low - _SLACK <= abs(value) <= high + _SLACK:
        raise InvalidInput(
            f"{name} is {value:g}; this robot makes moves of {low:g} to {high:g} {unit} at a time"
        )
