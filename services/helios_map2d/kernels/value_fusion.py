"""Numba kernels of the value layers; they process only the box that a view covers.

Called by `layers/value_layers.py`; the tests compare them with VLFM's formula.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from helios_map2d.kernels.depth_projection import FAST, diamond_angle, take_row


@njit(cache=True, nogil=True, fastmath=FAST)
def farthest_by_azimuth(depth, step, intrinsics, rotation, heading, near, far, reach):
    """Write the farthest measured horizontal range (m) per azimuth bin; depth is cut at `far`.

    It processes every `step`-th pixel of every `step`-th row. `rotation` is float32 [2, 3], camera
    axes in world x and y; `reach` float32 [bins] is the result, 0 in bins without a measurement.
    """
    h, w = depth.shape
    n = (w - 1) // step + 1
    bins = reach.size
    bin_scale = np.float32(bins / 4.0)
    c, s = heading[0], heading[1]
    zero = np.float32(0.0)
    last = np.int32(bins - 1)
    # Components along the heading and to its left, as linear functions of the pixel.
    f0, f1 = c * rotation[0, 0] + s * rotation[1, 0], c * rotation[0, 1] + s * rotation[1, 1]
    f2 = c * rotation[0, 2] + s * rotation[1, 2]
    l0, l1 = c * rotation[1, 0] - s * rotation[0, 0], c * rotation[1, 1] - s * rotation[0, 1]
    l2 = c * rotation[1, 2] - s * rotation[0, 2]
    reach[:] = zero  # squared until the end
    at, squares = np.empty(n, np.int32), np.empty(n, np.float32)
    around, across = np.empty((1, n), np.float32), np.empty(n, np.float32)
    for i in range(n):
        across[i] = (np.float32(i * step) - intrinsics[2]) * intrinsics[0]
    for v in range(0, h, step):
        dv = (np.float32(v) - intrinsics[3]) * intrinsics[1]
        ahead, aside = f1 * dv + f2, l1 * dv + l2
        take_row(depth, v, step, around)
        for i in range(n):  # branch-free, so that it runs in SIMD
            z = around[0, i]
            good = (z > near) & (z <= np.float32(np.inf))
            z = (z if z < far else far) if good else zero
            forward, left = f0 * across[i] + ahead, l0 * across[i] + aside
            squares[i] = (forward * forward + left * left) * z * z
            b = np.int32(diamond_angle(forward, left) * bin_scale)
            at[i] = b if b < last else last
        for i in range(n):
            b = np.uint32(at[i])
            reach[b] = max(reach[b], squares[i])
    for b in range(bins):
        reach[b] = math.sqrt(reach[b])


@njit(cache=True, nogil=True, inline="always", fastmath=FAST)
def angle_off(forward, left):
    """Angle (rad) between a direction and straight ahead, 0..pi, to within 2e-5; runs in SIMD."""
    f, s = abs(forward), abs(left)
    long = f if f > s else s
    a = (s if f > s else f) / (long if long > np.float32(0.0) else np.float32(1.0))
    q = a * a
    p = np.float32(-0.01172120) * q + np.float32(0.05265332)
    p = (p * q + np.float32(-0.11643287)) * q + np.float32(0.19354346)
    p = ((p * q + np.float32(-0.33262347)) * q + np.float32(0.99997726)) * a
    p = p if f > s else np.float32(math.pi / 2) - p
    return p if forward >= np.float32(0.0) else np.float32(math.pi) - p


@njit(cache=True, nogil=True, inline="always", fastmath=FAST)
def cosine_squared(share):
    """cos²(share * pi / 2) for 0 <= share <= 1, to within 4e-6, as (1 - sin x) / 2, in SIMD."""
    x = (share - np.float32(0.5)) * np.float32(math.pi)
    q = x * x
    p = np.float32(1 / 362880) * q - np.float32(1 / 5040)
    p = (p * q + np.float32(1 / 120)) * q - np.float32(1 / 6)
    return np.float32(0.5) + np.float32(0.5) * (p * q + np.float32(1.0)) * -x


@njit(cache=True, nogil=True, fastmath=FAST)
def spread(
    cone,  # float32 [rows, columns] out: confidence of the view, 0 in unseen cells
    camera_cells,  # float32 [2]: column, row in the window
    heading,  # float32 [2]
    cell_m,
    half_fov_rad,
    least_confidence,
    reach,  # float32 [bins], from farthest_by_azimuth
):
    """Write the confidence of each cell of a view's box; 0 beyond the measured range.

    Returns the box of seen cells within it: row_lo, row_hi, column_lo, column_hi.
    """
    rows, columns = cone.shape
    bins = reach.size
    bin_scale = np.float32(bins / 4.0)
    c, s = heading[0], heading[1]
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    last = np.int32(bins - 1)
    limits = np.empty(bins, np.float32)  # squared; negative in unseen bins
    for b in range(bins):
        far = reach[b]
        if far == zero:  # a bin between two pixels takes the smaller of its neighbours
            far = min(reach[b - 1], reach[(b + 1) % bins])
        limits[b] = far * far if far > zero else -one
    at, cut = np.empty(columns, np.int32), np.empty(columns, np.float32)
    touched = np.zeros(columns, np.uint8)
    row_lo, row_hi = rows, 0
    for row in range(rows):
        line = cone[row]
        dy = (np.float32(row) + half - camera_cells[1]) * cell_m
        for i in range(columns):
            dx = (np.float32(i) + half - camera_cells[0]) * cell_m
            b = np.int32(diamond_angle(c * dx + s * dy, c * dy - s * dx) * bin_scale)
            at[i] = b if b < last else last
        for i in range(columns):
            cut[i] = limits[np.uint32(at[i])]
        most = zero
        for i in range(columns):
            dx = (np.float32(i) + half - camera_cells[0]) * cell_m
            theta = angle_off(c * dx + s * dy, c * dy - s * dx) / half_fov_rad
            share = theta if theta < one else one
            sure = least_confidence + (one - least_confidence) * cosine_squared(share)
            line[i] = sure if dx * dx + dy * dy <= cut[i] else zero
            most = max(most, line[i])
        if most > zero:
            row_lo, row_hi = min(row_lo, row), row + 1
            for i in range(columns):
                touched[i] |= line[i] > zero
    seen = np.flatnonzero(touched)
    if seen.size == 0:
        return rows, 0, columns, 0
    return row_lo, row_hi, seen[0], seen[-1] + 1


@njit(cache=True, nogil=True, fastmath=FAST)
def fuse_average(value, confidence, corner, cone, box, score, drop_below):
    """Fuse a score into one layer with VLFM's average weighted by confidence.

    `value`, `confidence` float32 over the whole map; `cone` [rows, columns] has its first cell at
    `corner` (row, column) of the map; only its `box` (row_lo, row_hi, column_lo, column_hi) is
    processed.
    """
    least = np.float32(1e-6)  # tolerance, so that an equal view is not dropped
    zero, one = np.float32(0.0), np.float32(1.0)
    n = box[3] - box[2]
    at = corner[1] + box[2]
    for row in range(box[0], box[1]):
        # Slices of rows are contiguous, which SIMD needs.
        layer, sure = value[corner[0] + row][at : at + n], confidence[corner[0] + row][at : at + n]
        seen = cone[row][box[2] : box[3]]
        for i in range(n):
            new, old, was = seen[i], sure[i], layer[i]
            kept = (new == zero) | ((new < drop_below) & (new < old - least))
            total = old + new
            share = one / (total if total > zero else one)
            layer[i] = was if kept else (old * was + new * score) * share
            sure[i] = old if kept else (old * old + new * new) * share


@njit(cache=True, nogil=True, fastmath=FAST)
def fuse_maximum(value, confidence, corner, cone, box, score, drop_below):
    """Fuse a score with VLFM's other rule: the more confident view decides. Parameters as in
    `fuse_average`."""
    n = box[3] - box[2]
    at = corner[1] + box[2]
    for row in range(box[0], box[1]):
        layer, sure = value[corner[0] + row][at : at + n], confidence[corner[0] + row][at : at + n]
        seen = cone[row][box[2] : box[3]]
        for i in range(n):
            new, old = seen[i], sure[i]
            better = new > old
            layer[i] = score if better else layer[i]
            sure[i] = new if better else old


@njit(cache=True, nogil=True)
def median_near(value, centres, radius, out):
    """Write VLFM's value of a place: the median of the non-zero cells within a radius; 0 if none.

    `centres` int32 [n, 2] row and column, `out` float64 [n].
    """
    rows, columns = value.shape
    reach = int(radius)
    found = np.empty((2 * reach + 1) ** 2 + 1, np.float32)
    for i in range(centres.shape[0]):
        row, column = centres[i, 0], centres[i, 1]
        n = 0
        for r in range(max(0, row - reach), min(rows, row + reach + 1)):
            half = int(math.sqrt(radius * radius - (r - row) ** 2))
            line = value[r][max(0, column - half) : min(columns, column + half + 1)]
            for j in range(line.size):
                found[n] = line[j]
                n += line[j] != 0.0
        out[i] = median(found[:n]) if n > 0 else 0.0


@njit(cache=True, nogil=True)
def median(values):
    """Median of float32 values, by bisection of their bits; each step runs in SIMD."""
    n = values.size
    keys = np.empty(n, np.int32)
    bits = values.view(np.int32)
    for i in range(n):  # keys whose integer order is the order of the values
        keys[i] = bits[i] ^ ((bits[i] >> 31) & 0x7FFFFFFF)
    low, high = np.int64(keys.min()), np.int64(keys.max())
    wanted = (n + 1) // 2
    while low < high:
        middle = np.int32((low + high) >> 1)
        below = 0
        for i in range(n):
            below += keys[i] <= middle
        if below >= wanted:
            high = np.int64(middle)
        else:
            low = np.int64(middle) + 1
    upper = np.int64(keys.max())
    below = 0
    for i in range(n):
        below += keys[i] <= low
        upper = min(upper, keys[i]) if keys[i] > low else upper
    if below > n // 2:
        upper = low
    pair = np.empty(2, np.int32)
    pair[0], pair[1] = low, upper
    for i in range(2):
        pair[i] ^= (pair[i] >> 31) & 0x7FFFFFFF
    both = pair.view(np.float32)
    return (np.float64(both[0]) + np.float64(both[1])) / 2
