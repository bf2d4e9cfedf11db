"""Numba kernels of the frontiers: their cells and clusters, near ground, identities, sight.

Reached through `frontiers.py`, `explored.py` and `sight.py`; readable twins stand in the tests.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def cells_of_tiles(occupancy, explored, tiles, side, cells, counts):
    """Frontier cells by tile: free explored cells beside one that is neither explored nor occupied.

    4 neighbours; one outside the arrays counts as unexplored. `tiles` int32 [n, 2] are the first
    row and column of each tile of `side` cells; `cells` int32 [n * side², 2] gets the rows and
    columns, tile after tile in row order, `counts` int32 [n] how many each has. Returns their sum.
    """
    rows, columns = occupancy.shape
    n = 0
    for t in range(tiles.shape[0]):
        start = n
        for r in range(tiles[t, 0], min(rows, tiles[t, 0] + side)):
            for c in range(tiles[t, 1], min(columns, tiles[t, 1] + side)):
                if occupancy[r, c] != 0 or explored[r, c] == 0:
                    continue
                if (
                    r == 0
                    or c == 0
                    or r == rows - 1
                    or c == columns - 1
                    or (explored[r - 1, c] == 0 and occupancy[r - 1, c] != 100)
                    or (explored[r + 1, c] == 0 and occupancy[r + 1, c] != 100)
                    or (explored[r, c - 1] == 0 and occupancy[r, c - 1] != 100)
                    or (explored[r, c + 1] == 0 and occupancy[r, c + 1] != 100)
                ):
                    cells[n, 0] = r
                    cells[n, 1] = c
                    n += 1
        counts[t] = n - start
    return n


@njit(cache=True, nogil=True, inline="always")
def find_root(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True)
def cluster(cells, scratch, labels, sizes):
    """Number the 8-connected clusters of cells by their first cell; how many there are.

    `cells` int32 [n, 2]; `labels` int32 [n] gets the cluster of each, `sizes` int32 [n] the number
    of cells by cluster. `scratch` int32 over the grid is all zeros, and is again afterwards.
    """
    n = cells.shape[0]
    columns = scratch.shape[1]
    parent = np.arange(n).astype(np.int32)
    for i in range(n):
        scratch[cells[i, 0], cells[i, 1]] = i + 1
    for i in range(n):
        r, c = cells[i, 0], cells[i, 1]
        # Half of the neighbours: each pair is met once.
        for dr, dc in ((-1, -1), (-1, 0), (-1, 1), (0, -1)):
            y, x = r + dr, c + dc
            if y < 0 or x < 0 or x >= columns or scratch[y, x] == 0:
                continue
            a, b = find_root(parent, scratch[y, x] - 1), find_root(parent, i)
            if a < b:
                parent[b] = a
            else:
                parent[a] = b
    found = 0
    for i in range(n):
        root = find_root(parent, i)  # the smallest of its cluster
        if root == i:
            labels[i] = found
            sizes[found] = 0
            found += 1
        else:
            labels[i] = labels[root]
        sizes[labels[i]] += 1
    for i in range(n):
        scratch[cells[i, 0], cells[i, 1]] = 0
    return found


@njit(cache=True, nogil=True)
def gather(cells, labels, place, starts, out):
    """Sort the cells of the wanted clusters: `out` int32 [m, 2] cluster after cluster.

    `place` int32 [clusters] is the position of a cluster, -1 where it is not wanted; `starts`
    int64 [wanted + 1] where each begins.
    """
    filled = starts[:-1].copy()
    for i in range(cells.shape[0]):
        k = place[labels[i]]
        if k >= 0:
            out[filled[k], 0] = cells[i, 0]
            out[filled[k], 1] = cells[i, 1]
            filled[k] += 1


@njit(cache=True, nogil=True)
def describe(cells, starts, labels, offsets, reached, near, near_corner, side, centres, reachable):
    """Whether each cluster can be reached, and the cell nearest to the mean of what can be (or of
    all its cells where nothing can): the first of equals.

    `cells`, `starts` are those of `gather`, the rest is a `ground.Reached` and its labels.
    """
    for k in range(starts.size - 1):
        any_reached = False
        n = 0
        total_r = total_c = 0.0
        for attempt in range(2):
            total_r = total_c = 0.0
            n = 0
            for i in range(starts[k], starts[k + 1]):
                if attempt == 1 or is_reached(cells[i, 0], cells[i, 1], labels, offsets, reached,
                                              near, near_corner, side):  # fmt: skip
                    total_r += cells[i, 0]
                    total_c += cells[i, 1]
                    n += 1
            if n > 0:
                any_reached = attempt == 0
                break
        best = np.inf
        for i in range(starts[k], starts[k + 1]):
            if any_reached and not is_reached(cells[i, 0], cells[i, 1], labels, offsets, reached,
                                              near, near_corner, side):  # fmt: skip
                continue
            off = (cells[i, 0] - total_r / n) ** 2 + (cells[i, 1] - total_c / n) ** 2
            if off < best:
                best = off
                centres[k, 0] = cells[i, 0]
                centres[k, 1] = cells[i, 1]
        reachable[k] = any_reached


@njit(cache=True, nogil=True, inline="always")
def is_reached(r, c, labels, offsets, reached, near, near_corner, side):
    """Whether a cell lies in a component that was reached, or on reached ground near the robot."""
    label = labels[r, c]
    if label > 0 and reached[offsets[r // side, c // side] + label - 1] != 0:
        return True
    y, x = r - near_corner[0], c - near_corner[1]
    return 0 <= y < near.shape[0] and 0 <= x < near.shape[1] and near[y, x] != 0


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
def shared_ground(cells, labels, former_cells, former_labels, reach, scratch, votes):
    """How many cells of each cluster lie within `reach` cells (a square) of each former cluster.

    `cells` int32 [n, 2], `labels` int32 [n] 0..k-1; `former_*` alike; adds to `votes` int32 [k, m].
    `scratch` int32 over the grid is all zeros, and is again afterwards.
    """
    rows, columns = scratch.shape
    for i in range(former_cells.shape[0]):
        scratch[former_cells[i, 0], former_cells[i, 1]] = former_labels[i] + 1
    found = np.zeros(votes.shape[1], np.bool_)
    for i in range(cells.shape[0]):
        found[:] = False
        r, c = cells[i, 0], cells[i, 1]
        for y in range(max(0, r - reach), min(rows, r + reach + 1)):
            for x in range(max(0, c - reach), min(columns, c + reach + 1)):
                k = scratch[y, x] - 1
                if k >= 0 and not found[k]:
                    found[k] = True
                    votes[labels[i], k] += 1
    for i in range(former_cells.shape[0]):
        scratch[former_cells[i, 0], former_cells[i, 1]] = 0


@njit(cache=True, nogil=True)
def first_block(z_low, z_high, occupancy, start, end, target_cells, margin, ground):
    """The first cell on a straight line whose obstacle the line meets, or (-1, -1).

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
        if occupancy[r, c] != 100:
            continue
        height = start[2] + t * dz
        if z_high[r, c] > height + margin and (
            z_low[r, c] <= ground or z_low[r, c] <= height + margin
        ):
            return r, c
    return -1, -1
