"""Numba kernels that sort the pixels of a depth image by cell, and by azimuth and range.

Reached through `occupancy.py`; readable twins stand in the tests. One thread: a frame takes about
a millisecond, and the other services need the second core. Of fast-math, only flags that keep NaN
comparisons meaningful are used: NaN depth must fail every comparison.

A row of the image goes through loops without branches over few arrays, which run in SIMD; what is
left to be done pixel by pixel is a store by azimuth and range and, for obstacles, three updates of
a cell. Heights in the band are above 0, so their bits order as integers do, and integers compare
faster.
"""

from __future__ import annotations

import numpy as np
from numba import njit

FAST = {"reassoc", "contract", "arcp", "nsz", "afn"}

NOTHING = 0  # kinds of pixels
FLOOR = 1
OBSTACLE = 2


@njit(cache=True, nogil=True, inline="always", fastmath=FAST)
def diamond_angle(forward, left):
    """0..4, rising with the azimuth from -pi to pi; 2 is straight ahead."""
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    total = abs(forward) + abs(left)
    a = left / (total if total > zero else one)
    back = two - a if left >= zero else -two - a
    return two + (a if forward >= zero else back)


@njit(cache=True, nogil=True, fastmath=FAST)
def clear_veil(above, here, below, kinds, jump_m, jump_ratio):
    """Take out of `kinds` the obstacle pixels of a row that float between two surfaces, or stand
    alone: the mixed pixels of an edge, and outliers. Unmeasured neighbours say nothing."""
    zero = np.float32(0.0)
    for u in range(1, here.size - 1):
        z = here[u]
        jump = jump_m + jump_ratio * z
        a, b = here[u - 1] - z, here[u + 1] - z
        known = (here[u - 1] > zero) & (here[u + 1] > zero)
        across = known & (abs(a) > jump) & (abs(b) > jump)
        torn = across & (a * b < zero)
        a, b = above[u] - z, below[u] - z
        known = (above[u] > zero) & (below[u] > zero)
        along = known & (abs(a) > jump) & (abs(b) > jump)
        torn = torn | (along & (a * b < zero)) | (across & along)
        kinds[u] = NOTHING if torn & (kinds[u] == OBSTACLE) else kinds[u]


