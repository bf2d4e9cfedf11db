"""Pixels on the floor: they belong to no furniture (not in the paper).

A mask of furniture often covers floor beside it, and some detections cover nothing but floor. Floor
is everywhere, so such pixels would join furniture that stands apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.fusion.label_image import OTHER_LABEL, LabelImage


def below(reading: LabelImage, height_m: float) -> NDArray[np.bool_]:
    """Which pixels [h, w] lie below a height (m, world). Pixels without depth do not."""
    view, T = reading.view, reading.view.T_world_cam
    v, u = (np.arange(n, dtype=np.float32) for n in reading.depth_m.shape)
    right = np.float32(T[2, 0]) * (u - np.float32(view.cx)) / np.float32(view.fx)
    down = np.float32(T[2, 1]) * (v - np.float32(view.cy)) / np.float32(view.fy)
    rise = right[None, :] + down[:, None] + np.float32(T[2, 2])  # per metre of depth
    at_m = rise * reading.depth_m + np.float32(T[2, 3])
    return (at_m < height_m) & (reading.depth_m > 0)


def without_labels_below(
    reading: LabelImage, labels: Sequence[int], height_m: float | None
) -> LabelImage:
    """Label image in which pixels with these labels below a height (m, world) are unlabelled; None:
    all stay."""
    if height_m is None:
        return reading
    low = np.isin(reading.labels, labels) & below(reading, height_m)
    return replace(reading, labels=np.where(low, OTHER_LABEL, reading.labels).astype(np.int32))


def without_depth_below(reading: LabelImage, height_m: float | None) -> LabelImage:
    """Label image without depth below a height (m, world); None: all stays."""
    if height_m is None:
        return reading
    low = below(reading, height_m)
    return replace(reading, depth_m=np.where(low, np.float32(0), reading.depth_m))
