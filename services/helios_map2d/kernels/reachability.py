"""Numba kernels of the open ground: obstacle counts, components by tile, and their traversal.

Called by `layers/reachability.py`; its test has a readable reference version.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from helios_map2d.grid import TILE
from helios_map2d.kernels.flood_fill import flood, near_ground
from helios_map2d.kernels.frontier_clusters import find_root

BOTTOM, TOP, LEFT, RIGHT = range(4)  # sides of a tile; the neighbour's side is `side ^ 1`
STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1))  # rows, columns to the neighbour at each side


@njit(cache=True, nogil=True)
def update_open_ground(
    before, occupancy, row_lo, column_lo, half_widths,  # see `follow_obstacles`
    obstacle_count, labels, counts, edges, offsets,  # see `ReachableFloor`
):  # fmt: skip
    """Update the open ground after a change of occupancy.

    Returns the number of components, and uint8 [tile rows, tile columns]: 1 for tiles with new
    labels.
    """
    stale = np.zeros(counts.shape, np.uint8)
    follow_obstacles(before, occupancy, row_lo, column_lo, half_widths, obstacle_count, stale)
    label_tiles(occupancy, obstacle_count, stale, labels, counts, edges)
    return number_components(counts, offsets), stale


@njit(cache=True, nogil=True)
def number_components(counts, offsets):
    """Write to `offsets` the number of components before each tile's and return their total."""
    total, flat, before = np.int64(0), counts.ravel(), offsets.ravel()
    for i in range(flat.size):
        before[i] = total
        total += flat[i]
    return total


