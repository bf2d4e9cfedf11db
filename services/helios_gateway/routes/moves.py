"""`/robot/go`, `/robot/explore` and `/robot/home`: tasks that only drive.

Each endpoint submits the equivalent instruction and returns the task.
"""

from __future__ import annotations

import math

from fastapi import APIRouter
from helios_core import proto as pb
from helios_core.geometry import wrap_angle
from helios_core.topics import SUBMIT

from helios_gateway import api_models
from helios_gateway.api_keys import Scope
from helios_gateway.api_move_models import ExploreRequest, GoRequest
from helios_gateway.dependencies import AddressedRobot, CallTimeout, secured
from helios_gateway.error_responses import problems

EXPLORE, HOME = "explore the home", "return to the start"
router = APIRouter(prefix="/robot", tags=["robot"], dependencies=secured(Scope.TASK))
REFUSALS = problems(409, body=True)


@router.post("/go", status_code=202, summary="Drive to a point", responses=REFUSALS)
def go(robot: AddressedRobot, request: GoRequest, timeout_s: CallTimeout) -> api_models.Task:
    """Queue a task that drives to a point, also across unknown floor.

    Equivalent to the instruction “go to 3.2, 4.1 facing 90 degrees”. If the point is
    unreachable, the task fails with cause `goal unreachable` and names the nearest reachable
    place.
    """
    message = pb.SubmitRequest(instruction=sentence_to(request))
    return robot.monitor.task(robot.bus.call(SUBMIT, message, timeout_s))


@router.post("/explore", status_code=202, summary="Explore the home", responses=REFUSALS)
def explore(
    robot: AddressedRobot, request: ExploreRequest, timeout_s: CallTimeout
) -> api_models.Task:
    """Queue a task that explores the home.

    The robot drives to the nearest frontier, until it cannot reach any more unknown floor or
    the time is up. Equivalent to the instruction “explore the home”.
    """
    message = pb.SubmitRequest(instruction=EXPLORE, time_limit_s=request.time_limit_s or 0.0)
    return robot.monitor.task(robot.bus.call(SUBMIT, message, timeout_s))


@router.post(
    "/home", status_code=202, summary="Drive back to the start position", responses=REFUSALS
)
def home(robot: AddressedRobot, timeout_s: CallTimeout) -> api_models.Task:
    """Queue a task that drives to the robot's start position in this world.

    Equivalent to the instruction “return to the start”.
    """
    message = pb.SubmitRequest(instruction=HOME)
    return robot.monitor.task(robot.bus.call(SUBMIT, message, timeout_s))


def sentence_to(goal: GoRequest) -> str:
    """Equivalent instruction, rounded to 1 mm and 0.01°."""
    facing = ""
    if goal.yaw_rad is not None:
        degrees = math.degrees(wrap_angle(goal.yaw_rad))
        facing = f" facing {_plain(degrees, 2)} degrees"
    return f"go to {_plain(goal.x_m, 3)}, {_plain(goal.y_m, 3)}{facing}"


def _plain(value: float, digits: int) -> str:
    """Decimal number without an exponent, trailing zeros or a minus before 0."""
    return f"{round(value, digits) + 0.0:.{digits}f}".rstrip("0").rstrip(".")
