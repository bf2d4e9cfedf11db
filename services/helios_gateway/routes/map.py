"""`/map...`, `/objects` and `/camera.jpg`: maps, objects and the camera image."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response

from helios_gateway import api_map_models
from helios_gateway.api_keys import Scope
from helios_gateway.cached_responses import (
    JPEG,
    NPZ,
    PNG,
    UNCHANGED,
    conditional_response,
    content_docs,
)
from helios_gateway.dependencies import AddressedRobot, Maps, secured
from helios_gateway.error_responses import problems

LayerName = Annotated[str, Path(description="as `/v1/map` lists it")]
SizePx = Annotated[int, Query(ge=128, le=4096, description="side of the square picture, pixels")]
router = APIRouter(
    tags=["maps and camera"],
    responses=problems(),
    dependencies=secured(Scope.READ),
)


@router.get(
    "/map",
    summary="The 2D map's size, place and layers",
    response_model=api_map_models.MapInfo,
    responses=UNCHANGED,
)
def info(maps: Maps, request: Request) -> Response:
    return conditional_response(request, maps.info_json())


@router.get(
    "/map/frontiers",
    summary="Borders of what was seen, with their values",
    response_model=api_map_models.FrontierList,
    responses=UNCHANGED,
)
def frontiers(maps: Maps, request: Request) -> Response:
    return conditional_response(request, maps.frontiers_json())


@router.get(
    "/map/occupancy.png",
    summary="Picture of the occupancy, with the path and the objects",
    response_class=Response,
    responses=content_docs(PNG, "a picture for people"),
)
def occupancy_png(maps: Maps, request: Request, size_px: SizePx = 900) -> Response:
    return conditional_response(request, maps.picture("occupancy", size_px))


@router.get(
    "/map/occupancy.npz",
    summary="Arrays of the occupancy",
    response_class=Response,
    responses=content_docs(
        NPZ,
        "occupancy, explored, top_m, trajectory_m, frontier_id, frontier_center_m, "
        "frontier_size_m, frontier_reachable, origin_m, cell_m, robot_pose",
    ),
)
def occupancy_npz(maps: Maps, request: Request) -> Response:
    """Return the occupancy grid as a NumPy archive.

    Rows run along world y from the origin upwards, columns along x.
    """
    return conditional_response(request, maps.npz(None))


@router.get(
    "/map/value/{layer}.png",
    summary="Picture of a value layer",
    response_class=Response,
    responses=content_docs(PNG, "a picture for people") | problems(404),
)
def value_png(maps: Maps, request: Request, layer: LayerName, size_px: SizePx = 900) -> Response:
    return conditional_response(request, maps.picture(layer, size_px))


@router.get(
    "/map/value/{layer}.npz",
    summary="Array of a value layer",
    response_class=Response,
    responses=content_docs(NPZ, "value, explored, origin_m, cell_m") | problems(404),
)
def value_npz(maps: Maps, request: Request, layer: LayerName) -> Response:
    return conditional_response(request, maps.npz(layer))


@router.get(
    "/map/cells.png",
    summary="The map for programs that colour it themselves",
    response_class=Response,
    responses=content_docs(PNG, "one pixel a cell, north up") | problems(404),
)
def cells(
    maps: Maps,
    request: Request,
    layer: Annotated[str | None, Query(description="a value layer for the blue channel")] = None,
) -> Response:
    """Return the map as an image for programs that colour it themselves.

    Red: 0 unknown, 128 free, 255 occupied. Green: 255 where seen since the search began.
    Blue: the layer's value, 255 at the layer's `max_value` (see `/v1/map`).
    """
    return conditional_response(request, maps.cells(layer))


@router.get(
    "/objects",
    summary="What is believed to be where",
    response_model=api_map_models.ObjectList,
    responses=UNCHANGED | problems(404),
)
def objects(
    maps: Maps,
    request: Request,
    class_name: Annotated[
        str | None, Query(alias="class", description="only those of this class, in any case")
    ] = None,
    min_score: Annotated[
        float | None,
        Query(allow_inf_nan=False, description="only those with a score Ψ from this on"),
    ] = None,
) -> Response:
    return conditional_response(request, maps.objects_json(class_name, min_score))


@router.get("/objects/{id}", summary="One object", responses=problems(404))
def one_object(
    maps: Maps, id: Annotated[int, Path(ge=0, lt=2**64, description="as /v1/objects gives it")]
) -> api_map_models.ObjectInstance:
    return maps.object(id)


@router.get(
    "/camera.jpg",
    summary="The newest camera picture",
    response_class=Response,
    responses=content_docs(JPEG, "colour, with the detector's boxes"),
)
def camera(
    robot: AddressedRobot,
    request: Request,
    raw: Annotated[bool, Query(description="without boxes")] = False,
) -> Response:
    return conditional_response(request, robot.monitor.camera.jpeg(raw))
