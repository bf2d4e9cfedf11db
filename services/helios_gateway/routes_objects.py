"""One object in full, rendered, and the Gaussians for other programs."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from fastapi import APIRouter, Path, Query, Request, Response
from helios_core import proto as pb
from helios_core.codec.frames import pinhole_to_proto, transform_to_proto
from helios_core.errors import InvalidInput
from helios_core.topics import EXPORT_OBJECTS, OBJECT_DETAIL, RENDER_OBJECTS, M, Method, Req

from helios_gateway import convert, map_models
from helios_gateway.access import secured
from helios_gateway.fleet import At, Served
from helios_gateway.keys import Scope
from helios_gateway.look import camera, look_at
from helios_gateway.problems import NotFound, problems
from helios_gateway.responses import NPZ, PNG, Encoded, content_docs, tagged
from helios_gateway.settings import Settings

PLY = "application/octet-stream"
ObjectId = Annotated[int, Path(ge=1, lt=2**64, description="as /v1/objects gives it")]


def object_routes(prefix: str, settings: Settings) -> APIRouter:
    """`/objects.ply`, `/objects/{id}/…`"""
    routes = APIRouter(prefix=prefix, tags=["objects"], dependencies=secured(Scope.READ))

    def told(at: Served, method: Method[Req, M], request: Req) -> M:
        try:
            return at.bus.call(method, request, settings.call_timeout_s)
        except InvalidInput as error:
            raise NotFound(error.message) from error

    def export(at: Served, request: Request, format: str, id: int = 0) -> Response:
        reply = told(at, EXPORT_OBJECTS, pb.ExportRequest(format=format, object_id=id))
        encoded = Encoded.of(reply.data, PLY, x_gaussians=str(reply.gaussians))
        return tagged(request, encoded)

    @routes.get(
        "/objects.ply",
        summary="All Gaussians, as 3D Gaussian splatting tools read them",
        response_class=Response,
        responses=content_docs(PLY, "PLY") | problems(404),
    )
    def all_ply(at: At, request: Request) -> Response:
        return export(at, request, "ply")

    @routes.get(
        "/objects.npz",
        summary="All Gaussians as arrays",
        response_class=Response,
        responses=content_docs(NPZ, "NumPy archive") | problems(404),
    )
    def all_npz(at: At, request: Request) -> Response:
        return export(at, request, "npz")

    @routes.get(
        "/objects/{id}/gaussians.ply",
        summary="The Gaussians of one object",
        response_class=Response,
        responses=content_docs(PLY, "PLY") | problems(404),
    )
    def one_ply(at: At, request: Request, id: ObjectId) -> Response:
        return export(at, request, "ply", id)

    @routes.get("/objects/{id}/detail", summary="One object in full", responses=problems(404))
    def detail(at: At, id: ObjectId) -> map_models.ObjectDetail:
        """With the history of its score, and the upright box that a gripper wants to know."""
        return convert.object_detail(told(at, OBJECT_DETAIL, pb.ObjectRequest(object_id=id)))

    @routes.get(
        "/objects/{id}/view.png",
        summary="What is modelled of one object, as a camera beside it would see it",
        response_class=Response,
        responses=content_docs(PNG, "colour, or the layer as grey") | problems(404),
    )
    def view(
        at: At,
        request: Request,
        id: ObjectId,
        layer: Annotated[
            Literal["color", "probability", "uncertainty"],
            Query(description="of its class, for the last two"),
        ] = "color",
        azimuth_rad: Annotated[
            float | None,
            Query(
                allow_inf_nan=False, ge=-2 * math.pi, le=2 * math.pi,
                description="where the camera stands, about world z; none: on the robot's side",
            ),
        ] = None,
        size_px: Annotated[int, Query(ge=64, le=1024, description="side of the picture")] = 320,
    ) -> Response:  # fmt: skip
        found = told(at, OBJECT_DETAIL, pb.ObjectRequest(object_id=id)).object
        center_m, size_m = (np.array([v.x, v.y, v.z]) for v in (found.center_m, found.size_m))
        if not np.isfinite([center_m, size_m]).all():
            raise NotFound(f"object {id} has no place yet")
        T_world_cam = look_at(
            center_m, size_m, _robot_side(at, center_m) if azimuth_rad is None else azimuth_rad
        )
        reply = told(at, RENDER_OBJECTS, pb.RenderRequest(
            T_world_cam=transform_to_proto(T_world_cam), camera=pinhole_to_proto(camera(size_px)),
            layer=layer, class_name=found.class_name,
        ))  # fmt: skip
        return tagged(request, Encoded.of(reply.png, PNG))

    return routes


def _robot_side(at: Served, center_m: np.ndarray) -> float:
    """The direction from the object to the robot, radians; 0 where the robot's place is unknown."""
    state = at.live.robot().state
    if state is None or state.pose is None:
        return 0.0
    return math.atan2(state.pose.y_m - center_m[1], state.pose.x_m - center_m[0])
