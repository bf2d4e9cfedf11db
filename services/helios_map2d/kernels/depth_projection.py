"""Numba kernels that sort the pixels of a depth image by cell, and by azimuth and range.

Called by `layers/occupancy.py`; the tests have readable reference versions. They use one thread: a
frame takes less than a millisecond, and the other services need the second core. The fast-math
flags keep NaN comparisons valid: NaN depth must fail every comparison.

Each image row passes through branch-free loops over few arrays, which run in SIMD. The remaining
work per pixel is one store by azimuth and range and, for obstacles, three updates of a cell.
Heights in the band are above 0, so their bits have the order of integers, and integers compare
faster.
"""

from __future__ import annotations

import numpy as np
from numba import njit

FAST = {"reassoc", "contract", "arcp", "nsz", "afn"}

NOTHING = 0  # kinds of pixels
FLOOR = 1
OBSTACLE = 2

HERE, ABOVE, BELOW, LEFT, RIGHT = range(5)  # a pixel and its neighbours

PARTS = 8  # number of interleaved parts of a row

NO_LOW = 0x7F800000  # bits of +inf


@njit(cache=True, nogil=True, inline="always", fastmath=FAST)
def diamond_angle(forward, left):
    """Diamond angle, 0..4, which rises with the azimuth from -pi to pi; 2 is straight ahead."""
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    total = abs(forward) + abs(left)
    a = left / (total if total > zero else one)
    back = two - a if left >= zero else -two - a
    return two + (a if forward >= zero else back)


@njit(cache=True, nogil=True)
def take_row(depth, v, step, around):
    """Copy every `step`-th pixel of row `v` into around[HERE], and for inner rows the neighbours of
    each pixel into the other rows. `around` float32 [5, n], or [1, n] without neighbours."""
    h, w = depth.shape
    n = around.shape[1]
    inner = 0 < v < h - 1 and around.shape[0] > 1
    row = np.uint64(v)  # an unsigned index needs no check, so the loops run in SIMD
    above, below = np.uint64(v - 1 if inner else v), np.uint64(v + 1 if inner else v)
    if step == 1:
        for i in range(n):
            around[HERE, i] = depth[row, i]
        if inner:
            for i in range(n):
                around[ABOVE, i] = depth[above, i]
            for i in range(n):
                around[BELOW, i] = depth[below, i]
            for i in range(n - 1):
                around[LEFT, i + 1] = depth[row, i]
            for i in range(n - 1):
                around[RIGHT, i] = depth[row, i + 1]
    elif step == 2 and w == 2 * n:
        pairs = depth.reshape(h, n, 2)
        for i in range(n):
            around[HERE, i] = pairs[row, i, 0]
        if inner:
            for i in range(n):
                around[ABOVE, i] = pairs[above, i, 0]
            for i in range(n):
                around[BELOW, i] = pairs[below, i, 0]
            for i in range(n):
                around[RIGHT, i] = pairs[row, i, 1]
            for i in range(n - 1):
                around[LEFT, i + 1] = around[RIGHT, i]
    else:
        for i in range(n):
            u = i * step
            around[HERE, i] = depth[v, u]
            if inner:
                around[ABOVE, i], around[BELOW, i] = depth[v - 1, u], depth[v + 1, u]
                around[LEFT, i] = depth[v, max(0, u - 1)]
                around[RIGHT, i] = depth[v, min(w - 1, u + 1)]


@njit(cache=True, nogil=True, fastmath=FAST)
def remove_flying_pixels(around, kinds, jump_m, jump_ratio):
    """Clear in `kinds` the obstacle pixels of a row that float between two surfaces or are
    isolated: mixed pixels at edges, and outliers. Unmeasured neighbours are ignored.

    `around`: from `take_row`.
    """
    zero = np.float32(0.0)
    for i in range(kinds.size):
        z = around[HERE, i]
        jump = jump_m + jump_ratio * z
        left, right = around[LEFT, i], around[RIGHT, i]
        a, b = left - z, right - z
        across = (left > zero) & (right > zero) & (abs(a) > jump) & (abs(b) > jump)
        torn = across & (a * b < zero)
        above, below = around[ABOVE, i], around[BELOW, i]
        a, b = above - z, below - z
        along = (above > zero) & (below > zero) & (abs(a) > jump) & (abs(b) > jump)
        torn = torn | (along & (a * b < zero)) | (across & along)
        kinds[i] = NOTHING if torn & (kinds[i] == OBSTACLE) else kinds[i]


