"""Upright box of an object, turned as its outline is. For viewers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from helios_core import proto as pb

LEAST_BOX_M = 0.02  # keeps flat boxes visible


@dataclass(frozen=True)
class UprightBox:
    """Box in the frame of the map, its z axis up; yaw_rad is in (-π/4, π/4]."""

    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    yaw_rad: float = 0.0


def upright_box(o: pb.ObjectInstance, least_m: float = 0.0) -> UprightBox | None:
    """Smallest upright box around the object's outline; its box along the axes without an outline.

    No side is shorter than `least_m`. Returns None if a figure is not finite.
    """
    x, y, z = o.center_m.x, o.center_m.y, o.center_m.z
    width, depth, height = o.size_m.x, o.size_m.y, o.size_m.z
    yaw_rad = 0.0
    if len(o.outline_m) >= 6 and len(o.outline_m) % 2 == 0:
        outline = np.array(o.outline_m, np.float32).reshape(-1, 2)
        if np.isfinite(outline).all():
            middle = outline.mean(axis=0)
            (dx, dy), (width, depth), degrees = cv2.minAreaRect(outline - middle)
            x, y, yaw_rad = float(middle[0]) + dx, float(middle[1]) + dy, math.radians(degrees)
    quarters = math.ceil(yaw_rad / (math.pi / 2) - 0.5)
    if quarters % 2:
        width, depth = depth, width
    size = [max(float(v), least_m) for v in (width, depth, height)]
    if not all(map(math.isfinite, (x, y, z, *size))):
        return None
    return UprightBox((x, y, z), (size[0], size[1], size[2]), yaw_rad - quarters * math.pi / 2)
