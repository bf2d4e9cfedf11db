"""Numba kernels of the open ground: obstacles in reach, components by tile, the walk over them.

Reached through `ground.py`; a readable twin stands in its test.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from helios_map2d.frontier_kernels import find_root
from helios_map2d.grid import TILE


@njit(cache=True, nogil=True)
def follow_obstacles(before, occupancy, row_lo, column_lo, half_widths, crowd, stale):
    """Count new obstacles into the discs around them, and vanished ones out of them.

    `before` int8 [rows, columns] is a box, as it was, whose corner on the grid is (row_lo,
    column_lo); `occupancy` is the whole grid as it is. Marks in `stale` uint8 [tile rows, tile
    columns] the tiles whose open ground may have changed.
    """
    rows, columns = before.shape
    reach = half_widths.size // 2
    height, width = crowd.shape
    for r in range(rows):
        row = r + row_lo
        for first in range(0, columns, TILE):
            was = before[r][first : first + TILE]
            now = occupancy[row][column_lo + first : column_lo + first + was.size]
            other = np.int8(0)
            for i in range(was.size):  # mostly nothing; in SIMD
                other |= was[i] ^ now[i]
            if other == 0:
                continue
            for i in range(was.size):
                old, new, column = was[i], now[i], first + i + column_lo
                if old == new:
                    continue
                stale[row // TILE, column // TILE] = 1
                if old == 100 or new == 100:
                    count_disc(row, column, 1 if new == 100 else -1, half_widths, crowd)
                    top, bottom = max(0, row - reach), min(height - 1, row + reach)
                    left, right = max(0, column - reach), min(width - 1, column + reach)
                    for y in range(top // TILE, bottom // TILE + 1):
                        for x in range(left // TILE, right // TILE + 1):
                            stale[y, x] = 1


@njit(cache=True, nogil=True)
def count_disc(row, column, step, half_widths, crowd):
    """Add `step` to the cells of a disc; `half_widths` are those of its rows."""
    reach = half_widths.size // 2
    height, width = crowd.shape
    for y in range(max(0, row - reach), min(height - 1, row + reach) + 1):
        half = half_widths[y - row + reach]
        first, end = max(0, column - half), min(width, column + half + 1)
        cells = crowd[y][first:end]
        for i in range(cells.size):
            cells[i] += np.uint16(step)


@njit(cache=True, nogil=True)
def label_tiles(occupancy, crowd, stale, labels, counts):
    """Label the open ground of the stale tiles anew, 4-connected within the tile, from 1."""
    parent = np.empty(TILE * TILE + 1, np.int32)
    number = np.empty(TILE * TILE + 1, np.int32)
    for tr in range(stale.shape[0]):
        for tc in range(stale.shape[1]):
            if stale[tr, tc] == 0:
                continue
            r0, c0 = tr * TILE, tc * TILE
            n = 0
            for r in range(r0, r0 + TILE):
                for c in range(c0, c0 + TILE):
                    if occupancy[r, c] != 0 or crowd[r, c] != 0:
                        labels[r, c] = 0
                        continue
                    above = labels[r - 1, c] if r > r0 else 0
                    left = labels[r, c - 1] if c > c0 else 0
                    if above == 0 and left == 0:
                        n += 1
                        parent[n] = n
                        labels[r, c] = n
                    elif above == 0 or left == 0 or above == left:
                        labels[r, c] = max(above, left)
                    else:
                        a, b = find_root(parent, above), find_root(parent, left)
                        parent[max(a, b)] = min(a, b)
                        labels[r, c] = min(a, b)
            found = 0
            for i in range(1, n + 1):
                root = find_root(parent, i)
                if root == i:
                    found += 1
                    number[i] = found
                else:
                    number[i] = number[root]  # a root is smaller than what hangs on it
            for r in range(r0, r0 + TILE):
                for c in range(c0, c0 + TILE):
                    if labels[r, c] != 0:
                        labels[r, c] = number[labels[r, c]]
            counts[tr, tc] = found


@njit(cache=True, nogil=True)
def crossable(occupancy, crowd, corner, cell, radius_cells, near):
    """Where the robot may go around its own cell: `near` uint8, a box with its corner at `corner`.

    It has ones where unknown ground may be crossed and gets them on free ground; none where an
    obstacle is in reach, but for what is no obstacle within the robot's own disc.
    """
    for r in range(near.shape[0]):
        row = r + corner[0]
        state = occupancy[row][corner[1] : corner[1] + near.shape[1]]
        crowded = crowd[row][corner[1] : corner[1] + near.shape[1]]
        own = radius_cells * radius_cells - (row - cell[0]) ** 2
        for c in range(near.shape[1]):
            open_ground = ((near[r, c] != 0) | (state[c] == 0)) & (crowded[c] == 0)
            inside = ((c + corner[1] - cell[1]) ** 2 <= own) & (state[c] != 100)
            near[r, c] = open_ground | inside
    near[cell[0] - corner[0], cell[1] - corner[1]] = 1


@njit(cache=True, nogil=True, inline="always")
def enter(labels, offsets, row, column, reached, queue, n):
    """Note the component of a cell as reached and queue it; the queue's new length."""
    label = labels[row, column]
    if label == 0:
        return n
    tr, tc = row // TILE, column // TILE
    at = offsets[tr, tc] + label - 1
    if reached[at] != 0:
        return n
    reached[at] = 1
    queue[n, 0] = tr
    queue[n, 1] = tc
    queue[n, 2] = label
    return n + 1


