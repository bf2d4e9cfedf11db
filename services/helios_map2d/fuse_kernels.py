"""Numba kernels that fold one frame's pixels by cell into the map's window.

Reached through `occupancy.py`; readable twins stand in the tests.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from helios_map2d.project_kernels import FAST, diamond_angle

THROUGH = 0  # what a depth image says of a point
SURFACE = 1
HIDDEN = 2
HEIGHT_SAMPLES = 6

SEEN_NOW = 1  # what came of a frame for a cell, as flags
HEIGHTS = 2
MEMORY = 4


@njit(cache=True, nogil=True, inline="always", fastmath=FAST)
def look_at(depth, lens, x, y, z, half_cell_m, tolerance, far):
    """What the image says of a point of the camera's frame: seen through, on a surface, or hidden
    or out of view. `lens` float64 [4]: fx, fy, cx, cy.

    The pixels that a cell covers are all asked; one that does not see through is enough to keep
    the point.
    """
    h, w = depth.shape
    if not (z > 0.05 and z < far):
        return HIDDEN
    over_z = 1.0 / z
    u = math.floor(x * over_z * lens[0] + lens[2] + 0.5)
    v = math.floor(y * over_z * lens[1] + lens[3] + 0.5)
    r = min(6, int(half_cell_m * over_z * lens[0]) + 1)
    if u - r < 0 or v - r < 0 or u + r >= w or v + r >= h:
        return HIDDEN
    tol = tolerance[0] + tolerance[1] * z
    measured = 0
    state = THROUGH
    for i in range(v - r, v + r + 1):
        for j in range(u - r, u + r + 1):
            d = depth[i, j]
            if not d > 0.0:
                continue
            measured += 1
            if d <= z + tol:
                if d >= z - tol:
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
def see_obstacle(depth, lens, T_cam_world, x, y, half_cell_m, tolerance, far, low, high):
    """Look at a believed obstacle over (x, y), from `low` to `high` (m).

    Returns whether most of it is seen through and none of it is a surface, and the ends of what is
    not seen through: (through, low, high).
    """
    samples = HEIGHT_SAMPLES if high - low > 0.05 else 1
    through = surface = 0
    T = T_cam_world
    x0 = T[0, 0] * x + T[0, 1] * y + T[0, 3]
    y0 = T[1, 0] * x + T[1, 1] * y + T[1, 3]
    z0 = T[2, 0] * x + T[2, 1] * y + T[2, 3]
    lowest, highest = np.float32(np.inf), np.float32(-np.inf)
    for k in range(samples):
        f = np.float32(k / (HEIGHT_SAMPLES - 1)) if samples > 1 else np.float32(0.5)
        z = low + f * (high - low)
        state = look_at(depth, lens, x0 + T[0, 2] * z, y0 + T[1, 2] * z, z0 + T[2, 2] * z,
                        half_cell_m, tolerance, far)  # fmt: skip
        if state == THROUGH:
            through += 1
            continue
        if state == SURFACE:
            surface += 1
        lowest = min(lowest, z)
        highest = max(highest, z)
    if samples > 1 and through > 0 and lowest <= highest:
        # What was seen through at its ends is lower, or begins higher, than believed.
        low, high = lowest, highest
    return surface == 0 and through > samples - through, low, high


@njit(cache=True, nogil=True, fastmath=FAST)
def fuse_window(
    depth,  # float32 [h, w]
    lens,  # float64 [4]: fx, fy, cx, cy
    T_cam_world,  # float64 [4, 4]
    camera_cells,  # float32 [2]: column, row in the window
    heading,  # float32 [2]
    count, low, high,  # this frame's obstacles [rows, columns], from project_depth
    floor,  # uint8 [ranges, bins + 2], from floor_along_azimuths
    origin,  # float64 [3]: x, y of the window's corner in metres; cell size
    rules,  # int64 [7]: weak pixels, strong pixels, tail ratio, occupied, most, gain, loss
    tolerance,  # float32 [2]: m, ratio of depth
    far,  # float: the largest depth at which a cell is judged
    spans,  # int32 [rows, 2]: first and last column + 1 of each row that the view may touch
    evidence, floor_seen, z_low, z_high, occupancy,  # the map's window [rows, columns]
    came_of_it,  # uint8 [rows, columns] out: SEEN_NOW, HEIGHTS, MEMORY
):  # fmt: skip
    """Fold one frame into the map: hits, cells seen through, floor seen, and the states."""
    rows, columns = count.shape
    ranges, bins = floor.shape[0], floor.shape[1] - 2
    bin_scale = np.float32(bins / 4.0)
    half = np.float32(0.5)
    last_bin, range_end, line = np.int32(bins - 1), np.int32(ranges), np.int32(bins + 2)
    c, s = heading[0], heading[1]
    weak, strong, tail_ratio = rules[0], rules[1], rules[2]
    occupied, most, gain, loss = rules[3], rules[4], rules[5], rules[6]
    floor_at = floor.ravel()
    spots = np.empty(columns, np.int32)
    for row in range(rows):
        came_of_it[row, :] = 0
        first, end = spans[row, 0], spans[row, 1]
        dy = np.float32(row) + half - camera_cells[1]
        for column in range(first, end):  # without branches, so that it runs in SIMD
            dx = np.float32(column) + half - camera_cells[0]
            b = np.int32(diamond_angle(c * dx + s * dy, c * dy - s * dx) * bin_scale)
            k = np.int32(np.sqrt(dx * dx + dy * dy))
            b = b if b < last_bin else last_bin
            spots[column] = k * line + b if k < range_end else np.int32(-1)
        for column in range(first, end):
            spot = spots[column]
            seen = spot >= 0 and (floor_at[spot] | floor_at[spot + 1] | floor_at[spot + 2]) != 0
            e = before = evidence[row, column]
            flags = 0
            hit = 0
            if e > 0 or count[row, column] > 0:
                hit = hit_of(count, row, column, weak, strong, tail_ratio)
                low_before, high_before = z_low[row, column], z_high[row, column]
                if e > 0:
                    through, z_low[row, column], z_high[row, column] = see_obstacle(
                        depth, lens, T_cam_world,
                        origin[0] + (column + 0.5) * origin[2], origin[1] + (row + 0.5) * origin[2],
                        0.5 * origin[2], tolerance, far, low_before, high_before,
                    )  # fmt: skip
                    if hit == 0 and through:
                        e = max(0, e - loss)
                if hit > 0:
                    if e == 0:
                        z_low[row, column] = low[row, column]
                        z_high[row, column] = high[row, column]
                    else:
                        z_low[row, column] = min(z_low[row, column], low[row, column])
                        z_high[row, column] = max(z_high[row, column], high[row, column])
                    e = min(most, e + (gain if hit == 2 else 1))
                evidence[row, column] = e
                if e != before:
                    flags = MEMORY
                moved = z_low[row, column] != low_before or z_high[row, column] != high_before
                if e > 0 and moved:
                    flags = HEIGHTS | MEMORY
            if seen and floor_seen[row, column] == 0:
                floor_seen[row, column] = 1
                flags |= MEMORY
            if e >= occupied:
                occupancy[row, column] = 100
                seen = seen or hit > 0
            else:
                occupancy[row, column] = 0 if floor_seen[row, column] else -1
            came_of_it[row, column] = flags | SEEN_NOW if seen else flags
