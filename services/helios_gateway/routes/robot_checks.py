"""`/robot/checks`: what the bridge has found out about the robot's set-up."""

from __future__ import annotations

import typing

from fastapi import APIRouter
from helios_core import proto as pb
from helios_core.errors import Internal
from helios_core.printable_text import printable
from helios_core.robot_checks.finding import Verdict
from helios_core.topics import ROBOT_CHECKS

from helios_gateway.api_check_models import RobotCheck, RobotChecks
from helios_gateway.api_keys import Scope
from helios_gateway.dependencies import AddressedRobot, CallTimeout, secured
from helios_gateway.error_responses import problems
from helios_gateway.message_conversion import finite

CHECK_S = 20.0  # for images that wait to be checked
router = APIRouter(prefix="/robot/checks", tags=["robot"], dependencies=secured(Scope.READ))


@router.get("", summary="Get the checks of the robot's set-up", responses=problems(409))
def get_checks(robot: AddressedRobot, timeout_s: CallTimeout) -> RobotChecks:
    """Results of the checks of camera pose, depth and times, from the images so far.

    The bridge checks the first images of every task, and those after a restart of the checks.
    """
    message = pb.RobotChecksRequest()
    return _converted(robot.bus.call(ROBOT_CHECKS, message, timeout_s + CHECK_S))


@router.post(
    "",
    summary="Restart the checks of the robot's set-up",
    responses=problems(409),
    dependencies=secured(Scope.ROBOT),
)
def restart_checks(robot: AddressedRobot, timeout_s: CallTimeout) -> RobotChecks:
    """Forget the earlier images, take one now, and check all images of the next minutes.

    Then move the robot with `/v1/robot/drive`, as `helios doctor --robot` does.
    """
    message = pb.RobotChecksRequest(restart=True)
    return _converted(robot.bus.call(ROBOT_CHECKS, message, timeout_s + CHECK_S))


def _converted(message: pb.RobotChecksReply) -> RobotChecks:
    return RobotChecks(
        checks=[_check(check) for check in message.checks],
        images=message.images,
        free_ahead_m=finite(message.free_ahead_m) or 0.0,
    )


def _check(check: pb.RobotCheck) -> RobotCheck:
    verdicts: dict[str, Verdict] = {name: name for name in typing.get_args(Verdict)}
    verdict = verdicts.get(check.verdict)
    if verdict is None:
        raise Internal(f"the bridge sent the verdict {check.verdict!r}; update the older of both")
    measured = verdict != "not measured"
    return RobotCheck(
        name=check.name,
        verdict=verdict,
        value=finite(check.value) if measured else None,
        error=finite(check.error) if measured else None,
        limit=check.limit,
        unit=check.unit,
        words=printable(check.words),
    )
