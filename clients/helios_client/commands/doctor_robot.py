"""`helios doctor --robot`: moves the robot a little and shows the checks of its set-up."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from helios_core.errors import Unavailable
from helios_core.robot import Action, Forward, Turn
from helios_core.robot_checks.finding import shown
from helios_core.robot_checks.routine import MoveLimits, moves
from rich.markup import escape
from rich.table import Table

from helios_client.answer_types import DriveAnswer, RobotCheck, RobotChecks
from helios_client.sdk import Helios
from helios_client.terminal_output import plain_table

_COLORS = {"ok": "green", "wrong": "red"}


def check_robot(
    helios: Helios, drive: bool, tell: Callable[[str], None]
) -> tuple[RobotChecks, str]:
    """Results after the motion of the routine, and why it ended early; empty if it did not.

    The robot turns once on the spot; with `drive` it also drives a little. A robot that cannot move
    or turn keeps its results so far. Raises HeliosError.
    """
    limits = _limits(helios)
    if not limits.can_move or limits.lacks_turns:
        lacks = "turns" if limits.can_move else "motion"
        tell(f"this robot offers no {lacks}: these are the checks of the images so far")
        return helios.robot_checks(), ""
    drives = " and drives to and fro where it sees free floor" if drive else ""
    tell(f"the robot turns once on the spot{drives}; keep clear, helios stop stops it")
    found, routine = helios.robot_checks(restart=True), moves(limits, drive)
    action = next(routine, None)
    while action is not None:
        done = _move(helios, action)
        found = helios.robot_checks()
        if not done["succeeded"]:
            return found, done["reason"] or "the robot did not finish a move"
        try:
            action = routine.send(found["free_ahead_m"])
        except StopIteration:
            action = None
    return found, ""


def is_wrong(found: RobotChecks) -> bool:
    """True if a check found something wrong."""
    return any(check["verdict"] == "wrong" for check in found["checks"])


def as_json(found: RobotChecks, ended_early: str) -> dict[str, Any]:
    """Value of `--json`."""
    return {
        "wrong": is_wrong(found),
        "images": found["images"],
        "ended_early": ended_early,
        "checks": found["checks"],
    }


def checks_table(found: RobotChecks) -> Table:
    """Table with one row per check."""
    out = plain_table("check", "verdict", "measured", "right up to", "in words")
    for check in found["checks"]:
        color = _COLORS.get(check["verdict"], "yellow")
        out.add_row(
            check["name"],
            f"[{color}]{check['verdict']}[/]",
            _measured(check),
            shown(check["limit"], check["unit"]),
            escape(check["words"]),
        )
    return out


def _measured(check: RobotCheck) -> str:
    if check["value"] is None or check["error"] is None:
        return "-"
    return shown(check["value"], check["unit"], check["error"])


def _move(helios: Helios, action: Action) -> DriveAnswer:
    match action:
        case Turn(angle_rad):
            return helios.drive(turn_rad=angle_rad)
        case Forward(distance_m):
            return helios.drive(forward_m=distance_m)
        case _:
            raise AssertionError(f"the routine has no {action}")


def _limits(helios: Helios) -> MoveLimits:
    described = helios.robot()["description"]
    if described is None:
        raise Unavailable("the bridge has not described the robot yet; see helios status")
    known = {name: described.get(name) for name in MoveLimits.__dataclass_fields__}
    return MoveLimits(**{name: value for name, value in known.items() if value is not None})
