"""Numba kernels of the frontiers: their cells and clusters, identities, sight.

Reached through `frontiers.py` and `sight.py`; readable twins stand in the tests.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from helios_map2d.grid import TILE


@njit(cache=True, nogil=True)
def cells_of_tiles(occupancy, explored, tiles, side, cells, counts):
    """Frontier cells by tile: free explored cells beside one that is neither explored nor occupied.

    4 neighbours; one outside the arrays counts as unexplored. `tiles` int32 [n, 2] are the first
    row and column of each tile of `side` cells; `cells` int32 [n * side², 2] gets the rows and
    columns, tile after tile in row order, `counts` int32 [n] how many each has. Returns their sum.
    """
    rows, columns = occupancy.shape
    above, here, below = np.empty((3, side + 2), np.uint8)  # whether a cell is to be explored
    wanted = np.empty(side, np.uint8)
    n = 0
    for t in range(tiles.shape[0]):
        start, first, left = n, tiles[t, 0], tiles[t, 1]
        end = min(columns, left + side)
        to_be_explored(occupancy, explored, first - 1, left - 1, here)
        to_be_explored(occupancy, explored, first, left - 1, below)
        for r in range(first, min(rows, first + side)):
            above, here, below = here, below, above
            to_be_explored(occupancy, explored, r + 1, left - 1, below)
            state, seen = occupancy[r][left:end], explored[r][left:end]
            found = np.uint8(0)
            for i in range(state.size):
                beside = here[i] | here[i + 2] | above[i + 1] | below[i + 1]
                wanted[i] = (state[i] == 0) & (seen[i] != 0) & (beside != 0)
                found |= wanted[i]
            if found == 0:
                continue
            for i in range(state.size):
                if wanted[i] != 0:
                    cells[n, 0] = r
                    cells[n, 1] = left + i
                    n += 1
        counts[t] = n - start
    return n


@njit(cache=True, nogil=True, inline="always")
def to_be_explored(occupancy, explored, row, left, out):
    """Say in `out` uint8 [n] which cells of a row from column `left` are neither explored nor
    occupied; all that is outside the arrays."""
    out[:] = 1
    if 0 <= row < occupancy.shape[0]:
        first = max(0, left)
        state, seen = (
            occupancy[row][first : left + out.size],
            explored[row][first : left + out.size],
        )
        there = out[first - left :]
        for i in range(state.size):
            there[i] = (seen[i] == 0) & (state[i] != 100)


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
def describe(
    cells, starts, corner, labels, offsets, reached, near, near_corner, centres, reachable
):  # fmt: skip
    """Whether each cluster can be reached, and the cell nearest to the mean of what can be (or of
    all its cells where nothing can): the first of equals.

    `cells`, `starts` are those of `gather`, in world cells, and so are `centres`; `corner` is the
    world cell of the grid's first. The rest is a `ground.Reached` and its labels.
    """
    n = cells.shape[0]
    can, of_tile = np.empty(n, np.uint8), np.empty(n, np.uint16)
    rows, columns = np.empty((2, n), np.int64)
    for i in range(n):
        rows[i], columns[i] = cells[i, 0] - corner[0], cells[i, 1] - corner[1]
    for i in range(n):  # far apart in memory: nothing else here, so that many are on their way
        of_tile[i] = labels[np.uint64(rows[i]), np.uint64(columns[i])]
    for i in range(n):
        r, c = rows[i], columns[i]
        y, x = r - near_corner[0], c - near_corner[1]
        beside = 0 <= y < near.shape[0] and 0 <= x < near.shape[1] and near[y, x] != 0
        component = offsets[r // TILE, c // TILE] + of_tile[i] - 1
        can[i] = beside or (of_tile[i] != 0 and reached[component] != 0)
    for k in range(starts.size - 1):
        any_reached = np.any(can[starts[k] : starts[k + 1]])
        counted = 0
        total_r = total_c = 0.0
        for i in range(starts[k], starts[k + 1]):
            if not any_reached or can[i] != 0:
                total_r += rows[i]
                total_c += columns[i]
                counted += 1
        mean_r, mean_c, best = total_r / counted, total_c / counted, np.inf
        for i in range(starts[k], starts[k + 1]):
            off = (rows[i] - mean_r) ** 2 + (columns[i] - mean_c) ** 2
            if off < best and (not any_reached or can[i] != 0):
                best = off
                centres[k, 0] = cells[i, 0]
                centres[k, 1] = cells[i, 1]
        reachable[k] = any_reached


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
