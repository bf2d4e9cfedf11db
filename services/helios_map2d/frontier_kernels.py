"""Numba kernels over the known box: frontier cells and their clusters, near ground, identities.

Reached through `frontiers.py` and `explored.py`; readable twins stand in the tests.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def frontier_mask(occupancy, explored, mask):
    """Free explored cells beside a cell that is neither explored nor occupied (4 neighbours).

    A neighbour outside the arrays counts as unexplored.
    """
    rows, columns = occupancy.shape
    for r in range(rows):
        for c in range(columns):
            edge = False
            if occupancy[r, c] == 0 and explored[r, c] != 0:
                edge = (
                    r == 0
                    or c == 0
                    or r == rows - 1
                    or c == columns - 1
                    or (explored[r - 1, c] == 0 and occupancy[r - 1, c] != 100)
                    or (explored[r + 1, c] == 0 and occupancy[r + 1, c] != 100)
                    or (explored[r, c - 1] == 0 and occupancy[r, c - 1] != 100)
                    or (explored[r, c + 1] == 0 and occupancy[r, c + 1] != 100)
                )
            mask[r, c] = 1 if edge else 0


@njit(cache=True, nogil=True, inline="always")
def find_root(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True)
def label_cells(mask, cells, parent):
    """Union-find over the set cells, 8-connected, in row order.

    Fills `cells` int32 [n, 2] (row, column) and `parent` int32 [n]: every entry becomes the
    smallest index of its cluster. `n` must be the number of set cells.
    """
    rows, columns = mask.shape
    above = np.full(columns + 2, -1, np.int32)  # index of the cell above, shifted by one column
    here = np.full(columns + 2, -1, np.int32)
    n = 0
    for r in range(rows):
        here[:] = -1
        for c in range(columns):
            if mask[r, c] == 0:
                continue
            cells[n, 0] = r
            cells[n, 1] = c
            parent[n] = n
            here[c + 1] = n
            for other in (here[c], above[c], above[c + 1], above[c + 2]):
                if other >= 0:
                    a = find_root(parent, other)
                    b = find_root(parent, n)
                    if a < b:
                        parent[b] = a
                    else:
                        parent[a] = b
            n += 1
        above, here = here, above
    for i in range(n):
        parent[i] = find_root(parent, i)


@njit(cache=True, nogil=True)
def near_ground(occupancy, row, column, radius_cells, near):
    """Cells within a radius of (row, column) that can be walked to without crossing an obstacle.

    4-connected flood; `near` uint8 [rows, columns] starts as zeros and gets ones.
    """
    rows, columns = occupancy.shape
    stack = np.empty((4 * rows * columns + 1, 2), np.int32)
    stack[0, 0] = row
    stack[0, 1] = column
    n = 1
    limit = radius_cells * radius_cells
    while n > 0:
        n -= 1
        r, c = stack[n, 0], stack[n, 1]
        if r < 0 or c < 0 or r >= rows or c >= columns or near[r, c] != 0:
            continue
        if occupancy[r, c] == 100 or (r - row) ** 2 + (c - column) ** 2 > limit:
            continue
        near[r, c] = 1
        for dr, dc in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            stack[n, 0] = r + dr
            stack[n, 1] = c + dc
            n += 1


@njit(cache=True, nogil=True)
def shared_ground(cells, labels, former_cells, former_labels, reach, votes):
    """How many cells of each cluster lie within `reach` cells (a square) of each former cluster.

    `cells` int32 [n, 2], `labels` int32 [n] 0..k-1; `former_*` alike; adds to `votes` int32 [k, m].
    """
    if cells.shape[0] == 0 or former_cells.shape[0] == 0:
        return
    r0 = min(cells[:, 0].min(), former_cells[:, 0].min()) - reach
    c0 = min(cells[:, 1].min(), former_cells[:, 1].min()) - reach
    rows = max(cells[:, 0].max(), former_cells[:, 0].max()) + reach + 1 - r0
    columns = max(cells[:, 1].max(), former_cells[:, 1].max()) + reach + 1 - c0
    former = np.full((rows, columns), -1, np.int32)
    for i in range(former_cells.shape[0]):
        former[former_cells[i, 0] - r0, former_cells[i, 1] - c0] = former_labels[i]
    found = np.zeros(votes.shape[1], np.bool_)
    for i in range(cells.shape[0]):
        found[:] = False
        r, c = cells[i, 0] - r0, cells[i, 1] - c0
        for y in range(r - reach, r + reach + 1):
            for x in range(c - reach, c + reach + 1):
                k = former[y, x]
                if k >= 0 and not found[k]:
                    found[k] = True
                    votes[labels[i], k] += 1


@njit(cache=True, nogil=True)
def first_block(z_high, occupancy, start, end, target_cells, margin):
    """The first cell on a straight line whose obstacle rises above the line, or (-1, -1).

    `start`, `end` float64 [3]: row, column in cells (not rounded) and height in metres. Cells
    within `target_cells` of the end, and the start's own, do not block.
    """
    rows, columns = occupancy.shape
    dr, dc, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    length = np.hypot(dr, dc)
    steps = int(length * 4) + 1
    own_r, own_c = int(np.floor(start[0])), int(np.floor(start[1]))
    # Only the part of the line over the map: an end may be any finite place.
    t_in, t_out = 0.0, 1.0
    for k in range(2):
        d = end[k] - start[k]
        size = float(rows if k == 0 else columns)
        if d == 0.0:
            if start[k] < 0.0 or start[k] > size:
                return -1, -1
            continue
        t0, t1 = -start[k] / d, (size - start[k]) / d
        t_in = max(t_in, min(t0, t1))
        t_out = min(t_out, max(t0, t1))
    for i in range(int(t_in * steps), int(np.ceil(t_out * steps)) + 1):
        t = i / steps
        if (1.0 - t) * length <= target_cells:
            break
        r = int(np.floor(start[0] + t * dr))
        c = int(np.floor(start[1] + t * dc))
        if r < 0 or c < 0 or r >= rows or c >= columns or (r == own_r and c == own_c):
            continue
        if occupancy[r, c] == 100 and z_high[r, c] > start[2] + t * dz + margin:
            return r, c
    return -1, -1