@njit(cache=True, nogil=True, fastmath=FAST)
def project_depth(
    depth,  # float32 [h, w]
    step,  # int: step between processed pixels of a row, and between processed rows
    intrinsics,  # float32 [4]: 1 / fx, 1 / fy, cx, cy
    pose,  # float32 [3, 4]: rotation, and camera position (cells of the window; z in metres)
    heading,  # float32 [2]
    limits,  # float32 [9]: depth min, max, floor tolerance, band lo, hi, rise, jump, ratio, 1/m
    body,  # float32 [3]: the robot's own disc in cells of the window: column, row, radius²
    azimuths,  # int32 [2]: first bin of `marks`, and number of bins around the camera
    shape,  # int32 [2]: rows and columns of the window
    count,  # int32 [cells] out: this frame's obstacle pixels, added by cell of the window
    low,  # int32 [cells] out: bits of the lowest obstacle height, NO_LOW without one
    high,  # int32 [cells] out: bits of the highest, 0 without one
    marks,  # uint8 [3, ranges, bins] out: 1 where a pixel of the kind lies; [0] is unused
):
    """Classify depth pixels as floor, obstacle or neither; sort them by cell, azimuth and range."""
    h, w = depth.shape
    n = (w - 1) // step + 1
    ranges, bins = marks.shape[1:]
    bin_scale = np.float32(azimuths[1] / 4.0)
    near, far, floor_tol, band_lo, band_hi = limits[0], limits[1], limits[2], limits[3], limits[4]
    rise, jump_m, jump_ratio, px_per_m = limits[5], limits[6], limits[7], limits[8]
    c, s = heading[0], heading[1]
    x0, y0, z0 = pose[0, 3], pose[1, 3], pose[2, 3]
    # An obstacle at the image edge that points upwards may extend higher than its visible part.
    last = (h - 1) // step * step
    open_row = 0 if pose[2, 1] <= 0.0 else last
    around = np.empty((5, n), np.float32)
    here = around[HERE]
    last_whole = (n - 1) * step == w - 1  # the last pixel has no right neighbour
    kinds, cells, spots = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    heights, across = np.empty(n, np.float32), np.empty(n, np.float32)
    hit = np.empty(n + 1, np.uint32)  # obstacle pixels of the row
    bits = heights.view(np.int32)
    mark_of = marks.ravel()
    zero, none = np.float32(0.0), np.int32(-1)
    row_end, column_end, stride = np.float32(shape[0]), np.float32(shape[1]), np.int32(shape[1])
    bins_end, range_end, first_bin = np.int32(bins), np.int32(ranges), np.int32(azimuths[0])
    last_bin = np.int32(azimuths[1] - 1)
    plane = np.int32(ranges * bins)
    for i in range(n):
        across[i] = (np.float32(i * step) - intrinsics[2]) * intrinsics[0]
    for v in range(0, h, step):
        dv = (np.float32(v) - intrinsics[3]) * intrinsics[1]
        ax = pose[0, 1] * dv + pose[0, 2]
        ay = pose[1, 1] * dv + pose[1, 2]
        az = pose[2, 1] * dv + pose[2, 2]
        take_row(depth, v, step, around)
        for i in range(n):
            z = here[i]
            height = z * (pose[2, 0] * across[i] + az) + z0
            measured = (z > near) & (z < far)
            floor = abs(height) <= floor_tol
            band = (height >= band_lo + rise * z * z) & (height <= band_hi)
            kind = OBSTACLE if band else (FLOOR if floor else NOTHING)
            kinds[i] = np.int32(kind if measured else NOTHING)
            heights[i] = height
        if 0 < v < h - 1:
            first_kind, last_kind = kinds[0], kinds[n - 1]
            remove_flying_pixels(around, kinds, jump_m, jump_ratio)
            kinds[0] = first_kind  # pixels at the image edge lack a neighbour
            kinds[n - 1] = last_kind if last_whole else kinds[n - 1]
        for i in range(n):
            x = here[i] * (pose[0, 0] * across[i] + ax) * px_per_m
            y = here[i] * (pose[1, 0] * across[i] + ay) * px_per_m
            b = np.int32(diamond_angle(c * x + s * y, c * y - s * x) * bin_scale)
            b = (b if b < last_bin else last_bin) - first_bin
            k = np.int32(np.sqrt(x * x + y * y))
            x += x0
            y += y0
            bx, by = x - body[0], y - body[1]
            obstacle = kinds[i] == OBSTACLE
            own = obstacle & (bx * bx + by * by <= body[2])
            inside = (x >= zero) & (y >= zero) & (x < column_end) & (y < row_end)
            at = np.int32(y) * stride + np.int32(x)
            cells[i] = at if obstacle & inside & (not own) else none
            kind = NOTHING if own else kinds[i]
            # x and y may be NaN for an unmeasured pixel.
            counts = (kind != NOTHING) & (k < range_end) & (b >= 0) & (b < bins_end)
            spots[i] = kind * plane + k * bins_end + b if counts else 0
        hits = 0
        for i in range(n):
            mark_of[np.uint32(spots[i])] = 1
            hit[hits] = np.uint32(i)
            hits += np.int64(cells[i] >= 0)
        # Adjacent pixels often share a cell, whose updates depend on each other. Interleaving parts
        # of the row avoids that.
        part = hits // PARTS
        for i in range(part):
            for k in range(PARTS):
                p = hit[i + k * part]
                at, height = np.uint32(cells[p]), bits[p]
                count[at] += np.int32(1)
                low[at] = min(low[at], height)
                high[at] = max(high[at], height)
        for i in range(PARTS * part, hits):
            p = hit[i]
            at, height = np.uint32(cells[p]), bits[p]
            count[at] += np.int32(1)
            low[at] = min(low[at], height)
            high[at] = max(high[at], height)
        if v == open_row:
            top = np.float32(band_hi).view(np.int32)
            for i in range(hits):
                high[np.uint32(cells[hit[i]])] = top


