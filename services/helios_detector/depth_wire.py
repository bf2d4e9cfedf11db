"""Messages of depth made from colour."""

from __future__ import annotations

import math

import numpy as np
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from helios_core import proto as pb
from helios_core.errors import InvalidInput

from helios_detector.backend import DepthEstimate


def focal_of(request: pb.DepthRequest, width: int) -> float | None:
    """The calibrated focal length in pixels of this image; None without a calibration."""
    K = request.calibration.K
    if not K:
        return None
    if len(K) != 9 or not math.isfinite(K[0]) or not 0.02 * width <= K[0] <= 100 * width:
        raise InvalidInput(
            f"the calibration's K is {list(K)[:9]} for an image {width} wide; send 9 numbers, row "
            "by row, in pixels of this image, or none"
        )
    return float(K[0])


def depth_to_proto(made: DepthEstimate, model: str) -> pb.DepthReply:
    height, width = made.depth_m.shape
    mm = np.rint(made.depth_m * 1000).astype("<u2")
    return pb.DepthReply(
        raw_depth=RawImage(width=width, height=height, encoding="16UC1", step=2 * width,
                           frame_id="camera", data=mm.tobytes()),
        focal_px=made.focal_px,
        model=model,
    )  # fmt: skip
