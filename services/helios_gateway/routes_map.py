"""Maps, objects and the camera."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from helios_gateway import models
from helios_gateway.live import Live
from helios_gateway.responses import JPEG, NPZ, PNG, content_docs, tagged

SizePx = Annotated[int, Query(ge=128, le=4096, description="longer side of the picture, pixels")]


def map_routes(live: Live) -> APIRouter:
    """`/v1/map…`, `/v1/objects` and `/v1/camera.jpg`."""
    routes = APIRouter(prefix="/v1", tags=["maps and camera"])
    maps = live.maps

    @routes.get("/map", summary="The 2D map's size, place and layers")
    def info() -> models.MapInfo:
        return maps.info()

    @routes.get("/map/frontiers", summary="Borders of what was seen, with their values")
    def frontiers() -> models.FrontierList:
        return maps.frontiers()

    @routes.get(
        "/map/occupancy.png",
        summary="Picture of the occupancy, with the path and the objects",
        response_class=Response,
        responses=content_docs(PNG, "a picture for people"),
    )
    def occupancy_png(request: Request, size_px: SizePx = 900) -> Response:
        return tagged(request, maps.picture("occupancy", size_px), PNG)

    @routes.get(
        "/map/occupancy.npz",
        summary="Arrays of the occupancy",
        response_class=Response,
        responses=content_docs(NPZ, "occupancy, explored, top_m, trajectory_m, origin_m, cell_m"),
    )
    def occupancy_npz(request: Request) -> Response:
        """NumPy archive; rows along world y from the origin upwards, columns along x."""
        data, version = maps.npz(None)
        return tagged(request, data, NPZ, x_map_version=str(version))

    @routes.get(
        "/map/value/{layer}.png",
        summary="Picture of a value layer",
        response_class=Response,
        responses=content_docs(PNG, "a picture for people"),
    )
    def value_png(request: Request, layer: str, size_px: SizePx = 900) -> Response:
        return tagged(request, maps.picture(layer, size_px), PNG)

    @routes.get(
        "/map/value/{layer}.npz",
        summary="Array of a value layer",
        response_class=Response,
        responses=content_docs(NPZ, "value, explored, origin_m, cell_m"),
    )
    def value_npz(request: Request, layer: str) -> Response:
        data, version = maps.npz(layer)
        return tagged(request, data, NPZ, x_map_version=str(version))

    @routes.get(
        "/map/cells.png",
        summary="The map for programs that colour it themselves",
        response_class=Response,
        responses=content_docs(PNG, "one pixel a cell, north up"),
    )
    def cells(
        request: Request,
        layer: Annotated[
            str | None, Query(description="a value layer for the blue channel")
        ] = None,
    ) -> Response:
        """Red: 0 unknown, 128 free, 255 occupied. Green: 255 where seen since the search began.
        Blue: the layer's value, 255 at the layer's `max_value` (see `/v1/map`)."""
        data, version = maps.cells(layer)
        return tagged(request, data, PNG, x_map_version=str(version))

    @routes.get("/objects", summary="What is believed to be where", response_model_by_alias=True)
    def objects() -> models.ObjectList:
        return maps.objects()

    @routes.get(
        "/camera.jpg",
        summary="The newest camera picture",
        response_class=Response,
        responses=content_docs(JPEG, "colour, with the detector's boxes"),
    )
    def camera(
        request: Request,
        raw: Annotated[bool, Query(description="without boxes")] = False,
    ) -> Response:
        data, id = live.camera.jpeg(raw)
        return tagged(request, data, JPEG, x_frame_id=f"{id.world_epoch}/{id.seq}")

    return routes
