"""Moving the robot without pick and place: to a point, home, all over the home.

Each route submits the sentence that says the same; the answer is the task.
"""

from __future__ import annotations

import math

from fastapi import APIRouter
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.geometry import wrap_angle
from helios_core.topics import SUBMIT

from helios_gateway import api_models, message_conversion
from helios_gateway.api_keys import Scope
from helios_gateway.api_move_models import ExploreRequest, GoRequest
from helios_gateway.authorization import secured
from helios_gateway.error_responses import problems
from helios_gateway.robot_registry import At
from helios_gateway.settings import Settings

EXPLORE, HOME = "explore the home", "return to the start"


def move_routes(prefix: str, settings: Settings) -> APIRouter:
    """`/robot/go`, `/robot/explore`, `/robot/home`."""
    routes = APIRouter(
        prefix=f"{prefix}/robot", tags=["robot"], dependencies=secured(Scope.OPERATE)
    )
    refusals = problems(409, body=True)

    def submitted(bus: Bus, instruction: str, time_limit_s: float | None = None) -> api_models.Task:
        message = pb.SubmitRequest(instruction=instruction, time_limit_s=time_limit_s or 0.0)
        return message_conversion.task(bus.call(SUBMIT, message, settings.call_timeout_s))

    @routes.post("/go", status_code=202, summary="Go to a point", responses=refusals)
    def go(at: At, request: GoRequest) -> api_models.Task:
        """Queue a task that drives to a point, also over floor that is not known yet.

        The same as the instruction “go to 3.2, 4.1 facing 90 degrees”. Where the point is out of
        reach it fails with cause `goal unreachable` and names the nearest place that is not."""
        return submitted(at.bus, sentence_to(request))

    @routes.post("/explore", status_code=202, summary="Explore the home", responses=refusals)
    def explore(at: At, request: ExploreRequest) -> api_models.Task:
        """Queue a task that drives to the nearest border of the known floor, until nothing that
        can be reached is unknown, or its time is up. The same as “explore the home”."""
        return submitted(at.bus, EXPLORE, request.time_limit_s)

    @routes.post("/home", status_code=202, summary="Go back to the start", responses=refusals)
    def home(at: At) -> api_models.Task:
        """Queue a task that drives to where the robot started in this world. The same as “return
        to the start”."""
        return submitted(at.bus, HOME)

    return routes


def sentence_to(goal: GoRequest) -> str:
    """The instruction that says the same: millimetres, hundredths of a degree."""
    facing = ""
    if goal.yaw_rad is not None:
        degrees = math.degrees(wrap_angle(goal.yaw_rad))
        facing = f" facing {_plain(degrees, 2)} degrees"
    return f"go to {_plain(goal.x_m, 3)}, {_plain(goal.y_m, 3)}{facing}"


def _plain(value: float, digits: int) -> str:
    """Without an exponent, trailing zeros or a minus before 0."""
    return f"{round(value, digits) + 0.0:.{digits}f}".rstrip("0").rstrip(".")
