"""Numba kernels for the cells and the reachability of frontiers, and for line of sight.

Called by `layers/frontiers.py` and `layers/line_of_sight.py`; the tests have readable reference
versions.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from helios_map2d.grid import TILE

VALUES = 1  # flags of `describe`: the frontier's values need an update
OTHER = 2  # the frontier has changed


@njit(cache=True, nogil=True)
def update_frontier_cells(occupancy, explored, corner, stale, first_tile, side, old):
    """Frontier cells of the whole map, updated in stale tiles.

    Frontier cells are free explored cells beside a cell that is neither explored nor occupied (4
    neighbours; cells outside the arrays count as unexplored). `corner` is the world cell of the
    arrays' first cell. `stale` uint8 [tile rows, tile columns] is 1 for tiles of `side` cells to
    examine; its first entry is tile `first_tile` of the world. Tiles outside the arrays are
    skipped. `old` int32 [n, 2] are the former frontier cells: world cells, tile after tile in row
    order, and in row order within a tile. Returns the present cells in that order, and True if any
    has changed. Without a change it returns `old` itself.
    """
    rows, columns = occupancy.shape
    shape = rows, columns // side, side
    state, seen = occupancy.reshape(shape), explored.reshape(shape)
    near = np.empty((side + 2, side + 2), np.uint8)
    wanted = np.empty((side, side), np.uint8)
    found_here = np.empty((side * side, 2), np.int32)
    out = old  # an array of its own from the first change on
    n = before = 0
    other = False
    for t in range(stale.size):
        if stale[t // stale.shape[1], t % stale.shape[1]] == 0:
            continue
        row = (first_tile[0] + t // stale.shape[1]) * side  # world cell of the tile's first cell
        column = (first_tile[1] + t % stale.shape[1]) * side
        top, left = row - corner[0], column - corner[1]
        if top < 0 or left < 0 or top + side > rows or left + side > columns:
            continue
        edge_cells(state, seen, top, left // side, near, wanted)
        kept = first_of_tile(old, before, side, row, column)
        end = kept
        while end < old.shape[0] and tile_order(old, end, side, row, column) == 0:
            end += 1
        if not other:
            found = list_cells(wanted, row, column, found_here)
            if equal(found_here[:found], old[kept:end]):
                continue
            other = True
            out = np.empty((old.shape[0] + side * side, 2), np.int32)
        room = n + kept - before + side * side + old.shape[0] - end
        if room > out.shape[0]:
            out = np.concatenate((out[:n], np.empty((2 * room - n, 2), np.int32)))
        out[n : n + kept - before] = old[before:kept]
        n += kept - before
        n += list_cells(wanted, row, column, out[n:])
        before = end
    if not other:
        return old, False
    rest = old.shape[0] - before
    out[n : n + rest] = old[before:]
    return out[: n + rest], other


@njit(cache=True, nogil=True)
def first_of_tile(cells, low, side, row, column):
    """Index from `low` on of the first cell that does not lie before a tile, by bisection."""
    high = cells.shape[0]
    while low < high:
        middle = (low + high) // 2
        if tile_order(cells, middle, side, row, column) < 0:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True, inline="always")
def tile_order(cells, i, side, row, column):
    """Order of the tile of cell `i` relative to the tile whose first cell is (row, column): -1
    before, 0 same, 1 after."""
    if cells[i, 0] < row or cells[i, 0] >= row + side:
        return -1 if cells[i, 0] < row else 1
    if cells[i, 1] < column or cells[i, 1] >= column + side:
        return -1 if cells[i, 1] < column else 1
    return 0


@njit(cache=True, nogil=True)
def list_cells(wanted, row, column, out):
    """Write the wanted cells of a tile to `out` int32 [n, 2] and return their number. The tile's
    first cell is (row, column)."""
    side, n = wanted.shape[0], 0
    eights = wanted.view(np.uint64)
    for y in range(side):
        for i in range(eights.shape[1]):
            if eights[y, i] == 0:  # the usual case
                continue
            for x in range(8 * i, 8 * i + 8):
                out[n, 0], out[n, 1] = row + y, column + x
                n += wanted[y, x]
    return n


@njit(cache=True, nogil=True)
def equal(a, b):
    """True if two lists of cells are equal."""
    same, i = a.shape[0] == b.shape[0], 0
    while same and i < a.shape[0]:
        same = a[i, 0] == b[i, 0] and a[i, 1] == b[i, 1]
        i += 1
    return same


@njit(cache=True, nogil=True)
def edge_cells(state, seen, top, at, near, wanted):
    """Set `wanted` uint8 [side, side] to 1 for cells of a tile that are free, explored and beside a
    cell that is neither explored nor occupied.

    `state`, `seen`: occupancy and explored area by row, tile and cell [rows, tiles, side]. `top`:
    first row of the tile; `at`: index of the tile within rows. `near` uint8 [side + 2, side + 2] is
    scratch memory.
    """
    # No slices, no negative indices and no counting, so that all loops run in SIMD.
    side, last = wanted.shape[0], state.shape[1] - 1
    for y in range(side + 2):
        if top + y == 0 or top + y > state.shape[0]:
            near[y, :] = 1
            continue
        r = abs(top + y - 1)
        for x in range(side):
            near[y, x + 1] = (seen[r, at, x] == 0) & (state[r, at, x] != 100)
        near[y, 0] = near[y, side + 1] = 1
        if at > 0:
            near[y, 0] = (seen[r, at - 1, side - 1] == 0) & (state[r, at - 1, side - 1] != 100)
        if at < last:
            near[y, side + 1] = (seen[r, at + 1, 0] == 0) & (state[r, at + 1, 0] != 100)
    for y in range(side):
        r = abs(top + y)
        for x in range(side):
            beside = near[y, x + 1] | near[y + 2, x + 1] | near[y + 1, x] | near[y + 1, x + 2]
            wanted[y, x] = (state[r, at, x] == 0) & (seen[r, at, x] != 0) & (beside != 0)


@njit(cache=True, nogil=True)
def describe(
    cells,
    starts,  # clusters: world cells int32 [m, 2], and start of each int64 [clusters + 1]
    corner,  # world cell of the grid's first cell
    labels,
    offsets,
    reached,
    near,
    near_corner,
    changed,  # a `ReachedCells` and its labels
    same,  # int64 [clusters]: index of the former frontier with equal cells, -1 for none
    former_centres,
    former_reachable,  # `centres` and `reachable` of the former frontiers
    stale,  # box of world cells with changed values: row_lo, row_hi, column_lo, column_hi
):
    """Per cluster: centre (world cell, int32 [clusters, 2]), reachability (uint8), and flags
    (uint8): VALUES if its values need an update, OTHER if it differs from its former frontier.

    The centre is the cell nearest to the mean of its reachable cells (of all cells if none is
    reachable), the first of several at the same distance. It is computed anew only if the cells or
    their reachability may have changed.
    """
    n, count = cells.shape[0], starts.size - 1
    can, of_tile = np.empty(n, np.uint8), np.empty(n, np.uint16)
    centres, reachable = np.empty((count, 2), np.int32), np.empty(count, np.uint8)
    flags = np.zeros(count, np.uint8)
    for k in range(count):
        j = same[k]
        own = cells[starts[k] : starts[k + 1]]
        if j >= 0 and former_reachable[j] < 2 and not in_tiles(own, corner, changed):
            centres[k], reachable[k] = former_centres[j], former_reachable[j]
            row, column = centres[k]
            if stale[0] <= row < stale[1] and stale[2] <= column < stale[3]:
                flags[k] = VALUES
            continue
        for i in range(starts[k], starts[k + 1]):  # scattered reads alone in one loop, so that
            r, c = cells[i, 0] - corner[0], cells[i, 1] - corner[1]  # many are in flight at once
            of_tile[i] = labels[np.uint64(r), np.uint64(c)]
        for i in range(starts[k], starts[k + 1]):
            r, c = cells[i, 0] - corner[0], cells[i, 1] - corner[1]
            y, x = r - near_corner[0], c - near_corner[1]
            beside = 0 <= y < near.shape[0] and 0 <= x < near.shape[1] and near[y, x] != 0
            component = offsets[r // TILE, c // TILE] + of_tile[i] - 1
            can[i] = beside or (of_tile[i] != 0 and reached[component] != 0)
        any_reached = np.any(can[starts[k] : starts[k + 1]])
        counted = 0
        total_r = total_c = 0.0
        for i in range(starts[k], starts[k + 1]):
            if not any_reached or can[i] != 0:
                total_r += cells[i, 0] - corner[0]
                total_c += cells[i, 1] - corner[1]
                counted += 1
        mean_r, mean_c, best = total_r / counted, total_c / counted, np.inf
        row = column = np.int32(0)
        for i in range(starts[k], starts[k + 1]):
            r, c = cells[i, 0] - corner[0], cells[i, 1] - corner[1]
            off = (r - mean_r) ** 2 + (c - mean_c) ** 2
            if off < best and (not any_reached or can[i] != 0):
                best, row, column = off, cells[i, 0], cells[i, 1]
        centres[k, 0], centres[k, 1], reachable[k] = row, column, any_reached
        if j < 0 or former_centres[j, 0] != row or former_centres[j, 1] != column:
            flags[k] = VALUES | OTHER
        elif stale[0] <= row < stale[1] and stale[2] <= column < stale[3]:
            flags[k] = VALUES
        if j >= 0 and former_reachable[j] != reachable[k]:
            flags[k] |= OTHER
    return centres, reachable, flags


@njit(cache=True, nogil=True)
def in_tiles(cells, corner, tiles):
    """True if a world cell lies in a tile of the mask `tiles`, which begins at `corner`."""
    side = np.uint32(TILE)
    for i in range(cells.shape[0]):
        row, column = np.uint32(cells[i, 0] - corner[0]), np.uint32(cells[i, 1] - corner[1])
        if tiles[row // side, column // side] != 0:
            return True
    return False


@njit(cache=True, nogil=True)
def first_block(z_low, z_high, occupancy, start, end, target_cells, margin, ground):
    """First cell on a straight line whose obstacle intersects the line, or (-1, -1).

    `start`, `end` float64 [3]: row, column in cells (not rounded) and height in metres. The start's
    own cell, and cells within `target_cells` of the end, do not block.
    """
    rows, columns = occupancy.shape
    dr, dc, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    length = np.hypot(dr, dc)
    steps = int(length * 4) + 1
    own_r, own_c = int(np.floor(start[0])), int(np.floor(start[1]))
    # Clip the line to the map: an end may be any finite place.
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
