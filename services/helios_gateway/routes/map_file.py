"""Both maps as one file: saved, and loaded in the place of the present ones."""

from __future__ import annotations

import io
import zipfile
from typing import Annotated

from fastapi import APIRouter, Body, Response
from helios_core import proto as pb
from helios_core.errors import Conflict, HeliosError
from helios_core.topics import LIST_TASKS, LOAD_MAP2D, LOAD_OBJECTS, SAVE_MAP2D, SAVE_OBJECTS

from helios_gateway import map_models
from helios_gateway.access import secured
from helios_gateway.convert import finite
from helios_gateway.fleet import At, Served
from helios_gateway.keys import Scope
from helios_gateway.map_file import MAP2D_SUFFIX, MapFile, packed, unpacked
from helios_gateway.problems import problems
from helios_gateway.settings import Settings

ZIP = "application/zip"
FILE_S = 60.0  # a map of a large home is read and checked in seconds
UNDER_WAY = ("running", "paused")


def map_file_routes(prefix: str, settings: Settings) -> APIRouter:
    """`/map.zip` and `/map/ros.zip`."""
    routes = APIRouter(prefix=prefix, tags=["maps and camera"])

    @routes.get(
        "/map.zip",
        summary="Save both maps in one file",
        response_class=Response,
        responses={200: {"content": {ZIP: {"schema": {"type": "string", "format": "binary"}}}}}
        | problems(),
        dependencies=secured(Scope.READ),
    )
    def save(at: At) -> Response:
        """All that both maps need to go on: `helios map save`."""
        [map2d] = at.bus.call(SAVE_MAP2D, pb.SaveMap2DRequest(), FILE_S).files
        objects = at.bus.call(SAVE_OBJECTS, pb.Empty(), FILE_S)
        data = packed(MapFile(map2d.data, objects.data), at.bus.robot)
        disposition = 'attachment; filename="map.zip"'
        return Response(data, media_type=ZIP, headers={"content-disposition": disposition})

    @routes.get(
        "/map/ros.zip",
        summary="The occupancy for ROS",
        response_class=Response,
        responses={200: {"content": {ZIP: {"schema": {"type": "string", "format": "binary"}}}}}
        | problems(),
        dependencies=secured(Scope.READ),
    )
    def ros(at: At) -> Response:
        """`map.pgm` and `map.yaml` as map_server reads them, both of one version:
        `helios map export --ros`."""
        files = at.bus.call(SAVE_MAP2D, pb.SaveMap2DRequest(format="ros"), FILE_S).files
        data = io.BytesIO()
        with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as together:
            for file in files:
                together.writestr(file.name, file.data)
        disposition = 'attachment; filename="ros.zip"'
        return Response(
            data.getvalue(), media_type=ZIP, headers={"content-disposition": disposition}
        )

    @routes.put(
        "/map.zip",
        summary="Load both maps from a file",
        responses=problems(409, body=True),
        dependencies=secured(Scope.ADMIN),
    )
    def load(
        at: At,
        file: Annotated[bytes, Body(media_type=ZIP, description="as GET gives it")],
    ) -> map_models.LoadedMaps:
        """In the place of the present ones: both, or neither where one is refused. What is
        at (x, y) in the file must be there in the robot's world, too. Refused while a task is
        under way."""
        maps = unpacked(file, settings.map_limit_bytes)
        _check_idle(at, settings.call_timeout_s)
        before = at.bus.call(SAVE_OBJECTS, pb.Empty(), FILE_S)
        objects = at.bus.call(LOAD_OBJECTS, pb.ObjectMapFile(data=maps.objects), FILE_S)
        named = pb.Map2DFile(name=f"map2d{MAP2D_SUFFIX}", data=maps.map2d)
        try:
            ground = at.bus.call(LOAD_MAP2D, pb.LoadMap2DRequest(files=[named]), FILE_S)
        except HeliosError:
            at.bus.call(LOAD_OBJECTS, before, FILE_S)
            raise
        finally:
            at.live.maps.on_change()
        return map_models.LoadedMaps(
            objects=objects.objects, gaussians=objects.gaussians, views=ground.views,
            known_m2=finite(ground.known_m2), occupied_m2=finite(ground.occupied_m2),
        )  # fmt: skip

    return routes


def _check_idle(at: Served, timeout_s: float) -> None:
    """Raises Conflict while a task is under way."""
    for task in at.bus.call(LIST_TASKS, pb.Empty(), timeout_s).tasks:
        if task.state in UNDER_WAY:
            raise Conflict(
                f"task {task.id} is {task.state} and relies on the present maps; wait for its end, "
                "or cancel it"
            )
