"""Label image: depth, colour and classes of an observation, on the pixel grid of the object map."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.types import Detection, Observation, SearchContext
from numpy.typing import NDArray

from helios_objectmap.camera import View, offset

OTHER_LABEL = 0


@dataclass(frozen=True)
class LabelImage:
    """Depth, colour and class labels of one view."""

    view: View
    depth_m: NDArray[np.float32]  # [h, w], 0 = invalid, too near or too far
    color: NDArray[np.uint8]  # [h, w, 3]
    labels: NDArray[np.int32]  # [h, w], 0 = other, 1 + i = class i of the context


def read(
    observation: Observation,
    context: SearchContext,
    stride: int,
    min_depth_m: float,
    max_depth_m: float,
    by_score: bool = False,
) -> LabelImage:
    """Sample an observation every `stride` pixels and paint its masks.

    A pixel gets the class of the smallest mask there. by_score: of masks of one size the detection
    with the highest score wins; else the alphabetically last class. Raises InvalidInput for an
    image with a side shorter than the stride.
    """
    frame, camera = observation.frame, observation.frame.camera
    view = View(
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        camera.width,
        camera.height,
        np.asarray(frame.T_world_cam, np.float64),
    )
    if min(camera.width, camera.height) < stride:
        raise InvalidInput(
            f"the image has {camera.width}x{camera.height} pixels, and the object map takes one in "
            f"{stride} along each side; send a larger image, or lower HELIOS_OBJECTMAP_STRIDE_PX"
        )
    first = offset(stride)
    grid = (slice(first, None, stride), slice(first, None, stride))
    depth_m = np.ascontiguousarray(frame.depth_m[grid], np.float32)
    usable = (depth_m >= min_depth_m) & (depth_m <= max_depth_m)  # False for NaN
    depth_m = np.where(usable, depth_m, np.float32(0))
    labels = np.zeros(depth_m.shape, np.int32)
    classes = context.distinct()
    number = {c.name: 1 + i for i, c in enumerate(classes)}
    threshold = {c.name: c.threshold for c in classes}
    # Small masks are painted last, so that a table does not cover the mug on it.
    counted = (
        d
        for d in observation.detections
        if d.class_name in number and d.score >= threshold[d.class_name]
    )

    def order(d: Detection) -> tuple[int, float, str, tuple[float, ...]]:
        least_first = d.score if by_score else 0.0
        return -int(np.count_nonzero(d.mask)), least_first, d.class_name, tuple(d.box_xyxy)

    for d in sorted(counted, key=order):
        labels[d.mask[grid]] = number[d.class_name]
    # The colours are not copied: few pixels are read later.
    return LabelImage(view.strided(stride), depth_m, frame.color[grid], labels)


def without_held(
    reading: LabelImage, context: SearchContext, held: str, held_object_m: float
) -> LabelImage:
    """Label image without the held object: near pixels of all object classes become unlabelled.

    All object classes count, because a detector may confuse the held object with another one.
    Receptacles stay. held: class name of the held object, "" for none.
    """
    if not held:
        return reading
    things = [1 + i for i, c in enumerate(context.distinct()) if not c.role.is_receptacle]
    mine = np.isin(reading.labels, things) & (reading.depth_m < held_object_m)
    return replace(
        reading,
        depth_m=np.where(mine, np.float32(0), reading.depth_m),
        labels=np.where(mine, OTHER_LABEL, reading.labels).astype(np.int32),
    )
