"""Which points a past view shows. What it computes stands in `hindsight.py`."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def shown_kernel(
    points,
    T_cam_world,
    fx,
    fy,
    cx,
    cy,
    depth_mm,
    labels,
    nearest_m,
    agrees_m,
    agrees_share,
    which,
    label_of,
):
    """List in which [n] the points [n, 3] whose depth the pixel that they fall on agrees with, and
    in label_of [n] that pixel's label; returns how many."""
    n = 0
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        deep = T_cam_world[2, 0] * x + T_cam_world[2, 1] * y + T_cam_world[2, 2] * z
        deep += T_cam_world[2, 3]
        if deep < nearest_m:
            continue
        right = T_cam_world[0, 0] * x + T_cam_world[0, 1] * y + T_cam_world[0, 2] * z
        down = T_cam_world[1, 0] * x + T_cam_world[1, 1] * y + T_cam_world[1, 2] * z
        u = np.floor((right + T_cam_world[0, 3]) / deep * fx + cx + 0.5)
        v = np.floor((down + T_cam_world[1, 3]) / deep * fy + cy + 0.5)
        if u < 0 or v < 0 or u >= depth_mm.shape[1] or v >= depth_mm.shape[0]:
            continue
        measured_m = depth_mm[int(v), int(u)] / 1000.0
        if measured_m > 0 and abs(measured_m - deep) < max(agrees_m, agrees_share * deep):
            which[n], label_of[n] = k, labels[int(v), int(u)]
            n += 1
    return n
