"""Projection of the depth image of one camera into another."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from helios_core.geometry import Matrix, Pinhole


def registered(
    depth_m: NDArray[np.float32], depth_camera: Pinhole, T_color_depth: Matrix, color: Pinhole
) -> NDArray[np.float32]:
    """Depth [h, w] of one pinhole camera, projected into another by `T_color_depth`; nearest wins.

    A pixel of a coarse depth image covers a block of colour pixels; 0 where no depth projects.
    """
    v, u = np.nonzero(depth_m > 0)
    z = depth_m[v, u].astype(np.float64)
    points = np.stack(
        [
            (u - depth_camera.cx) / depth_camera.fx * z,
            (v - depth_camera.cy) / depth_camera.fy * z,
            z,
        ]
    )
    x, y, z = T_color_depth[:3, :3] @ points + T_color_depth[:3, 3:]
    front = z > 1e-3
    x, y, z = x[front], y[front], z[front]
    column = np.rint(x / z * color.fx + color.cx).astype(np.int64)
    row = np.rint(y / z * color.fy + color.cy).astype(np.int64)
    out = np.full((color.height, color.width), np.inf, np.float32)
    width = max(1, math.ceil(color.fx / depth_camera.fx))
    for dr in range(-(width // 2), (width + 1) // 2):
        for dc in range(-(width // 2), (width + 1) // 2):
            r, c = row + dr, column + dc
            inside = (r >= 0) & (r < color.height) & (c >= 0) & (c < color.width)
            np.minimum.at(out, (r[inside], c[inside]), z[inside].astype(np.float32))
    out[np.isinf(out)] = 0.0
    return out