@njit(cache=True, nogil=True)
def floor_along_azimuths(marks, gap_cells, shadow_cells, seen):
    """Mark in `seen` the floor along each azimuth, and gaps between floor without an obstacle.

    Floor within `shadow_cells` behind an obstacle is discarded: depth noise puts the foot of the
    obstacle there. Floor farther behind was seen under or beside the obstacle. `marks`: from
    `project_depth`; afterwards zeros except [0]. `seen` uint8 [ranges, bins] gets 1 where the bin
    itself or an adjacent one has floor, else 0.
    """
    ranges, bins = marks.shape[1:]
    # Two passes, outward and inward, over all azimuths: distance to accepted floor, `most` if an
    # obstacle or a longer gap lies between. A cell is seen if the sum of both is a closed gap.
    one, nought = np.float32(1), np.float32(0)  # float32, because the compiler widens integers
    most, shadow = np.float32(gap_cells + 1), np.float32(shadow_cells)
    ahead = np.empty((ranges, bins), np.float32)
    far, behind = np.full(bins, most, np.float32), np.full(bins, shadow, np.float32)
    for k in range(ranges):
        floor, obstacle, here = marks[FLOOR, k], marks[OBSTACLE, k], ahead[k]
        for b in range(bins):
            behind[b] = nought if obstacle[b] != 0 else behind[b] + one
            here[b] = nought if (floor[b] != 0) & (behind[b] > shadow) else most
        for b in range(bins):
            further = most if obstacle[b] != 0 else min(far[b] + one, most)
            far[b] = min(here[b], further)
            here[b] = far[b]
        floor[:] = 0
    far[:] = most
    line = np.zeros(bins + 2, np.uint8)
    inner, after = line[1 : bins + 1], line[2:]
    for n in range(ranges):
        k = abs(ranges - 1 - n)  # never negative, which the compiler must know for SIMD
        obstacle, here, joined = marks[OBSTACLE, k], ahead[k], seen[k]
        for b in range(bins):
            further = most if obstacle[b] != 0 else min(far[b] + one, most)
            far[b] = nought if here[b] == nought else further
            inner[b] = far[b] + here[b] < most
        line[0], line[bins + 1] = line[bins], line[1]
        for b in range(bins):
            joined[b] = line[b] | inner[b] | after[b]
        obstacle[:] = 0
