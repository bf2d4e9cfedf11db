"""`/map/reset`: empties both maps, or one."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from helios_core import proto as pb
from helios_core.errors import DeadlineExceeded, HeliosError
from helios_core.topics import RESET_MAP2D, RESET_OBJECTS, SAVE_OBJECTS, Method

from helios_gateway import api_map_models
from helios_gateway.api_keys import Scope
from helios_gateway.dependencies import AddressedRobot, CallTimeout, Maps, secured
from helios_gateway.error_responses import problems
from helios_gateway.robot_registry import RobotEndpoint
from helios_gateway.routes.map_file import FILE_S, planner_reserved, put_back

Part = Literal["objects", "occupancy"]
BOTH: tuple[Part, ...] = ("objects", "occupancy")
METHODS: dict[Part, Method[pb.Empty, pb.Empty]] = {
    "objects": RESET_OBJECTS,
    "occupancy": RESET_MAP2D,
}
router = APIRouter(tags=["maps and camera"])


@router.post(
    "/map/reset",
    summary="Empty both maps or one of them",
    responses=problems(409),
    dependencies=secured(Scope.ADMIN),
)
def reset(
    robot: AddressedRobot,
    maps: Maps,
    timeout_s: CallTimeout,
    only: Annotated[
        Part | None,
        Query(
            description="map to empty: objects, or occupancy with value layers and past views; "
            "default: both"
        ),
    ] = None,
) -> api_map_models.ResetMaps:
    """Empty both maps, or one of them, including their data on disk.

    If one of the two cannot be emptied, neither is. A new map begins with the next keyframe.
    Returns 409 while a task is queued or under way; a new task waits. After a 504 the state of
    the maps is unknown: send the request again.
    """
    parts = BOTH if only is None else (only,)
    with planner_reserved(robot, "the maps are being emptied", timeout_s):
        try:
            if only is None:
                _reset_both(robot)
            else:
                _reset(robot, only)
        finally:
            maps.on_change()
    return api_map_models.ResetMaps(reset=list(parts))


def _reset_both(robot: RobotEndpoint) -> None:
    """Empty both maps.

    Raises HeliosError if neither is empty, and DeadlineExceeded if that is unknown.
    """
    before = robot.bus.call(SAVE_OBJECTS, pb.Empty(), FILE_S)
    _reset(robot, "objects")
    try:
        _reset(robot, "occupancy")
    except DeadlineExceeded:
        raise  # map2d may still empty its part
    except HeliosError as error:
        put_back(robot.bus, before, error)
        raise


def _reset(robot: RobotEndpoint, part: Part) -> None:
    try:
        robot.bus.call(METHODS[part], pb.Empty(), FILE_S)
    except DeadlineExceeded as error:
        raise DeadlineExceeded(
            f"{error.message}: whether the map of {part} is empty is not known; wait until "
            "/v1/status says that all is ready, and reset again"
        ) from error
