"""Estimated depth for robots without a depth sensor: the detector computes it from the image.

It is added before a frame is published, so that every subscriber gets a complete frame.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import frame_to_proto
from helios_core.codec.images import estimated_depth
from helios_core.topics import ESTIMATE_DEPTH
from helios_core.types import Frame


def with_estimated_depth(frame: Frame, bus: Bus, timeout_s: float) -> Frame:
    """Frame with the detector's depth, and with its focal length if it estimated one.

    Raises Unavailable or DeadlineExceeded without a detector, InvalidInput if it makes no depth.
    """
    message = frame_to_proto(replace(frame, depth_m=np.zeros(frame.color.shape[:2], np.float32)))
    request = pb.DepthRequest(raw_color=message.raw_color, calibration=message.calibration)
    reply = bus.call(ESTIMATE_DEPTH, request, timeout_s)
    height, width = frame.color.shape[:2]
    depth_m = estimated_depth(reply, (height, width))
    ratio = reply.focal_px / frame.camera.fx
    camera = replace(frame.camera, fx=frame.camera.fx * ratio, fy=frame.camera.fy * ratio)
    return replace(frame, depth_m=depth_m, camera=camera)