@njit(cache=True, nogil=True)
def follow_obstacles(before, occupancy, row_lo, column_lo, half_widths, obstacle_count, stale):
    """Add new obstacles to the counts in the discs around them, and subtract vanished ones.

    `before` int8 [rows, columns] is the former occupancy of a box whose corner on the grid is
    (row_lo, column_lo); `occupancy` is the present occupancy of the whole grid. Marks in `stale`
    uint8 [tile rows, tile columns] the tiles whose open ground may have changed.
    """
    rows, columns = before.shape
    reach = half_widths.size // 2
    height, width = obstacle_count.shape
    for r in range(rows):
        row = r + row_lo
        for first in range(0, columns, TILE):
            was = before[r][first : first + TILE]
            now = occupancy[row][column_lo + first : column_lo + first + was.size]
            other = np.int8(0)
            for i in range(was.size):  # mostly no change; in SIMD
                other |= was[i] ^ now[i]
            if other == 0:
                continue
            for i in range(was.size):
                old, new, column = was[i], now[i], first + i + column_lo
                if old == new:
                    continue
                stale[row // TILE, column // TILE] = 1
                if old == 100 or new == 100:
                    count_disc(row, column, 1 if new == 100 else -1, half_widths, obstacle_count)
                    top, bottom = max(0, row - reach), min(height - 1, row + reach)
                    left, right = max(0, column - reach), min(width - 1, column + reach)
                    for y in range(top // TILE, bottom // TILE + 1):
                        for x in range(left // TILE, right // TILE + 1):
                            stale[y, x] = 1


@njit(cache=True, nogil=True)
def count_disc(row, column, step, half_widths, obstacle_count):
    """Add `step` to the cells of a disc; `half_widths`: half width of each of its rows."""
    reach = half_widths.size // 2
    height, width = obstacle_count.shape
    for y in range(max(0, row - reach), min(height - 1, row + reach) + 1):
        half = half_widths[y - row + reach]
        for x in range(max(0, column - half), min(width, column + half + 1)):
            obstacle_count[np.uint64(y), np.uint64(x)] += np.uint16(
                step
            )  # unsigned index: no check


@njit(cache=True, nogil=True)
def label_tiles(occupancy, obstacle_count, stale, labels, counts, edges):
    """Relabel the open ground of stale tiles, 4-connected within each tile, from 1.

    `edges` uint16 [tile rows, tile columns, 4, TILE] gets the labels along their sides.
    """
    parent = np.empty(TILE * TILE + 1, np.int32)
    open_ground = np.empty((TILE, TILE), np.uint8)
    for tr in range(stale.shape[0]):
        for tc in range(stale.shape[1]):
            r0, c0 = tr * TILE, tc * TILE
            if stale[tr, tc] == 0 or not open_anew(
                occupancy, obstacle_count, labels, r0, c0, open_ground
            ):
                continue
            n = label_runs(open_ground, parent, labels[r0 : r0 + TILE, c0 : c0 + TILE])
            found = 0
            for i in range(1, n + 1):  # a root is smaller than its children
                if parent[i] == i:
                    found += 1
                    parent[i] = found
                else:
                    parent[i] = parent[parent[i]]
            if found < n:
                for r in range(r0, r0 + TILE):
                    for c in range(c0, c0 + TILE):
                        if labels[r, c] != 0:
                            labels[r, c] = parent[labels[r, c]]
            counts[tr, tc] = found
            edges[tr, tc, TOP, :] = labels[r0 + TILE - 1, c0 : c0 + TILE]
            edges[tr, tc, BOTTOM, :] = labels[r0, c0 : c0 + TILE]
            edges[tr, tc, RIGHT, :] = labels[r0 : r0 + TILE, c0 + TILE - 1]
            edges[tr, tc, LEFT, :] = labels[r0 : r0 + TILE, c0]


@njit(cache=True, nogil=True)
def open_anew(occupancy, obstacle_count, labels, r0, c0, open_ground):
    """Write the open cells of a tile to `open_ground` uint8 [TILE, TILE].

    Returns True if they differ from the labelled cells.
    """
    other = np.uint8(0)
    for y in range(TILE):
        state, near_obstacles = (
            occupancy[r0 + y][c0 : c0 + TILE],
            obstacle_count[r0 + y][c0 : c0 + TILE],
        )
        label, line = labels[r0 + y][c0 : c0 + TILE], open_ground[y]
        for x in range(TILE):
            line[x] = (state[x] == 0) & (near_obstacles[x] == 0)
        for x in range(TILE):
            other |= line[x] ^ np.uint8(label[x] != 0)
    return other != 0


@njit(cache=True, nogil=True)
def label_runs(open_ground, parent, labels):
    """Label the runs of open cells along the rows of a tile and return the number of labels.

    A run that touches runs of the row below shares the smallest of their labels in `parent`.
    """
    below, here = np.zeros(TILE, np.int32), np.zeros(TILE, np.int32)
    n = 0
    for y in range(TILE):
        line = open_ground[y]
        here[:] = 0
        x = 0
        while x < TILE:
            if line[x] == 0:
                x += 1
                continue
            start, label, last = x, 0, 0
            while x < TILE and line[x] != 0:
                if below[x] != last and below[x] != 0:
                    if label == 0:
                        label = find_root(parent, below[x])
                    else:
                        other = find_root(parent, below[x])
                        parent[max(label, other)] = min(label, other)
                        label = min(label, other)
                last = below[x]
                x += 1
            if label == 0:
                n += 1
                label = parent[n] = n
            here[start:x] = label
        labels[y, :] = here
        below, here = here, below
    return n


@njit(cache=True, nogil=True)
def crossable(occupancy, obstacle_count, corner, cell, radius_cells, near):
    """Cells around the robot that it may cross: `near` uint8, a box with its corner at `corner`.

    On entry `near` is 1 where the robot may cross unknown ground. Free ground is added, cells with
    an obstacle within the radius are removed, and obstacle-free cells of the robot's own disc are
    added.
    """
    for r in range(near.shape[0]):
        row = r + corner[0]
        state = occupancy[row][corner[1] : corner[1] + near.shape[1]]
        near_obstacles = obstacle_count[row][corner[1] : corner[1] + near.shape[1]]
        own = radius_cells * radius_cells - (row - cell[0]) ** 2
        for c in range(near.shape[1]):
            open_ground = ((near[r, c] != 0) | (state[c] == 0)) & (near_obstacles[c] == 0)
            inside = ((c + corner[1] - cell[1]) ** 2 <= own) & (state[c] != 100)
            near[r, c] = open_ground | inside
    near[cell[0] - corner[0], cell[1] - corner[1]] = 1


@njit(cache=True, nogil=True, inline="always")
def enter(offsets, tr, tc, label, reached, queue, n):
    """Mark a tile's component as reached, queue it, and return the new queue length."""
    at = offsets[tr, tc] + label - 1
    if reached[at] != 0:
        return n
    reached[at] = 1
    queue[n, 0], queue[n, 1], queue[n, 2] = tr, tc, label
    return n + 1


@njit(cache=True, nogil=True)
def enter_row(labels, got, row, left, offsets, reached, queue, n):
    """Enter the components of a row's reached cells, from column `left` on.

    Returns the new queue length. Most cells have the label of the cell before.
    """
    before = 0
    for c in range(labels.size):
        label = np.int64(labels[c]) if got[c] != 0 else 0
        if label != before or (c + left) % TILE == 0:
            if label != 0:
                n = enter(offsets, row // TILE, (c + left) // TILE, label, reached, queue, n)
            before = label
    return n


@njit(cache=True, nogil=True)
def any_left(labels, near, got):
    """True if a row has open ground near the robot that is not reached yet."""
    found = np.uint8(0)
    for c in range(labels.size):  # no early exit, so that it runs in SIMD
        found |= (labels[c] != 0) & (near[c] != 0) & (got[c] == 0)
    return found != 0


@njit(cache=True, nogil=True)
def walk(labels, edges, offsets, near, corner, cell, reached, got):
    """Flood the ground `near` the robot from its cell, then the connected components.

    `near` uint8 is a box with its corner at `corner`, where the robot may also cross ground that is
    not open. `got` gets its reached cells, `reached` the reached components.
    """
    queue = np.empty((reached.size + 1, 3), np.int32)
    head = n = 0
    here = np.empty(near.shape, np.uint16)
    for r in range(near.shape[0]):
        here[r, :] = labels[r + corner[0], corner[1] : corner[1] + near.shape[1]]
    flood(near, cell[0] - corner[0], cell[1] - corner[1], got)
    more = True
    while more:
        for r in range(near.shape[0]):
            n = enter_row(here[r], got[r], r + corner[0], corner[1], offsets, reached, queue, n)
        while head < n:
            tr, tc, label = queue[head, 0], queue[head, 1], queue[head, 2]
            head += 1
            for side in range(4):
                y, x = tr + STEPS[side][0], tc + STEPS[side][1]
                if y < 0 or x < 0 or y >= offsets.shape[0] or x >= offsets.shape[1]:
                    continue
                ours, theirs = edges[tr, tc, side], edges[y, x, side ^ 1]
                before = 0
                for i in range(TILE):
                    beyond = np.int64(theirs[i]) if ours[i] == label else 0
                    if beyond != 0 and beyond != before:
                        n = enter(offsets, y, x, beyond, reached, queue, n)
                    before = beyond
        # Components may lead back to ground near the robot that the first flood did not reach.
        more = False
        for r in range(near.shape[0]):
            if not any_left(here[r], near[r], got[r]):
                continue
            for c in range(near.shape[1]):
                if here[r, c] == 0 or got[r, c] != 0 or near[r, c] == 0:
                    continue
                tile = offsets[(r + corner[0]) // TILE, (c + corner[1]) // TILE]
                if reached[tile + here[r, c] - 1] != 0:
                    flood(near, r, c, got)
                    more = True


@njit(cache=True, nogil=True)
def mark_other_reach(offsets, counts, reached, former_offsets, former_reached, out):
    """Set `out` uint8 [tile rows, tile columns] to 1 for tiles of which another component is
    reached than before. Only for tiles whose labels are the same as before."""
    at, before, size, marked = offsets.ravel(), former_offsets.ravel(), counts.ravel(), out.ravel()
    for t in range(at.size):
        for i in range(size[t]):
            if marked[t] == 0 and reached[at[t] + i] != former_reached[before[t] + i]:
                marked[t] = 1


@njit(cache=True, nogil=True)
def reach(
    occupancy,
    obstacle_count,
    labels,
    edges,
    offsets,
    components,  # all of it: `ReachableFloor`
    cell,
    blind_cells,
    radius_cells,
):
    """Ground reachable from a cell: uint8 by component, uint8 by cell of a box around the cell, and
    the box's corner (row, column)."""
    size = int(max(blind_cells, radius_cells)) + 1
    corner = max(0, cell[0] - size), max(0, cell[1] - size)
    rows = min(occupancy.shape[0], cell[0] + size + 1) - corner[0]
    columns = min(occupancy.shape[1], cell[1] + size + 1) - corner[1]
    near, got = np.zeros((rows, columns), np.uint8), np.zeros((rows, columns), np.uint8)
    reached = np.zeros(components, np.uint8)
    near_ground(occupancy, corner, cell, blind_cells, near)
    crossable(occupancy, obstacle_count, corner, cell, radius_cells, near)
    walk(labels, edges, offsets, near, corner, cell, reached, got)
    return reached, got, corner
