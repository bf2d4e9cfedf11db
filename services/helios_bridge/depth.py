"""Depth for robots that have none: the detector makes it of the colour image.

It is filled in before a frame is published, so that every reader gets one whole frame.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import frame_to_proto
from helios_core.codec.images import depth_array
from helios_core.errors import InvalidInput
from helios_core.topics import ESTIMATE_DEPTH
from helios_core.types import Frame


def with_estimated_depth(frame: Frame, bus: Bus, timeout_s: float) -> Frame:
    """The frame with the detector's depth, and with its focal length where it used its own.

    Raises Unavailable or DeadlineExceeded without a detector, InvalidInput when that makes none.
    """
    message = frame_to_proto(replace(frame, depth_m=np.zeros(frame.color.shape[:2], np.float32)))
    request = pb.DepthRequest(raw_color=message.raw_color, calibration=message.calibration)
    reply = bus.call(ESTIMATE_DEPTH, request, timeout_s)
    depth_m = depth_array(reply.raw_depth, None)
    if depth_m.shape != frame.color.shape[:2]:
        raise InvalidInput(
            f"{reply.model} made depth of {depth_m.shape} for an image of {frame.color.shape[:2]}"
        )
    if not 0 < reply.focal_px < math.inf:
        raise InvalidInput(
            f"{reply.model} told a focal length of {reply.focal_px} pixels; wanted a positive one"
        )
    ratio = reply.focal_px / frame.camera.fx
    camera = replace(frame.camera, fx=frame.camera.fx * ratio, fy=frame.camera.fy * ratio)
    return replace(frame, depth_m=depth_m, camera=camera)