@njit(cache=True, nogil=True, fastmath=FAST)
def project_depth(
    depth,  # float32 [h, w]
    intrinsics,  # float32 [4]: 1 / fx, 1 / fy, cx, cy
    pose,  # float32 [3, 4]: rotation, and camera position (cells of the window; z in metres)
    heading,  # float32 [2]
    limits,  # float32 [9]: depth min, max, floor tolerance, band lo, hi, rise, jump, ratio, 1/m
    body,  # float32 [3]: the robot's own disc in cells of the window: column, row, radius²
    count,  # int32 [rows, columns] out: obstacle pixels of this frame per cell
    low,  # float32 [rows, columns] out: lowest obstacle height, +inf where none is
    high,  # float32 [rows, columns] out: highest, 0 where none is
    marks,  # uint8 [3, ranges, bins] out: 1 where a pixel of the kind lies; [0] is of no use
):
    """Sort every depth pixel into floor, obstacle or neither, by cell and by azimuth and range."""
    h, w = depth.shape
    rows, columns = count.shape
    ranges, bins = marks.shape[1:]
    bin_scale = np.float32(bins / 4.0)
    near, far, floor_tol, band_lo, band_hi = limits[0], limits[1], limits[2], limits[3], limits[4]
    rise, jump_m, jump_ratio, px_per_m = limits[5], limits[6], limits[7], limits[8]
    c, s = heading[0], heading[1]
    x0, y0, z0 = pose[0, 3], pose[1, 3], pose[2, 3]
    # Evidence that touches the image edge that looks up may go on higher than was seen.
    open_row = 0 if pose[2, 1] <= 0.0 else h - 1
    kinds, cells, spots = np.empty(w, np.int32), np.empty(w, np.int32), np.empty(w, np.int32)
    xs, ys, heights = np.empty(w, np.float32), np.empty(w, np.float32), np.empty(w, np.float32)
    hit_cells, hit_bits = np.empty(w, np.uint32), np.empty(w, np.int32)
    bits = heights.view(np.int32)
    count_of, low_of = count.ravel(), low.ravel().view(np.int32)
    tops = high.ravel()
    high_of = tops.view(np.int32)
    mark_of = marks.ravel()
    zero, none = np.float32(0.0), np.int32(-1)
    row_end, column_end, stride = np.float32(rows), np.float32(columns), np.int32(columns)
    last_bin, range_end, line = np.int32(bins - 1), np.int32(ranges), np.int32(bins)
    plane = np.int32(ranges * bins)
    for v in range(h):
        dv = (np.float32(v) - intrinsics[3]) * intrinsics[1]
        ax = pose[0, 1] * dv + pose[0, 2]
        ay = pose[1, 1] * dv + pose[1, 2]
        az = pose[2, 1] * dv + pose[2, 2]
        for u in range(w):
            z = depth[v, u]
            du = (np.float32(u) - intrinsics[2]) * intrinsics[0]
            xs[u] = z * (pose[0, 0] * du + ax) * px_per_m
            ys[u] = z * (pose[1, 0] * du + ay) * px_per_m
        for u in range(w):
            z = depth[v, u]
            du = (np.float32(u) - intrinsics[2]) * intrinsics[0]
            height = z * (pose[2, 0] * du + az) + z0
            measured = (z > near) & (z < far)
            floor = abs(height) <= floor_tol
            band = (height >= band_lo + rise * z * z) & (height <= band_hi)
            kind = OBSTACLE if band else (FLOOR if floor else NOTHING)
            kinds[u] = np.int32(kind if measured else NOTHING)
            heights[u] = height
        if 0 < v < h - 1:
            clear_veil(depth[v - 1], depth[v], depth[v + 1], kinds, jump_m, jump_ratio)
        for u in range(w):
            x, y = xs[u] + x0, ys[u] + y0
            bx, by = x - body[0], y - body[1]
            obstacle = kinds[u] == OBSTACLE
            own = obstacle & (bx * bx + by * by <= body[2])
            inside = (x >= zero) & (y >= zero) & (x < column_end) & (y < row_end)
            kinds[u] = NOTHING if own else kinds[u]
            at = np.int32(y) * stride + np.int32(x)
            cells[u] = at if obstacle & inside & (not own) else none
        for u in range(w):
            x, y = xs[u], ys[u]
            b = np.int32(diamond_angle(c * x + s * y, c * y - s * x) * bin_scale)
            k = np.int32(np.sqrt(x * x + y * y))
            b = b if b < last_bin else last_bin
            counts = (kinds[u] != NOTHING) & (k < range_end)  # else x and y may be NaN
            spots[u] = kinds[u] * plane + k * line + b if counts else 0
        for u in range(w):
            mark_of[np.uint32(spots[u])] = 1
        n = 0
        for u in range(w):
            hit_cells[n] = np.uint32(cells[u])
            hit_bits[n] = bits[u]
            n += np.int64(cells[u] >= 0)
        for i in range(n):
            at, height = hit_cells[i], hit_bits[i]
            count_of[at] += np.int32(1)
            low_of[at] = min(low_of[at], height)
            high_of[at] = max(high_of[at], height)
        if v == open_row:
            for i in range(n):
                tops[hit_cells[i]] = band_hi


@njit(cache=True, nogil=True)
def floor_along_azimuths(marks, gap_cells, shadow_cells, seen):
    """Where floor was seen: along each azimuth, joining floor seen twice with no obstacle between.

    Floor within `shadow_cells` behind an obstacle is not believed: it is the foot of that
    obstacle, thrown behind it by depth noise. Further behind it was seen under or beside it.
    `marks` is that of `project_depth`; `seen` uint8 [ranges, bins + 2] of zeros gets ones. It
    begins with the last azimuth and ends with the first one, so that each has both neighbours.
    """
    ranges, bins = marks.shape[1:]
    used = np.zeros(bins, np.uint8)
    for k in range(ranges):
        for b in range(bins):
            used[b] |= marks[FLOOR, k, b]
    last_floor = np.full(bins, -1, np.int32)
    last_obstacle = np.full(bins, -shadow_cells - 1, np.int32)
    azimuths = np.flatnonzero(used)
    for k in range(ranges):
        for b in azimuths:
            if marks[OBSTACLE, k, b] != 0:
                last_obstacle[b] = k
                last_floor[b] = -1
            elif marks[FLOOR, k, b] != 0 and k - last_obstacle[b] > shadow_cells:
                start = k
                if last_floor[b] >= 0 and k - last_floor[b] <= gap_cells:
                    start = last_floor[b] + 1
                for i in range(start, k + 1):
                    seen[i, b + 1] = 1
                last_floor[b] = k
    seen[:, 0] = seen[:, bins]
    seen[:, bins + 1] = seen[:, 1]
