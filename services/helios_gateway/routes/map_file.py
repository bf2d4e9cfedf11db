"""`/map.zip` and `/map/ros.zip`: save both maps to a file, and load them from one."""

from __future__ import annotations

import contextlib
import io
import zipfile
from collections.abc import Iterator
from typing import Annotated

from fastapi import APIRouter, Body, Query, Response
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import DeadlineExceeded, HeliosError
from helios_core.topics import (
    LOAD_MAP2D,
    LOAD_OBJECTS,
    RESERVE,
    SAVE_MAP2D,
    SAVE_OBJECTS,
    M,
    Method,
    Req,
)

from helios_gateway import api_map_models
from helios_gateway.api_keys import Scope
from helios_gateway.dependencies import AddressedRobot, State, secured
from helios_gateway.error_responses import problems
from helios_gateway.map_archive import MAP2D_SUFFIX, MapFile, packed, unpacked
from helios_gateway.message_conversion import finite
from helios_gateway.robot_registry import RobotEndpoint

ZIP = "application/zip"
FILE_S = 60.0  # time limit of one save or load; a large home takes seconds
RESERVED_S = 5 * FILE_S  # exceeds the total of all calls of one load or reset
router = APIRouter(tags=["maps and camera"])


@router.get(
    "/map.zip",
    summary="Save both maps to a file",
    response_class=Response,
    responses={200: {"content": {ZIP: {"schema": {"type": "string", "format": "binary"}}}}}
    | problems(),
    dependencies=secured(Scope.READ),
)
def save(robot: AddressedRobot) -> Response:
    """Save both maps in one file.

    The file holds all data that both maps need to continue. Command line: `helios map save`.
    """
    [map2d] = robot.bus.call(SAVE_MAP2D, pb.SaveMap2DRequest(), FILE_S).files
    objects = robot.bus.call(SAVE_OBJECTS, pb.Empty(), FILE_S)
    data = packed(MapFile(map2d.data, objects.data), robot.bus.robot)
    disposition = 'attachment; filename="map.zip"'
    return Response(data, media_type=ZIP, headers={"content-disposition": disposition})


@router.get(
    "/map/ros.zip",
    summary="Get the occupancy grid as a ROS map",
    response_class=Response,
    responses={200: {"content": {ZIP: {"schema": {"type": "string", "format": "binary"}}}}}
    | problems(),
    dependencies=secured(Scope.READ),
)
def ros(robot: AddressedRobot) -> Response:
    """Export the occupancy grid for ROS.

    The ZIP holds `map.pgm` and `map.yaml` for map_server, both of the same version. Command
    line: `helios map export --ros`.
    """
    files = robot.bus.call(SAVE_MAP2D, pb.SaveMap2DRequest(format="ros"), FILE_S).files
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as together:
        for file in files:
            together.writestr(file.name, file.data)
    disposition = 'attachment; filename="ros.zip"'
    return Response(data.getvalue(), media_type=ZIP, headers={"content-disposition": disposition})


@router.put(
    "/map.zip",
    summary="Load both maps from a file",
    responses=problems(409, body=True),
    dependencies=secured(Scope.ADMIN),
)
def load(
    robot: AddressedRobot,
    state: State,
    file: Annotated[
        bytes,
        Body(
            media_type=ZIP,
            description="a map file from GET /v1/map.zip or `helios map save`",
        ),
    ],
    same_frame: Annotated[
        bool,
        Query(
            description="true: a position (x, y) in the file means the same place in the robot's "
            "world, although the file is of another world"
        ),
    ] = False,
) -> api_map_models.LoadedMaps:
    """Replace both maps with those of a file, or store a file of another world.

    If one map refuses the file, neither is replaced. The poses of a robot that restarts may
    begin elsewhere, which makes its world another one. Then the file is not in use until the
    robot has found its place in it (`/v1/objects` reports the state of each stored object).
    Returns 409 while a task is queued or under way; a new task waits. After a 504 the state of
    the maps is unknown: load a file again.
    """
    settings = state.settings
    maps = unpacked(file, settings.map_limit_bytes)
    with planner_reserved(robot, "the maps are being loaded", settings.call_timeout_s):
        objects, ground = _load_both(robot, maps, same_frame)
    return api_map_models.LoadedMaps(
        objects=objects.objects,
        gaussians=objects.gaussians,
        views=ground.views,
        known_m2=finite(ground.known_m2),
        occupied_m2=finite(ground.occupied_m2),
        stored=ground.stored,
    )


def _load_both(
    robot: RobotEndpoint, maps: MapFile, same_frame: bool
) -> tuple[pb.ObjectMapLoaded, pb.LoadMap2DReply]:
    """Load both maps. same_frame: their coordinates are those of the robot's world in any case.

    Raises HeliosError if neither is loaded, and DeadlineExceeded if that is unknown.
    """
    named = pb.Map2DFile(name=f"map2d{MAP2D_SUFFIX}", data=maps.map2d)
    before = robot.bus.call(SAVE_OBJECTS, pb.Empty(), FILE_S)
    try:
        file_of_objects = pb.ObjectMapFile(data=maps.objects, same_frame=same_frame)
        objects = _loaded(robot.bus, LOAD_OBJECTS, file_of_objects, "the object map")
        try:
            file_of_map2d = pb.LoadMap2DRequest(files=[named], same_frame=same_frame)
            ground = _loaded(robot.bus, LOAD_MAP2D, file_of_map2d, "map2d")
        except DeadlineExceeded:
            raise  # map2d may still load its part, which needs the new objects
        except HeliosError as error:
            put_back(robot.bus, before, error)
            raise
        return objects, ground
    finally:
        robot.monitor.maps.on_change()


def _loaded(bus: Bus, method: Method[Req, M], request: Req, whose: str) -> M:
    """Reply to a load request. Raises HeliosError; DeadlineExceeded if the outcome is unknown."""
    try:
        return bus.call(method, request, FILE_S)
    except DeadlineExceeded as error:
        raise DeadlineExceeded(
            f"{error.message}: whether {whose} holds what the file says is not known; wait until "
            "/v1/status says that it is ready, and load the file again"
        ) from error


def put_back(bus: Bus, objects: pb.ObjectMapFile, why: HeliosError) -> None:
    """Restore the former objects of the object map, and the maps that it had stored.

    objects: the newest file that it gave. If that fails, raises an error of the type of `why` with
    both messages.
    """
    try:
        former = pb.ObjectMapFile(data=objects.data, same_frame=True)
        bus.call(LOAD_OBJECTS, former, FILE_S)
    except HeliosError as error:
        raise type(why)(
            f"{why.message}; and the object map could not be given its former objects "
            f"({error.message}): load a file again"
        ) from why


@contextlib.contextmanager
def planner_reserved(robot: RobotEndpoint, why: str, timeout_s: float) -> Iterator[None]:
    """Keep the planner from starting a task until the context ends; new tasks wait and report why.

    Raises Conflict while a task is queued, running or paused.
    """
    request = pb.ReserveRequest(why=why, for_s=RESERVED_S)
    token = robot.bus.call(RESERVE, request, timeout_s).token
    try:
        yield
    finally:
        with contextlib.suppress(HeliosError):  # the reservation expires anyway
            robot.bus.call(RESERVE, pb.ReserveRequest(token=token), timeout_s)
