"""Numba kernels that fuse one frame's pixels, sorted by cell, into the map's window.

Called by `layers/occupancy.py`; the tests have readable reference versions. Branch-free loops
update the floor of all cells. Further steps run in SIMD batches over the few cells with obstacle
evidence or hits.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from helios_map2d.kernels.depth_projection import FAST, NO_LOW, diamond_angle
from helios_map2d.kernels.free_space_carving import (
    BATCH,
    HEIGHT_SAMPLES,
    mark_possibly_seen_through,
    project_obstacles,
    test_obstacle,
)

SEEN_NOW = 1  # flags of a frame's effect on a cell: the frame saw the cell
HEIGHTS = 2  # heights of its obstacle changed
MEMORY = 4  # stored data changed, such as the evidence


@njit(cache=True, nogil=True)
def hit_of(count, row, column, weak, strong, tail_ratio):
    """Strength of this frame's hit on a cell, with its 8 neighbours: 0 none, 1 weak, 2 strong.

    A single pixel is no hit. Nor are a few pixels beside a cell with far more: they are the noise
    tails of a wall.
    """
    n = count[row, column]
    support = 0
    most = 0
    for r in range(max(0, row - 1), min(count.shape[0], row + 2)):
        for c in range(max(0, column - 1), min(count.shape[1], column + 2)):
            support += count[r, c]
            most = max(most, count[r, c])
    if support < weak or n * tail_ratio < most:
        return 0
    return 2 if n >= strong or support >= 2 * strong else 1


@njit(cache=True, nogil=True, fastmath=FAST)
def fold_floor(
    pose,  # float32 [3, 4], as in `project_obstacles`
    heading,  # float32 [2]
    azimuths,  # int32 [2]: first bin of `floor`, and number of bins around the camera
    floor,  # uint8 [ranges + 1, bins], from floor_along_azimuths; the last row is zeros
    occupied,  # uint8: least evidence of an obstacle
    corner,  # (row, column) of the window on the map
    spans,  # int32 [rows, 2]: first column and end of each row that the view may change
    count,  # int32 [rows, columns]
    evidence,
    floor_seen,
    occupancy,  # the whole map
    came_of_it,  # uint8 [rows, columns] out: SEEN_NOW, MEMORY
    active,  # int32 [cells, 2] out: cells (row, column) with evidence or a hit
):
    """Fuse the seen floor into the map and return the number of active cells."""
    rows, columns = count.shape
    ranges, bins = floor.shape[0] - 1, floor.shape[1]
    bin_scale = np.float32(azimuths[1] / 4.0)
    half, no = np.float32(0.5), np.uint8(0)
    first_bin, last_bin = np.int32(azimuths[0]), np.int32(azimuths[1] - 1)
    bins_end, range_end, nowhere = np.int32(bins), np.int32(ranges), np.int32(ranges * bins)
    c, s = heading[0], heading[1]
    floor_at = floor.ravel()
    all_spots, busy = np.empty(columns, np.int32), np.zeros(columns + 8, np.uint8)
    found = 0
    for row in range(rows):
        came_of_it[row, :] = 0
        first, end = spans[row, 0], spans[row, 1]
        n = end - first
        # Slices of rows are contiguous, and `abs` excludes negative indices; SIMD needs both.
        r, at = abs(corner[0] + row), abs(corner[1] + first)
        e, known = evidence[r][at : at + n], floor_seen[r][at : at + n]
        state = occupancy[r][at : at + n]
        hits, flags, spots = count[row][first:end], came_of_it[row][first:end], all_spots[:n]
        dy = np.float32(row) + half - pose[1, 3]
        left = np.float32(first) + half - pose[0, 3]
        for i in range(n):
            dx = np.float32(i) + left
            b = np.int32(diamond_angle(c * dx + s * dy, c * dy - s * dx) * bin_scale)
            b = (b if b < last_bin else last_bin) - first_bin
            k = np.int32(np.sqrt(dx * dx + dy * dy))
            inside = (k < range_end) & (b >= 0) & (b < bins_end)
            spots[i] = k * bins_end + b if inside else nowhere
        for i in range(n):
            flags[i] = floor_at[np.uint32(spots[i])]
        for i in range(n):
            ground = np.int8(0 if (flags[i] | known[i]) != no else -1)
            state[i] = np.int8(100) if e[i] >= occupied else ground
        for i in range(n):
            seen, knew = flags[i] != no, known[i] != no
            known[i] = np.uint8(1 if seen | knew else 0)
            flags[i] = np.uint8((SEEN_NOW if knew else SEEN_NOW | MEMORY) if seen else 0)
        for i in range(n):
            busy[i] = (e[i] != no) | (hits[i] != 0)
        busy[n : n + 8] = 0
        for i in range(0, n, 8):
            if np.any(busy[i : i + 8]):
                for j in range(i, i + 8):
                    active[found, 0], active[found, 1] = row, first + j
                    found += busy[j]
    return found


@njit(cache=True, nogil=True, fastmath=FAST)
def fold_obstacles(
    depth,  # float32 [h, w]
    lens,  # float32 [4]: fx, fy, cx, cy
    pose,  # float32 [3, 4], as in `project_obstacles`
    cell_m,  # float32
    tolerance,  # float32 [2]: m, ratio of depth
    far,  # float32: largest depth at which a cell is tested
    rules,  # int64 [7]: weak pixels, strong pixels, tail ratio, occupied, most, gain, loss
    count,
    low,
    high,  # [rows, columns], float32 heights: this frame's obstacles
    active,  # int32 [n, 2]: cells, from fold_floor
    corner,  # (row, column) of the window on the map
    evidence,
    floor_seen,
    z_low,
    z_high,
    occupancy,  # the whole map
    came_of_it,  # uint8 [rows, columns], from fold_floor: gets HEIGHTS, MEMORY, SEEN_NOW
):
    """Fuse this frame's obstacles into the map, and carve mapped obstacles that it sees through."""
    line, flat = depth.shape[1], depth.ravel()
    weak, strong, tail_ratio = rules[0], rules[1], rules[2]
    occupied, most, gain, loss = rules[3], rules[4], rules[5], rules[6]
    xs, ys = np.empty(BATCH, np.float32), np.empty(BATCH, np.float32)
    lows, highs = np.empty(BATCH, np.float32), np.empty(BATCH, np.float32)
    depths = np.empty((HEIGHT_SAMPLES + 1, BATCH), np.float32)
    pixels = np.empty((HEIGHT_SAMPLES + 1, BATCH), np.int32)
    widths = np.empty((HEIGHT_SAMPLES + 1, BATCH), np.int32)
    unsure = np.empty(BATCH, np.uint8)
    for start in range(0, active.shape[0], BATCH):
        n = min(BATCH, active.shape[0] - start)
        for i in range(n):
            row, column = active[start + i, 0], active[start + i, 1]
            xs[i], ys[i] = np.float32(column + 0.5), np.float32(row + 0.5)
            r, c = row + corner[0], column + corner[1]
            lows[i], highs[i] = z_low[r, c], z_high[r, c]
        project_obstacles(depth.shape, lens, pose, cell_m, far, xs[:n], ys[:n], lows[:n], highs[:n],
            depths, pixels, widths)  # fmt: skip
        mark_possibly_seen_through(flat, lows[:n], highs[:n], depths, pixels, tolerance, unsure)
        for i in range(n):
            row, column = active[start + i, 0], active[start + i, 1]
            r, c = row + corner[0], column + corner[1]
            e = before = np.int64(evidence[r, c])
            hit = 0
            if count[row, column] > 0:
                hit = hit_of(count, row, column, weak, strong, tail_ratio)
            bottom, top = lows[i], highs[i]
            if e > 0 and unsure[i] != 0:
                gone, bottom, top = test_obstacle(
                    flat,
                    line,
                    depths[:, i],
                    pixels[:, i],
                    widths[:, i],
                    tolerance,
                    bottom,
                    top,
                    hit > 0,
                )
                if gone:
                    e = max(0, e - loss)
            if hit > 0:
                new_bottom, new_top = low[row, column], high[row, column]
                bottom = new_bottom if e == 0 else min(bottom, new_bottom)
                top = new_top if e == 0 else max(top, new_top)
                e = min(most, e + (gain if hit == 2 else 1))
            flags = came_of_it[row, column]
            if e != before:
                evidence[r, c] = e
                flags |= MEMORY
            if bottom != lows[i] or top != highs[i]:
                z_low[r, c], z_high[r, c] = bottom, top
                if e > 0:
                    flags |= HEIGHTS | MEMORY
            if e >= occupied:
                occupancy[r, c] = 100
                if hit > 0:
                    flags |= SEEN_NOW
            else:
                occupancy[r, c] = 0 if floor_seen[r, c] else -1
            came_of_it[row, column] = flags


