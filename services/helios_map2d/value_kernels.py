"""Numba kernels of the value layers; they touch only the box that a view reached.

Reached through `value.py`; VLFM's formula stands beside them in the tests.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from helios_map2d.project_kernels import FAST, diamond_angle


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
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    last = np.int32(bins - 1)
    # Along the heading and to its left, as linear functions of the pixel.
    f0, f1 = c * rotation[0, 0] + s * rotation[1, 0], c * rotation[0, 1] + s * rotation[1, 1]
    f2 = c * rotation[0, 2] + s * rotation[1, 2]
    l0, l1 = c * rotation[1, 0] - s * rotation[0, 0], c * rotation[1, 1] - s * rotation[0, 1]
    l2 = c * rotation[1, 2] - s * rotation[0, 2]
    reach[:] = zero  # squared until the end
    at = np.empty(w, np.int32)
    squares = np.empty(w, np.float32)
    du = np.empty(w, np.float32)
    for u in range(w):
        du[u] = (np.float32(u) - intrinsics[2]) * intrinsics[0]
    for v in range(h):
        dv = (np.float32(v) - intrinsics[3]) * intrinsics[1]
        ahead, aside = f1 * dv + f2, l1 * dv + l2
        for u in range(w):  # without branches, so that it runs in SIMD
            z = depth[v, u]
            good = (z > near) & (z <= np.float32(np.inf))
            z = (z if z < far else far) if good else zero
            forward = f0 * du[u] + ahead
            left = l0 * du[u] + aside
            squares[u] = (forward * forward + left * left) * z * z
            total = abs(forward) + abs(left)
            a = left / (total if total > zero else one)
            back = two - a if left >= zero else -two - a
            b = np.int32((two + (a if forward >= zero else back)) * bin_scale)
            at[u] = b if b < last else last
        for u in range(w):
            reach[at[u]] = max(reach[at[u]], squares[u])
    for b in range(bins):
        reach[b] = math.sqrt(reach[b])


@njit(cache=True, nogil=True, fastmath=FAST)
def spread(
    cone,  # float32 [rows, columns] out: confidence of the view, 0 where it saw nothing
    camera_cells,  # float32 [2]: column, row in the window
    heading,  # float32 [2]
    cell_m,
    half_fov_rad,
    least_confidence,
    reach,  # float32 [bins], from farthest_by_azimuth
):
    """The confidence of each cell of a view's box, cut off at the measured range.

    Returns the box of what was seen within it: row_lo, row_hi, column_lo, column_hi.
    """
    rows, columns = cone.shape
    bins = reach.size
    bin_scale = np.float32(bins / 4.0)
    c, s = heading[0], heading[1]
    row_lo, row_hi, column_lo, column_hi = rows, 0, columns, 0
    for row in range(rows):
        dy = (np.float32(row) + np.float32(0.5) - camera_cells[1]) * cell_m
        for column in range(columns):
            cone[row, column] = 0.0
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
            cone[row, column] = (
                least_confidence + (1.0 - least_confidence) * math.cos(theta * math.pi / 2) ** 2
            )
            row_lo = min(row_lo, row)
            row_hi = row + 1
            column_lo = min(column_lo, column)
            column_hi = max(column_hi, column + 1)
    return row_lo, row_hi, column_lo, column_hi


@njit(cache=True, nogil=True, fastmath=FAST)
def fuse_average(value, confidence, cone, score, drop_below):
    """VLFM's average by confidence, over a box of one layer (float32 [rows, columns] all three)."""
    rows, columns = value.shape
    least = np.float32(1e-6)  # so that the same view again is as good
    one = np.float32(1.0)
    for row in range(rows):
        for column in range(columns):
            new, old, was = cone[row, column], confidence[row, column], value[row, column]
            kept = (new == 0.0) | ((new < drop_below) & (new < old - least))
            total = old + new
            share = one / (total if total > 0.0 else one)
            value[row, column] = was if kept else (old * was + new * score) * share
            confidence[row, column] = old if kept else (old * old + new * new) * share


@njit(cache=True, nogil=True, fastmath=FAST)
def fuse_maximum(value, confidence, cone, score, drop_below):
    """VLFM's other fusion: the more confident view decides."""
    rows, columns = value.shape
    for row in range(rows):
        for column in range(columns):
            new, old = cone[row, column], confidence[row, column]
            better = new > old
            value[row, column] = score if better else value[row, column]
            confidence[row, column] = new if better else old


@njit(cache=True, nogil=True)
def median_near(value, centres, radius, out):
    """VLFM's value of a place: the median of the non-zero cells within a radius; 0 if none.

    `centres` int32 [n, 2] row and column, `out` float64 [n].
    """
    rows, columns = value.shape
    reach = int(radius)
    found = np.empty((2 * reach + 1) ** 2, np.float32)
    for i in range(centres.shape[0]):
        row, column = centres[i, 0], centres[i, 1]
        n = 0
        for r in range(max(0, row - reach), min(rows, row + reach + 1)):
            for c in range(max(0, column - reach), min(columns, column + reach + 1)):
                inside = (r - row) ** 2 + (c - column) ** 2 <= radius * radius
                if inside and value[r, c] != 0.0:
                    found[n] = value[r, c]
                    n += 1
        out[i] = np.median(found[:n]) if n > 0 else 0.0
