"""Camera and viewpoint for a rendered image of one object."""

from __future__ import annotations

import math

import numpy as np
from helios_core.geometry import Matrix, Pinhole

ELEVATION_RAD = math.radians(35)
NEAREST_M = 0.5
FILLS = 0.55  # share of the image height that the object fills
FOV_RAD = math.radians(50)


def camera(size_px: int) -> Pinhole:
    """Pinhole camera of a square image."""
    f = size_px / 2 / math.tan(FOV_RAD / 2)
    middle = (size_px - 1) / 2
    return Pinhole(fx=f, fy=f, cx=middle, cy=middle, width=size_px, height=size_px)


def look_at(center_m: np.ndarray, size_m: np.ndarray, azimuth_rad: float) -> Matrix:
    """T_world_cam [4, 4] (OpenCV) of a camera that sees all of a box from above its side.

    center_m, size_m: [3] in the world; azimuth_rad: direction to the camera, about world z.
    """
    across_m = float(np.linalg.norm(size_m))
    distance_m = max(NEAREST_M, across_m / (2 * FILLS * math.tan(FOV_RAD / 2)))
    level, rise = math.cos(ELEVATION_RAD), math.sin(ELEVATION_RAD)
    towards = np.array([level * math.cos(azimuth_rad), level * math.sin(azimuth_rad), rise])
    forward = -towards
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    T_world_cam = np.eye(4)
    T_world_cam[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    T_world_cam[:3, 3] = center_m + distance_m * towards
    return T_world_cam
