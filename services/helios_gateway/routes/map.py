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
from helios_gateway.routes.objects import ObjectId

LayerName = Annotated[str, Path(description="name of the value layer, as listed by `/v1/map`")]
SizePx = Annotated[
    int, Query(ge=128, le=4096, description="side length of the square image, pixels")
]
router = APIRouter(
    tags=["maps and camera"],
    responses=problems(),
    dependencies=secured(Scope.READ),
)


@router.get(
    "/map",
    summary="Get the size, origin and value layers of the 2D map",
    response_model=api_map_models.MapInfo,
    responses=UNCHANGED,
)
def info(maps: Maps, request: Request) -> Response:
    return conditional_response(request, maps.info_json())


@router.get(
    "/map/frontiers",
    summary="List the frontiers with their values",
    response_model=api_map_models.FrontierList,
    responses=UNCHANGED,
)
def frontiers(maps: Maps, request: Request) -> Response:
    return conditional_response(request, maps.frontiers_json())


@router.get(
    "/map/occupancy.png",
    summary="Draw the occupancy grid with the path and the objects",
    response_class=Response,
    responses=content_docs(PNG, "image for display"),
)
def occupancy_png(maps: Maps, request: Request, size_px: SizePx = 900) -> Response:
    return conditional_response(request, maps.picture("occupancy", size_px))


@router.get(
    "/map/occupancy.npz",
    summary="Get the occupancy grid as NumPy arrays",
    response_class=Response,
    responses=content_docs(
        NPZ,
        "NumPy archive with occupancy, explored, top_m, trajectory_m, "
        "frontier_id, frontier_center_m, frontier_size_m, frontier_reachable, origin_m, "
        "cell_m, robot_pose and version",
    ),
)
def occupancy_npz(maps: Maps, request: Request) -> Response:
    """Return the occupancy grid as a NumPy archive.

    Rows run along world y from the origin upwards, columns along x.
    """
    return conditional_response(request, maps.npz(None))


@router.get(
    "/map/value/{layer}.png",
    summary="Draw a value layer",
    response_class=Response,
    responses=content_docs(PNG, "image for display") | problems(404),
)
def value_png(maps: Maps, request: Request, layer: LayerName, size_px: SizePx = 900) -> Response:
    return conditional_response(request, maps.picture(layer, size_px))


@router.get(
    "/map/value/{layer}.npz",
    summary="Get a value layer as NumPy arrays",
    response_class=Response,
    responses=content_docs(
        NPZ, "NumPy archive with value, explored, origin_m, cell_m, robot_pose and version"
    )
    | problems(404),
)
def value_npz(maps: Maps, request: Request, layer: LayerName) -> Response:
    return conditional_response(request, maps.npz(layer))


@router.get(
    "/map/cells.png",
    summary="Get the 2D map as an image with one pixel per cell",
    response_class=Response,
    responses=content_docs(PNG, "image with one pixel per cell, north up") | problems(404),
)
def cells(
    maps: Maps,
    request: Request,
    layer: Annotated[
        str | None, Query(description="value layer for the blue channel; none: the channel is 0")
    ] = None,
) -> Response:
    """Return the map as an image for programs that colour it themselves.

    Red: 0 unknown, 128 free, 255 occupied. Green: 255 where seen since the search began.
    Blue: the layer's value, 255 at the layer's `max_value` (see `/v1/map`).
    """
    return conditional_response(request, maps.cells(layer))


@router.get(
    "/objects",
    summary="List the mapped objects",
    response_model=api_map_models.ObjectList,
    responses=UNCHANGED | problems(404),
)
def objects(
    maps: Maps,
    request: Request,
    class_name: Annotated[
        str | None,
        Query(alias="class", description="class of the objects to list; case-insensitive"),
    ] = None,
    min_score: Annotated[
        float | None,
        Query(allow_inf_nan=False, description="lowest score Ψ of the objects to list"),
    ] = None,
) -> Response:
    return conditional_response(request, maps.objects_json(class_name, min_score))


@router.get("/objects/{id}", summary="Get a mapped object", responses=problems(404))
def one_object(maps: Maps, id: ObjectId) -> api_map_models.ObjectInstance:
    return maps.object(id)


@router.get(
    "/camera.jpg",
    summary="Get the newest camera image",
    response_class=Response,
    responses=content_docs(JPEG, "colour image, with the detector's boxes unless raw is true"),
)
def camera(
    robot: AddressedRobot,
    request: Request,
    raw: Annotated[bool, Query(description="true to omit the detector's boxes")] = False,
) -> Response:
    return conditional_response(request, robot.monitor.camera.jpeg(raw))
