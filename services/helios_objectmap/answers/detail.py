"""What a gripper wants to know of an object: points on its surface, and a tight upright box."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

THIN_M = 0.005


@dataclass(frozen=True)
class Grasp:
    """The believed part of an object."""

    points_m: NDArray[np.float32]  # [k, 3] world, one per THIN_M
    center_m: NDArray[np.float64]  # [3] of the box
    size_m: NDArray[np.float64]  # [3] along the box's own axes; x is the narrow side
    yaw_rad: float  # of the box's x axis in the ground plane: in which a gripper closes


def grasp(points_m: NDArray[np.float32]) -> Grasp:
    """points_m: [n, 3] world, n at least 1. The box is the smallest upright one around them."""
    cells = np.floor(points_m.astype(np.float64) / THIN_M).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    kept = points_m[np.sort(first)]
    (x, y), (width, depth), angle_deg = cv2.minAreaRect(np.ascontiguousarray(kept[:, :2]))
    yaw = np.radians(angle_deg)
    if width > depth:
        width, depth, yaw = depth, width, yaw + np.pi / 2
    low, high = float(kept[:, 2].min()), float(kept[:, 2].max())
    return Grasp(
        kept,
        np.array([x, y, (low + high) / 2]),
        np.array([width, depth, high - low]),
        float((yaw + np.pi / 2) % np.pi - np.pi / 2),
    )
