"""Numba kernels of the occupancy layer; each touches only the view's window.

Reached through `occupancy.py`; readable twins stand in the tests. One thread: a
frame takes about a millisecond, and the other services need the second core. Of fast-math, only
flags that keep NaN comparisons meaningful are used: NaN depth must fail every comparison.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

FAST = {"reassoc", "contract", "arcp", "nsz", "afn"}

NOTHING = 0
FLOOR = 1
OBSTACLE = 2
SEEN = 4

THROUGH = 0
SURFACE = 1
HIDDEN = 2
HEIGHT_SAMPLES = 6

SEEN_NOW = 1  # what came of a frame for a cell, as flags
HEIGHTS = 2
MEMORY = 4


@njit(cache=True, nogil=True, inline="always", fastmath=FAST)
def diamond_angle(forward, left):
    """0..4, rising with the azimuth from -pi to pi; 2 is straight ahead."""
    total = abs(forward) + abs(left)
    if total < 1e-9:
        return np.float32(2.0)
    a = left / total
    if forward < 0.0:
        a = 2.0 - a if left >= 0.0 else -2.0 - a
    return np.float32(2.0 + a)


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
    count,  # uint16 [rows, columns] out: obstacle pixels of this frame per cell
    low,  # float32 [rows, columns] out: lowest obstacle height, valid where count > 0
    high,  # float32 [rows, columns] out: highest
    polar,  # uint8 [bins, ranges] out: flags FLOOR, OBSTACLE
):
    """Sort every depth pixel into floor, obstacle or neither, by cell and by azimuth and range."""
    h, w = depth.shape
    rows, columns = count.shape
    bins, ranges = polar.shape
    bin_scale = np.float32(bins / 4.0)
    near, far, floor_tol, band_lo, band_hi = limits[0], limits[1], limits[2], limits[3], limits[4]
    rise, jump_m, jump_ratio, px_per_m = limits[5], limits[6], limits[7], limits[8]
    c, s = heading[0], heading[1]
    x0, y0, z0 = pose[0, 3], pose[1, 3], pose[2, 3]
    # Evidence that touches the image edge that looks up may go on higher than was seen.
    open_row = 0 if pose[2, 1] <= 0.0 else h - 1
    kinds = np.empty(w, np.int32)
    heights, xs, ys, ks, bs = (
        np.empty(w, np.float32), np.empty(w, np.float32), np.empty(w, np.float32),
        np.empty(w, np.float32), np.empty(w, np.float32),
    )  # fmt: skip
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    for v in range(h):
        dv = (np.float32(v) - intrinsics[3]) * intrinsics[1]
        ax = pose[0, 1] * dv + pose[0, 2]
        ay = pose[1, 1] * dv + pose[1, 2]
        az = pose[2, 1] * dv + pose[2, 2]
        # A whole row in loops without branches and over few arrays, so that they run in SIMD.
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
        for u in range(w):
            forward = c * xs[u] + s * ys[u]
            left = c * ys[u] - s * xs[u]
            total = abs(forward) + abs(left)
            a = left / (total if total > zero else one)
            back = two - a if left >= zero else -two - a
            bs[u] = (two + (a if forward >= zero else back)) * bin_scale
        for u in range(w):
            ks[u] = np.sqrt(xs[u] * xs[u] + ys[u] * ys[u])
        if 0 < v < h - 1:
            clear_veil(depth[v - 1], depth[v], depth[v + 1], kinds, jump_m, jump_ratio)
        for u in range(w):
            kind = kinds[u]
            if kind == NOTHING:
                continue
            if kind == OBSTACLE:
                x = xs[u] + x0
                y = ys[u] + y0
                bx = x - body[0]
                by = y - body[1]
                if bx * bx + by * by <= body[2]:
                    continue
                column = math.floor(x)
                row = math.floor(y)
                if 0 <= row < rows and 0 <= column < columns:
                    n = count[row, column]
                    height = heights[u]
                    top = band_hi if v == open_row else height
                    if n == 0:
                        low[row, column] = height
                        high[row, column] = top
                    else:
                        low[row, column] = min(low[row, column], height)
                        high[row, column] = max(high[row, column], top)
                    if n < 65535:
                        count[row, column] = n + 1
            k = int(ks[u])
            if k < ranges:
                polar[min(bins - 1, int(bs[u])), k] |= np.uint8(kind)


@njit(cache=True, nogil=True)
def carve_rays(polar, gap_cells, shadow_cells):
    """Mark SEEN the floor along each azimuth, joining floor seen twice with no obstacle between.

    Floor within `shadow_cells` behind an obstacle is not believed: it is the foot of that
    obstacle, thrown behind it by depth noise. Further behind it was seen under or beside it.
    """
    bins, ranges = polar.shape
    for b in range(bins):
        last_floor = -1
        last_obstacle = -shadow_cells - 1
        for k in range(ranges):
            flags = polar[b, k]
            if flags == NOTHING:
                continue
            if flags & OBSTACLE:
                last_obstacle = k
                last_floor = -1
            elif k - last_obstacle > shadow_cells:
                start = k
                if last_floor >= 0 and k - last_floor <= gap_cells:
                    start = last_floor + 1
                for i in range(start, k + 1):
                    polar[b, i] |= np.uint8(SEEN)
                last_floor = k


@njit(cache=True, nogil=True, inline="always", fastmath=FAST)
def look_at(depth, intrinsics, T_cam_world, x, y, z, half_cell_m, tolerance, far):
    """What the image says of a world point: seen through, on a surface, or hidden or out of view.

    The pixels that a cell covers are all asked; one that does not see through is enough to keep
    the point.
    """
    h, w = depth.shape
    zc = T_cam_world[2, 0] * x + T_cam_world[2, 1] * y + T_cam_world[2, 2] * z + T_cam_world[2, 3]
    if not (zc > 0.05 and zc < far):
        return HIDDEN
    xc = T_cam_world[0, 0] * x + T_cam_world[0, 1] * y + T_cam_world[0, 2] * z + T_cam_world[0, 3]
    yc = T_cam_world[1, 0] * x + T_cam_world[1, 1] * y + T_cam_world[1, 2] * z + T_cam_world[1, 3]
    u = math.floor(xc / (zc * intrinsics[0]) + intrinsics[2] + 0.5)
    v = math.floor(yc / (zc * intrinsics[1]) + intrinsics[3] + 0.5)
    r = min(6, int(half_cell_m / (zc * intrinsics[0])) + 1)
    if u - r < 0 or v - r < 0 or u + r >= w or v + r >= h:
        return HIDDEN
    tol = tolerance[0] + tolerance[1] * zc
    measured = 0
    state = THROUGH
    for i in range(v - r, v + r + 1):
        for j in range(u - r, u + r + 1):
            d = depth[i, j]
            if not d > 0.0:
                continue
            measured += 1
            if d <= zc + tol:
                if d >= zc - tol:
                    return SURFACE
                state = HIDDEN
    return state if measured > 0 else HIDDEN


@njit(cache=True, nogil=True, inline="always")
def hit_of(count, row, column, weak, strong, tail_ratio):
    """0 no hit, 1 weak, 2 strong: this frame's obstacle pixels of a cell, with its 8 neighbours.

    A lone pixel is no hit. Neither are the few pixels that noise throws beside a cell with far
    more of them: the tails of a wall.
    """
    n = count[row, column]
    if n == 0:
        return 0
    rows, columns = count.shape
    support = 0
    most = 0
    for r in range(max(0, row - 1), min(rows, row + 2)):
        for c in range(max(0, column - 1), min(columns, column + 2)):
            support += count[r, c]
            most = max(most, count[r, c])
    if support < weak or n * tail_ratio < most:
        return 0
    return 2 if n >= strong or support >= 2 * strong else 1


@njit(cache=True, nogil=True, fastmath=FAST)
def fuse_window(
    depth,  # float32 [h, w]
    intrinsics,  # float32 [4]: 1 / fx, 1 / fy, cx, cy
    T_cam_world,  # float64 [4, 4]
    camera_cells,  # float32 [2]: column, row in the window
    heading,  # float32 [2]
    count, low, high,  # this frame's obstacles [rows, columns], from project_depth
    polar,  # uint8 [bins, ranges], from carve_rays
    origin,  # float64 [3]: x, y of the window's corner in metres; cell size
    rules,  # int64 [7]: weak pixels, strong pixels, tail ratio, occupied, most, gain, loss
    tolerance,  # float32 [2]: m, ratio of depth
    far,  # float: the largest depth at which a cell is judged
    spans,  # int32 [rows, 2]: first and last column + 1 of each row that the view may touch
    evidence, floor_seen, z_low, z_high, occupancy,  # the map's window [rows, columns]
    came_of_it,  # uint8 [rows, columns] out: SEEN_NOW, HEIGHTS, MEMORY
):  # fmt: skip
    """Fold one frame into the map: hits, cells seen through, floor seen, and the states."""
    rows = count.shape[0]
    bins, ranges = polar.shape
    bin_scale = np.float32(bins / 4.0)
    c, s = heading[0], heading[1]
    weak, strong, tail_ratio = rules[0], rules[1], rules[2]
    occupied, most, gain, loss = rules[3], rules[4], rules[5], rules[6]
    for row in range(rows):
        dy = np.float32(row) + np.float32(0.5) - camera_cells[1]
        came_of_it[row, :] = 0
        for column in range(spans[row, 0], spans[row, 1]):
            dx = np.float32(column) + np.float32(0.5) - camera_cells[0]
            hit = hit_of(count, row, column, weak, strong, tail_ratio)
            e = before = evidence[row, column]
            low_before, high_before = z_low[row, column], z_high[row, column]
            floor_before = floor_seen[row, column]
            if e > 0:
                x = origin[0] + (column + 0.5) * origin[2]
                y = origin[1] + (row + 0.5) * origin[2]
                zl, zh = z_low[row, column], z_high[row, column]
                samples = HEIGHT_SAMPLES if zh - zl > 0.05 else 1
                through = surface = 0
                lowest, highest = np.float32(np.inf), np.float32(-np.inf)
                for k in range(samples):
                    f = np.float32(k / (samples - 1)) if samples > 1 else np.float32(0.5)
                    z = zl + f * (zh - zl)
                    state = look_at(depth, intrinsics, T_cam_world, x, y, z, 0.5 * origin[2],
                                    tolerance, far)  # fmt: skip
                    if state == THROUGH:
                        through += 1
                    else:
                        if state == SURFACE:
                            surface += 1
                        lowest = min(lowest, z)
                        highest = max(highest, z)
                if samples > 1 and through > 0 and lowest <= highest:
                    # What was seen through at its ends is lower, or begins higher, than believed.
                    z_low[row, column] = lowest
                    z_high[row, column] = highest
                if hit == 0 and surface == 0 and through > samples - through:
                    e = max(0, e - loss)
                    evidence[row, column] = e
            if hit > 0:
                if e == 0:
                    z_low[row, column] = low[row, column]
                    z_high[row, column] = high[row, column]
                else:
                    z_low[row, column] = min(z_low[row, column], low[row, column])
                    z_high[row, column] = max(z_high[row, column], high[row, column])
                e = min(most, e + (gain if hit == 2 else 1))
                evidence[row, column] = e
            seen = False
            k = int(math.sqrt(dx * dx + dy * dy))
            if k < ranges:
                b = int(diamond_angle(c * dx + s * dy, c * dy - s * dx) * bin_scale)
                b = min(bins - 1, b)
                seen = (
                    polar[b, k] >= SEEN
                    or polar[(b + 1) % bins, k] >= SEEN
                    or polar[b - 1, k] >= SEEN
                )
            if seen:
                floor_seen[row, column] = 1
            flags = 0
            if e != before or floor_seen[row, column] != floor_before:
                flags = MEMORY
            if e > 0 and (z_low[row, column] != low_before or z_high[row, column] != high_before):
                flags |= HEIGHTS | MEMORY
            if e >= occupied:
                occupancy[row, column] = 100
                seen = seen or hit > 0
            elif floor_seen[row, column]:
                occupancy[row, column] = 0
            else:
                occupancy[row, column] = -1
            came_of_it[row, column] = flags | SEEN_NOW if seen else flags


@njit(cache=True, nogil=True)
def merge_seen(came_of_it, explored):
    """Count the cells that a frame saw as explored."""
    rows, columns = explored.shape
    for row in range(rows):
        for column in range(columns):
            explored[row, column] |= came_of_it[row, column] & SEEN_NOW


@njit(cache=True, nogil=True)
def note_changes(
    before, after,  # int8 [rows, columns]: occupancy of a box of whole tiles
    searched_before, searched,  # uint8 [rows, columns]
    came_of_it,  # uint8 [rows, columns]
    shown,  # uint8 [tile rows, tile columns] out: what others see of the tile has changed
    kept,  # uint8 [tile rows, tile columns] out: or what is remembered of it
    border,  # uint8 [tile rows + 2, tile columns + 2] out: a frontier may run differently there
    tile,  # cells along a tile
):  # fmt: skip
    """Sort the changes of a box by tile; `border` begins one tile before the box."""
    rows, columns = before.shape
    for r in range(rows):
        for c in range(columns):
            flags = came_of_it[r, c]
            other = before[r, c] != after[r, c] or searched_before[r, c] != searched[r, c]
            if not other and flags < HEIGHTS:
                continue
            tr, tc = r // tile, c // tile
            kept[tr, tc] = 1
            if other or flags & HEIGHTS:
                shown[tr, tc] = 1
            if other:
                border[tr + 1, tc + 1] = 1
                border[(r - 1 + tile) // tile, tc + 1] = 1
                border[(r + 1 + tile) // tile, tc + 1] = 1
                border[tr + 1, (c - 1 + tile) // tile] = 1
                border[tr + 1, (c + 1 + tile) // tile] = 1


@njit(cache=True, nogil=True)
def known_extent(occupancy, searched):
    """The box of a window that is known or searched: row_lo, row_hi, column_lo, column_hi."""
    rows, columns = occupancy.shape
    row_lo, row_hi, column_lo, column_hi = rows, 0, columns, 0
    for r in range(rows):
        for c in range(columns):
            if occupancy[r, c] != -1 or searched[r, c] != 0:
                row_lo = min(row_lo, r)
                row_hi = r + 1
                column_lo = min(column_lo, c)
                column_hi = max(column_hi, c + 1)
    return row_lo, row_hi, column_lo, column_hi
