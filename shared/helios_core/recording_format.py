"""Format of a recording: the channels of an MCAP file, and the splitting of a Frame into parts.

The pixels of a Frame go into channels of Foxglove types, which any viewer shows; the rest of the
Frame, its head, goes into a HELIOS channel. Head and pixels have the same log time, which no other
frame has. `join_frame` restores the Frame; a keyframe is restored bit by bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from numpy.typing import NDArray

from helios_core import proto as pb
from helios_core.codec.images import (
    color_array,
    decode_image,
    depth_mm_array,
    raw_image_array,
)
from helios_core.errors import InvalidInput
from helios_core.topics import FRAME, KEYFRAME, Topic

PROFILE = "helios.v1"
SUFFIX = ".mcap"
CALIBRATION = "/camera/calibration"
TRANSFORMS = "/tf"
LOG = "/log"
ANNOTATIONS = "/detector/annotations"
MAPS = "/map/"  # prefix of all channels with the robot's maps and plans
OCCUPANCY = "/map/occupancy"  # foxglove.Grid
VALUES = "/map/value/"  # followed by the layer's name; foxglove.Grid
OBSTACLES = "/map/obstacles"  # foxglove.PointCloud
GAUSSIANS = "/map/gaussians"  # foxglove.PointCloud
FRONTIERS = "/map/frontiers"  # foxglove.SceneUpdate, as the next four
TRAJECTORY = "/map/trajectory"
OBJECTS = "/map/objects"
PLAN = "/map/plan"
CANDIDATES = "/map/candidates"
PATH = "/map/path"  # foxglove.PosesInFrame
PIXELS = frozenset({"raw_color", "compressed_color", "raw_depth", "compressed_depth"})


@dataclass(frozen=True)
class FrameChannels:
    """Channels of the parts of a Frame."""

    head: str
    color: str  # foxglove.CompressedImage
    depth: str  # foxglove.RawImage


def channel_of(topic: Topic) -> str:
    """Channel of a HELIOS topic; it holds frames without their pixels."""
    return f"/{topic.name}"


KEYFRAME_CHANNELS = FrameChannels(
    channel_of(KEYFRAME), "/camera/keyframe/color", "/camera/keyframe/depth"
)
STREAM_CHANNELS = FrameChannels(channel_of(FRAME), "/camera/color", "/camera/depth")


@dataclass(frozen=True)
class FrameParts:
    """Parts of a Frame."""

    head: pb.Frame  # without pixels, but with sizes and encodings
    color: CompressedImage
    depth: RawImage


def split_frame(frame: pb.Frame, jpeg_quality: int | None) -> FrameParts:
    """Split a frame. Depth is lossless; so is colour if `jpeg_quality` is None or the frame has a
    compressed image. Raises InvalidInput for inconsistent images."""
    head = head_of(frame)
    if frame.HasField("compressed_color"):
        color = frame.compressed_color
    else:
        color = CompressedImage(frame_id=frame.raw_color.frame_id)
        rgb = color_array(frame.raw_color, None) if frame.HasField("raw_color") else None
        if rgb is None:
            raise InvalidInput("the frame has no colour image; send raw_color or compressed_color")
        color.data, color.format = _encoded(rgb, jpeg_quality)
    if frame.HasField("raw_depth"):
        depth = frame.raw_depth
        raw_image_array(depth, "the depth image")
    else:
        pixels = depth_mm_array(frame.compressed_depth)
        height, width = pixels.shape
        depth = RawImage(
            width=width,
            height=height,
            encoding="16UC1",
            step=2 * width,
            frame_id=frame.compressed_depth.frame_id,
            data=pixels.astype("<u2").tobytes(),
        )
        head.raw_depth.CopyFrom(_without_data(depth))
    stamped_depth = depth if depth.HasField("timestamp") else _stamped(depth, frame)
    stamped_color = color if color.HasField("timestamp") else _stamped(color, frame)
    return FrameParts(head, stamped_color, stamped_depth)


def join_frame(head: pb.Frame, color: CompressedImage, depth: RawImage) -> pb.Frame:
    """Frame from the parts that `split_frame` made. Raises InvalidInput for a broken image."""
    out = pb.Frame()
    out.CopyFrom(head)
    if head.HasField("raw_color"):
        bgr = decode_image(color, cv2.IMREAD_COLOR, "the recorded colour image")
        if bgr.shape[:2] != (head.raw_color.height, head.raw_color.width):
            raise InvalidInput(
                f"the recorded colour image is {bgr.shape[1]}x{bgr.shape[0]}, its frame says "
                f"{head.raw_color.width}x{head.raw_color.height}"
            )
        is_rgb = head.raw_color.encoding == "rgb8"
        pixels = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB) if is_rgb else bgr
        out.raw_color.data = np.ascontiguousarray(pixels).tobytes()
        out.raw_color.step = 3 * head.raw_color.width
    else:
        out.compressed_color.data = color.data
    out.raw_depth.data = depth.data
    return out


def head_of(frame: pb.Frame) -> pb.Frame:
    """Copy of a frame without pixels."""
    out = pb.Frame()
    for field, value in frame.ListFields():
        if field.name in PIXELS:
            continue
        if field.message_type is None:
            setattr(out, field.name, value)
        else:
            getattr(out, field.name).CopyFrom(value)
    for field in ("raw_color", "raw_depth"):
        if frame.HasField(field):
            getattr(out, field).CopyFrom(_without_data(getattr(frame, field)))
    if frame.HasField("compressed_color"):
        out.compressed_color.format = frame.compressed_color.format
        out.compressed_color.frame_id = frame.compressed_color.frame_id
        if frame.compressed_color.HasField("timestamp"):
            out.compressed_color.timestamp.CopyFrom(frame.compressed_color.timestamp)
    return out


def _without_data(image: RawImage) -> RawImage:
    out = RawImage(
        width=image.width,
        height=image.height,
        encoding=image.encoding,
        step=image.step,
        frame_id=image.frame_id,
    )
    if image.HasField("timestamp"):
        out.timestamp.CopyFrom(image.timestamp)
    return out


def _stamped(image, frame: pb.Frame):
    """Copy of an image with the frame's stamp, which viewers need in the image itself."""
    out = type(image)()
    out.CopyFrom(image)
    out.timestamp.CopyFrom(frame.stamp)
    return out


def _encoded(rgb: NDArray[np.uint8], jpeg_quality: int | None) -> tuple[bytes, str]:
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    if jpeg_quality is None:
        good, data = cv2.imencode(".png", bgr)
    else:
        good, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    if not good:
        raise InvalidInput("the colour image cannot be encoded")
    return data.tobytes(), "png" if jpeg_quality is None else "jpeg"
