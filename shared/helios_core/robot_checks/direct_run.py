"""The routine and its checks with a driver at hand, without bridge and bus."""

from __future__ import annotations

import uuid
from collections.abc import Callable

from helios_core.robot import ActionResult, RobotDriver, Turn
from helios_core.robot_checks.checks import RobotChecks
from helios_core.robot_checks.finding import Finding
from helios_core.robot_checks.routine import MoveLimits, free_ahead_m, moves

WATCH_HZ = 12.0  # images per second while the robot turns
WATCHED_TURNS = 4


def check_driver(
    driver: RobotDriver,
    drive: bool,
    stopped: Callable[[ActionResult], None] | None = None,
    each: Callable[[RobotChecks], None] | None = None,
) -> tuple[Finding, ...]:
    """Findings after the routine of `routine.moves`: THE ROBOT MOVES.

    stopped: called with the result of a failed action, which ends the routine. each: called after
    each image at rest. Raises HeliosError.
    """
    robot = driver.describe()
    limits = MoveLimits.of(robot)
    checks = RobotChecks(robot.camera, limits.lacks_turns)
    capture = driver.capture()
    checks.add(capture)
    routine, watched = moves(limits, drive), 0
    action = next(routine, None)
    while action is not None:
        if isinstance(action, Turn) and watched < WATCHED_TURNS:
            watched += 1
            result, seen = driver.act_and_watch(action, uuid.uuid4().hex, WATCH_HZ)
            checks.add_watched(seen)
        else:
            result = driver.act(action, uuid.uuid4().hex)
        capture = driver.capture()
        checks.add(capture)
        if each is not None:
            each(checks)
        if not result.succeeded:
            if stopped is not None:
                stopped(result)
            break
        try:
            action = routine.send(free_ahead_m(capture, robot))
        except StopIteration:
            break
    return checks.findings()
