"""Conversion of captures to protobuf messages and back."""

from __future__ import annotations

import numpy as np
from helios_core import proto as pb
from helios_core.codec import (
    pinhole_from_proto,
    pinhole_to_proto,
    transform_from_proto,
    transform_to_proto,
)
from helios_core.codec.frames import depth_to_mm
from helios_core.errors import InvalidInput
from helios_core.robot import Capture


def capture_to_proto(capture: Capture) -> pb.WorldCapture:
    """Message of a capture; depth is rounded to millimetres, as `depth_to_mm` says."""
    return pb.WorldCapture(
        color=capture.color.tobytes(),
        depth_mm=depth_to_mm(capture.depth_m).tobytes(),
        camera=pinhole_to_proto(capture.camera),
        T_world_cam=transform_to_proto(capture.T_world_cam),
        T_world_base=transform_to_proto(capture.T_world_base),
        stamp_ns=capture.stamp_ns,
    )


def capture_from_proto(message: pb.WorldCapture) -> Capture:
    """Capture of a message. Raises InvalidInput when the images do not have the camera's size."""
    camera = pinhole_from_proto(message.camera)
    shape = (camera.height, camera.width)
    pixels = camera.height * camera.width
    if len(message.color) != 3 * pixels or len(message.depth_mm) != 2 * pixels:
        raise InvalidInput(
            f"a capture of {camera.width}x{camera.height} came with {len(message.color)} bytes of "
            f"colour and {len(message.depth_mm)} of depth; wanted {3 * pixels} and {2 * pixels}"
        )
    depth_mm = np.frombuffer(message.depth_mm, "<u2").reshape(shape)
    return Capture(
        stamp_ns=message.stamp_ns,
        color=np.frombuffer(message.color, np.uint8).reshape(*shape, 3),
        depth_m=depth_mm.astype(np.float32) * np.float32(1e-3),
        camera=camera,
        T_world_cam=transform_from_proto(message.T_world_cam, "T_world_cam"),
        T_world_base=transform_from_proto(message.T_world_base, "T_world_base"),
    )
