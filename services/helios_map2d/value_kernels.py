"""Numba kernels of the value layers; they touch only the view's window.

Reached through `value.py`; VLFM's formula stands beside them in the tests.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from helios_map2d.kernels import FAST, diamond_angle


@njit(cache=True, nogil=True, fastmath=FAST)
def farthest_by_azimuth(depth, intrinsics, rotation, heading, near, far, reach):
    """The farthest measured horizontal range (m) per azimuth bin; depth beyond `far` counts as it.

    `rotation` is float32 [2, 3], camera axes in world x and y; `reach` float32 [bins] is the result
    and 0 where nothing was measured.
    """
    h, w = depth.shape
    bins = reach.size
    bin_scale = np.float32(bins / 4.0)
    c, s = heading[0], heading[1]
    reach[:] = 0.0
    for v in range(h):
        dv = (np.float32(v) - intrinsics[3]) * intrinsics[1]
        for u in range(w):
            z = depth[v, u]
            if not z > near:
                continue
            z = min(z, far)
            du = (np.float32(u) - intrinsics[2]) * intrinsics[0]
            x = z * (rotation[0, 0] * du + rotation[0, 1] * dv + rotation[0, 2])
            y = z * (rotation[1, 0] * du + rotation[1, 1] * dv + rotation[1, 2])
            b = min(bins - 1, int(diamond_angle(c * x + s * y, c * y - s * x) * bin_scale))
            reach[b] = max(reach[b], math.sqrt(x * x + y * y))


@njit(cache=True, nogil=True, fastmath=FAST)
def fuse_value(
    value,  # float32 [rows, columns], the window of one layer
    confidence,  # float32 [rows, columns]
    score,
    camera_cells,  # float32 [2]: column, row in the window
    heading,  # float32 [2]
    cell_m,
    half_fov_rad,
    least_confidence,
    drop_below,
    reach,  # float32 [bins], from farthest_by_azimuth
):
    """VLFM's weighted average over the cone of view, cut off at the measured range."""
    rows, columns = value.shape
    bins = reach.size
    bin_scale = np.float32(bins / 4.0)
    c, s = heading[0], heading[1]
    for row in range(rows):
        dy = (np.float32(row) + np.float32(0.5) - camera_cells[1]) * cell_m
        for column in range(columns):
            dx = (np.float32(column) + np.float32(0.5) - camera_cells[0]) * cell_m
            forward = c * dx + s * dy
            left = c * dy - s * dx
            b = min(bins - 1, int(diamond_angle(forward, left) * bin_scale))
            limit = reach[b]
            if limit == 0.0:
                # A bin that fell between two pixels takes its nearer neighbour.
                limit = min(reach[b - 1], reach[(b + 1) % bins])
            if dx * dx + dy * dy > limit * limit or limit == 0.0:
                continue
            theta = min(abs(math.atan2(left, forward)) / half_fov_rad, 1.0)
            new = least_confidence + (1.0 - least_confidence) * math.cos(theta * math.pi / 2) ** 2
            old = confidence[row, column]
            if new < drop_below and new < old - 1e-6:  # the same view again is as good
                continue
            total = old + new
            value[row, column] = (old * value[row, column] + new * score) / total
            confidence[row, column] = (old * old + new * new) / total
