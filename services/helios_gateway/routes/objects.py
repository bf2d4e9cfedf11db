"""`/objects.ply`, `/objects/{id}/...` and `/map/view.png`: export and rendering of objects."""

from __future__ import annotations

import io
import math
from typing import Annotated, Literal

import numpy as np
from fastapi import APIRouter, Path, Query, Request, Response
from helios_core import proto as pb
from helios_core.codec.frames import WIDEST_FOCAL, pinhole_to_proto, transform_to_proto
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix, Pinhole, camera_on_base, se2_to_se3
from helios_core.topics import EXPORT_OBJECTS, OBJECT_DETAIL, RENDER_OBJECTS

from helios_gateway import api_map_models, message_conversion
from helios_gateway.api_keys import Scope
from helios_gateway.cached_responses import NPZ, PNG, Encoded, conditional_response, content_docs
from helios_gateway.dependencies import AddressedRobot, CallTimeout, secured
from helios_gateway.error_responses import NotFound, invalid_as_not_found, problems
from helios_gateway.object_viewpoint import camera, look_at
from helios_gateway.robot_registry import RobotEndpoint

PLY = "application/octet-stream"
Layer = Literal["color", "depth", "probability", "uncertainty"]
Metres = Annotated[
    float,
    Query(
        allow_inf_nan=False,
        ge=-1e6,
        le=1e6,
        description="coordinate of the camera in the world frame, metres",
    ),
]
ObjectId = Annotated[
    int, Path(ge=1, lt=2**64, description="id of the object, as returned by `/v1/objects`")
]
router = APIRouter(tags=["objects"], dependencies=secured(Scope.READ))


@router.get(
    "/objects.ply",
    summary="Export all Gaussians as PLY for 3D Gaussian splatting tools",
    response_class=Response,
    responses=content_docs(PLY, "PLY file") | problems(404),
)
def all_ply(robot: AddressedRobot, request: Request, timeout_s: CallTimeout) -> Response:
    return _exported(robot, request, timeout_s, "ply")


@router.get(
    "/objects.npz",
    summary="Export all Gaussians as NumPy arrays",
    response_class=Response,
    responses=content_docs(NPZ, "NumPy archive") | problems(404),
)
def all_npz(robot: AddressedRobot, request: Request, timeout_s: CallTimeout) -> Response:
    return _exported(robot, request, timeout_s, "npz")


@router.get(
    "/objects/{id}/gaussians.ply",
    summary="Export the Gaussians of one object as PLY",
    response_class=Response,
    responses=content_docs(PLY, "PLY file") | problems(404),
)
def one_ply(
    robot: AddressedRobot, request: Request, id: ObjectId, timeout_s: CallTimeout
) -> Response:
    return _exported(robot, request, timeout_s, "ply", id)


@router.get(
    "/objects/{id}/gaussians.npz",
    summary="Export the Gaussians of one object as NumPy arrays",
    response_class=Response,
    responses=content_docs(NPZ, "NumPy archive") | problems(404),
)
def one_npz(
    robot: AddressedRobot, request: Request, id: ObjectId, timeout_s: CallTimeout
) -> Response:
    return _exported(robot, request, timeout_s, "npz", id)


@router.get(
    "/objects/{id}/points.npz",
    summary="Get the surface points and the grasp box of one object",
    response_class=Response,
    responses=content_docs(
        NPZ,
        "NumPy archive with points_m [n, 3] in the world frame, box_center_m [3], "
        "box_size_m [3] and box_yaw_rad",
    )
    | problems(404),
)
def points(
    robot: AddressedRobot, request: Request, id: ObjectId, timeout_s: CallTimeout
) -> Response:
    d = _detail(robot, id, timeout_s)
    stream = io.BytesIO()
    np.savez(
        stream,
        allow_pickle=False,
        points_m=np.array(d.points_m, np.float32).reshape(-1, 3),
        box_center_m=[d.box_center_m.x, d.box_center_m.y, d.box_center_m.z],
        box_size_m=[d.box_size_m.x, d.box_size_m.y, d.box_size_m.z],
        box_yaw_rad=d.box_yaw_rad,
    )
    return conditional_response(request, Encoded.of(stream.getvalue(), NPZ))


@router.get(
    "/objects/{id}/detail",
    summary="Get an object with its score history and upright box",
    responses=problems(404),
)
def detail(
    robot: AddressedRobot, id: ObjectId, timeout_s: CallTimeout
) -> api_map_models.ObjectDetail:
    """Return one object with the history of its score and its upright box for grasping."""
    return message_conversion.object_detail(_detail(robot, id, timeout_s))


@router.get(
    "/objects/{id}/view.png",
    summary="Render one object as a camera beside it would see it",
    response_class=Response,
    responses=content_docs(
        PNG, "colour; depth as 16-bit millimetres; probability or uncertainty from dark to yellow"
    )
    | problems(404),
)
def view(
    robot: AddressedRobot,
    timeout_s: CallTimeout,
    request: Request,
    id: ObjectId,
    layer: Annotated[
        Layer,
        Query(
            description="rendered layer; probability and uncertainty refer to the object's class"
        ),
    ] = "color",
    azimuth_rad: Annotated[
        float | None,
        Query(
            allow_inf_nan=False,
            ge=-2 * math.pi,
            le=2 * math.pi,
            description="direction from the object to the camera, about world z; none: towards the "
            "robot",
        ),
    ] = None,
    size_px: Annotated[
        int, Query(ge=64, le=1024, description="side length of the square image")
    ] = 320,
) -> Response:
    found = _detail(robot, id, timeout_s).object
    center_m, size_m = (np.array([v.x, v.y, v.z]) for v in (found.center_m, found.size_m))
    if not np.isfinite([center_m, size_m]).all():
        raise NotFound(f"object {id} has no place yet")
    T_world_cam = look_at(
        center_m, size_m, _robot_side(robot, center_m) if azimuth_rad is None else azimuth_rad
    )
    rendered = _rendered(robot, T_world_cam, camera(size_px), layer, found.class_name, timeout_s)
    return conditional_response(request, rendered)