@njit(cache=True, nogil=True)
def forget_pixels(active, count, low, high):
    """Clear this frame's pixels, which all lie in active cells."""
    for i in range(active.shape[0]):
        row, column = active[i, 0], active[i, 1]
        count[row, column] = 0
        low[row, column] = NO_LOW
        high[row, column] = 0


@njit(cache=True, nogil=True)
def clear_disc(
    box,  # (row_lo, row_hi, column_lo, column_hi): cells of the map
    origin,  # (x, y) of the map's corner, m
    cell_m,
    disc,  # (x, y, radius), m
    evidence,
    floor_seen,
    occupancy,  # the whole map
    corner,  # (row, column) of `came_of_it` on the map
    came_of_it,  # uint8 [rows, columns]: gets MEMORY where anything changes
):
    """Set all cells with their centre within a disc to free."""
    for r in range(box[0], box[1]):
        y = origin[1] + (r + 0.5) * cell_m - disc[1]
        for c in range(box[2], box[3]):
            x = origin[0] + (c + 0.5) * cell_m - disc[0]
            if y * y + x * x > disc[2] * disc[2]:
                continue
            if evidence[r, c] != 0 or floor_seen[r, c] == 0 or occupancy[r, c] != 0:
                came_of_it[r - corner[0], c - corner[1]] |= MEMORY
            evidence[r, c], floor_seen[r, c], occupancy[r, c] = 0, 1, 0
