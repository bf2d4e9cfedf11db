"""Numba kernels for flood fill, one run of a row at a time.

Called by `layers/explored_area` and `kernels/reachability`. The tests have readable reference
versions.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def flood(open_ground, row, column, got):
    """Mark in `got` the 4-connected cells of `open_ground` around a cell (both uint8 [rows,
    columns]). A run of open cells along a row is marked completely or not at all."""
    rows, columns = open_ground.shape
    if open_ground[row, column] == 0:
        return
    stack = np.empty(2 * rows * (columns + 1) + 1, np.int32)  # upper bound on pushed runs
    stack[0] = row * columns + column
    n = 1
    while n > 0:
        n -= 1
        r, first = divmod(stack[n], columns)
        if got[r, first] != 0:
            continue
        end = first + 1
        while first > 0 and open_ground[r, first - 1] != 0:
            first -= 1
        while end < columns and open_ground[r, end] != 0:
            end += 1
        got[r, first:end] = 1
        for y in (r - 1, r + 1):
            if y < 0 or y >= rows:
                continue
            inside = False
            for x in range(first, end):
                before, inside = inside, open_ground[y, x] != 0 and got[y, x] == 0
                if inside and not before:
                    stack[n] = y * columns + x
                    n += 1


@njit(cache=True, nogil=True)
def near_ground(occupancy, corner, cell, radius_cells, near):
    """Mark the cells within a radius of a cell that a path without obstacles reaches.

    `near` uint8 [rows, columns] is a box with its corner at `corner` (row, column); it starts as
    zeros and gets ones.
    """
    open_ground = np.empty(near.shape, np.uint8)
    for r in range(near.shape[0]):
        row = r + corner[0]
        state = occupancy[row][corner[1] : corner[1] + near.shape[1]]
        left, line = radius_cells * radius_cells - (row - cell[0]) ** 2, open_ground[r]
        for c in range(state.size):
            off = c + corner[1] - cell[1]
            line[c] = (state[c] != 100) & (off * off <= left)
    flood(open_ground, cell[0] - corner[0], cell[1] - corner[1], near)