@router.get(
    "/map/view.png",
    summary="Render the object map from any camera pose",
    response_class=Response,
    responses=content_docs(
        PNG, "colour; depth as 16-bit millimetres; probability or uncertainty from dark to yellow"
    )
    | problems(),
)
def view_from(
    robot: AddressedRobot,
    timeout_s: CallTimeout,
    request: Request,
    x_m: Metres,
    y_m: Metres,
    z_m: Annotated[
        float, Query(allow_inf_nan=False, ge=-1e3, le=1e3,
                     description="height of the camera in the world frame, metres"),
    ] = 1.3,
    yaw_rad: Annotated[
        float, Query(allow_inf_nan=False, ge=-2 * math.pi, le=2 * math.pi,
                     description="heading of the camera, counter-clockwise from the world's "
                     "x axis"),
    ] = 0.0,
    down_rad: Annotated[
        float, Query(allow_inf_nan=False, ge=-math.pi / 2, le=math.pi / 2,
                     description="angle of the viewing direction below the horizon"),
    ] = 0.4,
    layer: Annotated[
        Layer, Query(description="rendered layer; probability and uncertainty need a class")
    ] = "color",
    class_name: Annotated[
        str, Query(alias="class", max_length=100,
                   description="class that probability and uncertainty refer to"),
    ] = "",
    width_px: Annotated[int, Query(ge=16, le=1280, description="width of the image")] = 640,
    height_px: Annotated[int, Query(ge=16, le=1280, description="height of the image")] = 480,
    fov_rad: Annotated[
        float, Query(ge=0.2, le=2.5, allow_inf_nan=False, description="horizontal field of view"),
    ] = 1.2,
) -> Response:  # fmt: skip
    """Render the object map from any camera pose, for example the pose of a frame."""
    lens = _lens(width_px, height_px, fov_rad)
    T_world_cam = camera_on_base(se2_to_se3(x_m, y_m, yaw_rad), z_m, down_rad)
    rendered = _rendered(robot, T_world_cam, lens, layer, class_name, timeout_s)
    return conditional_response(request, rendered)


def _lens(width_px: int, height_px: int, fov_rad: float) -> Pinhole:
    """Camera with a horizontal field of view. Raises InvalidInput if the image is so high that the
    vertical one comes too near to π."""
    f = width_px / 2 / math.tan(fov_rad / 2)
    if f < WIDEST_FOCAL * max(width_px, height_px):
        raise InvalidInput(
            f"no camera sees {fov_rad:g} rad across {width_px} pixels and is {height_px} pixels "
            "high; send a smaller fov_rad or height_px, or a larger width_px"
        )
    return Pinhole(f, f, (width_px - 1) / 2, (height_px - 1) / 2, width_px, height_px)


def _detail(robot: RobotEndpoint, id: int, timeout_s: float) -> pb.ObjectDetail:
    """One instance of the object map with all details. Raises NotFound for an unknown id."""
    with invalid_as_not_found():
        return robot.bus.call(OBJECT_DETAIL, pb.ObjectRequest(object_id=id), timeout_s)


def _exported(
    robot: RobotEndpoint, request: Request, timeout_s: float, format: str, id: int = 0
) -> Response:
    """Response with the Gaussians of one object, or of all for id 0. Raises NotFound."""
    with invalid_as_not_found():
        reply = robot.bus.call(
            EXPORT_OBJECTS, pb.ExportRequest(format=format, object_id=id), timeout_s
        )
    return conditional_response(
        request, Encoded.of(reply.data, PLY, x_gaussians=str(reply.gaussians))
    )


def _rendered(
    robot: RobotEndpoint,
    T_world_cam: Matrix,
    lens: Pinhole,
    layer: str,
    name: str,
    timeout_s: float,
) -> Encoded:
    """PNG of a layer of the object map from a camera. Raises InvalidInput for an unknown class.

    T_world_cam: [4, 4]. name: class of the layers `probability` and `uncertainty`.
    """
    message = pb.RenderRequest(
        T_world_cam=transform_to_proto(T_world_cam),
        camera=pinhole_to_proto(lens),
        layer=layer,
        class_name=name,
    )
    return Encoded.of(robot.bus.call(RENDER_OBJECTS, message, timeout_s).png, PNG)


def _robot_side(robot: RobotEndpoint, center_m: np.ndarray) -> float:
    """Direction (rad) from a point to the robot; 0 if the robot's pose is unknown."""
    state = robot.monitor.robot().state
    if state is None or state.pose is None:
        return 0.0
    return math.atan2(state.pose.y_m - center_m[1], state.pose.x_m - center_m[0])
