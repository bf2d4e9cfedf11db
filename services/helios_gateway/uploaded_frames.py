"""Conversion of a frame uploaded over HTTP, two image files and metadata, to one message."""

from __future__ import annotations

import time
from typing import Annotated

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from helios_core import proto as pb
from helios_core.codec.frames import pose_to_proto
from helios_core.codec.images import check_color_depth, decode_image, encoded_size
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix, is_rigid
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from helios_gateway.request_validation import errors_text

MM = 0.001  # metres per unit of a depth image, as on the bus

Row = Annotated[list[float], Field(min_length=4, max_length=4)]
Pose = Annotated[list[Row], Field(min_length=4, max_length=4)]


class FrameMeta(BaseModel):
    """Metadata of an uploaded frame."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    K: Annotated[list[float], Field(min_length=9, max_length=9)] = Field(
        description="intrinsics in pixels of the images, row by row: fx, 0, cx, 0, fy, cy, 0, 0, 1",
        examples=[[525.0, 0, 319.5, 0, 525.0, 239.5, 0, 0, 1]],
    )
    T_world_cam: Pose = Field(
        description="4x4, four rows: takes points of the camera (x right, y down, z forward) to "
        "the world (z up, floor at 0), metres",
        examples=[[[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1.2], [0, 0, 0, 1]]],
    )
    T_world_base: Pose | None = Field(
        default=None, description="4x4: the robot on the floor; without it, below the camera"
    )
    stamp_ns: int | None = Field(
        default=None, ge=0, lt=2**63, description="your clock; without it, this machine's"
    )
    depth_scale_m: float = Field(
        default=MM, gt=0, le=1, description="metres per unit of the depth image (TUM: 0.0002)"
    )
    robot_boot_id: str = Field(
        default="",
        max_length=64,
        description="id of the robot's run; poses with the same id share an origin; empty: an id "
        "of the bridge",
    )
    world_epoch: int = Field(
        default=0, ge=0, lt=2**32, description="increase by 1 when your localisation jumps"
    )
    origin_id: str = Field(
        default="",
        max_length=64,
        description="name of the origin of your poses; a later run with the same name continues "
        "the maps of this run; empty: every run begins new maps",
    )
    classes: list[str] = Field(
        default=[], max_length=64, description="what to look for from now on; empty: as before"
    )
    wait_s: float = Field(
        default=5.0, ge=0, le=60, description="longest wait for the maps' answers; 0: none"
    )


class MapAnswer(BaseModel):
    """Acknowledgement of a frame by one map."""

    map: str = Field(examples=["map2d/occupancy"])
    accepted: bool = Field(description="the map used the frame")
    reason: str = Field(description="why it was refused; empty where it was not")
    version: int = Field(description="of the map after it")
    update_ms: float = Field(description="time that the update took")


class FrameTaken(BaseModel):
    """Frame that became a keyframe, with the acknowledgements of the maps."""

    id: str = Field(description="boot/epoch/number", examples=["3f0c…/0/1795264888805"])
    integrated: bool = Field(description="every map that was to answer has taken it")
    maps: list[MapAnswer] = Field(description="in the order of their answers")
    unanswered: list[str] = Field(description="maps that gave no answer within wait_s")


def read_meta(text: str | bytes) -> FrameMeta:
    """Parsed metadata. Raises InvalidInput that names the error."""
    try:
        return FrameMeta.model_validate_json(text)
    except ValidationError as error:
        raise InvalidInput(
            f"meta is wrong: {errors_text(error.errors())}; send JSON with at least K "
            "and T_world_cam"
        ) from error


def push_request(meta: FrameMeta, color: bytes, depth: bytes | None) -> pb.PushRequest:
    """Message for the bridge with one frame.

    color: a JPEG or PNG. depth: a PNG with one channel of 16 bit; None for a frame without depth.
    Raises InvalidInput. The bridge checks the rest.
    """
    size = encoded_size(color)
    if size is None:
        raise InvalidInput(
            f"color is {len(color)} bytes that are no JPEG or PNG; send a whole image file"
        )
    check_color_depth(color, "color")
    if [meta.K[i] for i in (1, 3, 6, 7, 8)] != [0, 0, 0, 0, 1]:
        raise InvalidInput(
            f"K is {meta.K}; send fx, 0, cx, 0, fy, cy, 0, 0, 1: row by row, and without skew"
        )
    stamp_ns = time.time_ns() if meta.stamp_ns is None else meta.stamp_ns
    frame = pb.Frame(keyframe=True, origin_id=meta.origin_id)
    frame.id.robot_boot_id, frame.id.world_epoch = meta.robot_boot_id, meta.world_epoch
    frame.stamp.FromNanoseconds(stamp_ns)
    frame.compressed_color.CopyFrom(CompressedImage(data=color, format=_format(color)))
    if depth:
        _add_depth(frame, depth, meta.depth_scale_m)
    frame.calibration.CopyFrom(CameraCalibration(width=size[0], height=size[1], K=meta.K))
    frame.T_world_cam.CopyFrom(pose_to_proto(_transform(meta.T_world_cam, "T_world_cam"), stamp_ns))
    if meta.T_world_base is not None:
        T_world_base = _transform(meta.T_world_base, "T_world_base")
        frame.T_world_base.CopyFrom(pose_to_proto(T_world_base, stamp_ns))
    return pb.PushRequest(frame=frame, wait_s=meta.wait_s, classes=meta.classes)


def push_response(reply: pb.PushReply) -> FrameTaken:
    """HTTP model of the bridge's reply."""
    maps = [
        MapAnswer(
            map=f"{a.service}/{a.part}",
            accepted=a.accepted,
            reason=a.reason,
            version=a.version,
            update_ms=a.update_ms,
        )
        for a in reply.acks
    ]
    return FrameTaken(
        id=f"{reply.id.robot_boot_id}/{reply.id.world_epoch}/{reply.id.seq}",
        integrated=bool(maps) and not reply.unanswered and all(m.accepted for m in maps),
        maps=maps,
        unanswered=list(reply.unanswered),
    )


def _add_depth(frame: pb.Frame, depth: bytes, scale_m: float) -> None:
    image = CompressedImage(data=depth, format=_format(depth))
    if scale_m == MM:
        frame.compressed_depth.CopyFrom(image)
        return
    units = decode_image(image, cv2.IMREAD_UNCHANGED, "depth")
    if units.dtype != np.uint16 or units.ndim != 2:
        raise InvalidInput(
            f"depth decodes to {units.dtype} {units.shape}; send a PNG with one channel of 16 bit"
        )
    height, width = units.shape
    depth_m = (units * np.float32(scale_m)).astype("<f4")
    frame.raw_depth.CopyFrom(
        RawImage(
            width=width, height=height, encoding="32FC1", step=4 * width, data=depth_m.tobytes()
        )
    )


def _transform(rows: list[list[float]], name: str) -> Matrix:
    T = np.array(rows, np.float64)
    if not is_rigid(T):
        raise InvalidInput(
            f"{name} is no rigid transform: {rows}; send a right-handed rotation and metres"
        )
    return T


def _format(data: bytes) -> str:
    return "jpeg" if data[:2] == b"\xff\xd8" else "png"
