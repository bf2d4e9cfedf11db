"""Pixels on the floor: they belong to no furniture (not in the paper).

A mask of furniture often covers floor beside it, and some detections cover nothing but floor. Floor
is everywhere, so such pixels would join furniture that stands apart.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from helios_core.types import SearchContext
from numpy.typing import NDArray

from helios_objectmap.fusion.label_image import OTHER_LABEL, LabelImage
from helios_objectmap.instances.furniture import is_furniture
from helios_objectmap.instances.size_prior import usual_extents


def below(reading: LabelImage, height_m: float) -> NDArray[np.bool_]:
    """Which pixels [h, w] lie below a height (m, world). Pixels without depth do not."""
    view, T = reading.view, reading.view.T_world_cam
    v, u = (np.arange(n, dtype=np.float32) for n in reading.depth_m.shape)
    right = np.float32(T[2, 0]) * (u - np.float32(view.cx)) / np.float32(view.fx)
    down = np.float32(T[2, 1]) * (v - np.float32(view.cy)) / np.float32(view.fy)
    rise = right[None, :] + down[:, None] + np.float32(T[2, 2])  # per metre of depth
    at_m = rise * reading.depth_m + np.float32(T[2, 3])
    return (at_m < height_m) & (reading.depth_m > 0)


def without_floor(
    reading: LabelImage, context: SearchContext, height_m: float | None
) -> LabelImage:
    """Label image in which pixels of furniture below a height (m, world) are unlabelled; None: all
    stay. A rug, and any other class that is no higher than that, keeps its pixels."""
    if height_m is None:
        return reading
    large = [
        1 + i for i, c in enumerate(context.distinct())
        if (c.role.is_receptacle or is_furniture(c.name)) and not is_flat(c.name, height_m)
    ]  # fmt: skip
    on_floor = np.isin(reading.labels, large) & below(reading, height_m)
    labels = np.where(on_floor, OTHER_LABEL, reading.labels).astype(np.int32)
    return replace(reading, labels=labels)


def without_depth_below(reading: LabelImage, height_m: float | None) -> LabelImage:
    """Label image without depth below a height (m, world); None: all stays."""
    if height_m is None:
        return reading
    low = below(reading, height_m)
    return replace(reading, depth_m=np.where(low, np.float32(0), reading.depth_m))


def is_flat(class_name: str, height_m: float) -> bool:
    """True for a class that is usually no higher than `height_m` above the floor."""
    usual = usual_extents(class_name)
    return usual is not None and usual.on_floor and float(usual.most_m[2]) <= height_m