@njit(cache=True, nogil=True)
def walk(labels, offsets, near, corner, cell, reached, got):
    """Flood the ground `near` the robot from its cell, and the components of open ground from it.

    `near` uint8 is a box with its corner at `corner`, where the robot may also cross what is not
    open; `got` gets the cells of it that were reached, `reached` the components.
    """
    rows, columns = near.shape
    tile_rows, tile_columns = offsets.shape
    queue = np.empty((reached.size + 1, 3), np.int32)
    stack = np.empty((4 * rows * columns + 5, 2), np.int32)
    head = n = 0
    stack[0, 0] = cell[0] - corner[0]
    stack[0, 1] = cell[1] - corner[1]
    top = 1
    while top > 0:
        while top > 0:
            top -= 1
            r, c = stack[top, 0], stack[top, 1]
            if r < 0 or c < 0 or r >= rows or c >= columns or not near[r, c] or got[r, c] != 0:
                continue
            got[r, c] = 1
            n = enter(labels, offsets, r + corner[0], c + corner[1], reached, queue, n)
            for dr, dc in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                stack[top, 0] = r + dr
                stack[top, 1] = c + dc
                top += 1
        walked = head < n
        while head < n:
            tr, tc, label = queue[head, 0], queue[head, 1], queue[head, 2]
            head += 1
            r0, c0 = tr * TILE, tc * TILE
            for i in range(TILE):
                if tr > 0 and labels[r0, c0 + i] == label:
                    n = enter(labels, offsets, r0 - 1, c0 + i, reached, queue, n)
                if tr < tile_rows - 1 and labels[r0 + TILE - 1, c0 + i] == label:
                    n = enter(labels, offsets, r0 + TILE, c0 + i, reached, queue, n)
                if tc > 0 and labels[r0 + i, c0] == label:
                    n = enter(labels, offsets, r0 + i, c0 - 1, reached, queue, n)
                if tc < tile_columns - 1 and labels[r0 + i, c0 + TILE - 1] == label:
                    n = enter(labels, offsets, r0 + i, c0 + TILE, reached, queue, n)
        if walked:  # from outside, ground near the robot may be reached that was cut off from it
            for r in range(rows):
                for c in range(columns):
                    label = labels[r + corner[0], c + corner[1]]
                    if label == 0 or got[r, c] != 0 or not near[r, c]:
                        continue
                    tile = offsets[(r + corner[0]) // TILE, (c + corner[1]) // TILE]
                    if reached[tile + label - 1] != 0:
                        stack[top, 0] = r
                        stack[top, 1] = c
                        top += 1
