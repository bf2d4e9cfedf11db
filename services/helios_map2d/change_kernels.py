"""Numba kernels that follow up on what came of a frame: what was searched, which tiles changed.

Reached through `explored.py` and `stack.py`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from helios_map2d.fuse_kernels import HEIGHTS, MEMORY, SEEN_NOW


@njit(cache=True, nogil=True)
def merge_seen(came_of_it, explored):
    """Count the cells that a frame saw as explored."""
    rows, columns = explored.shape
    for row in range(rows):
        for column in range(columns):
            explored[row, column] |= came_of_it[row, column] & SEEN_NOW


@njit(cache=True, nogil=True)
def note_changes(
    before, searched_before,  # int8, uint8 [rows, columns]: a box of whole tiles as it was
    occupancy, explored,  # int8, uint8: the whole map as it is
    corner,  # (row, column) of the box on the map
    came_of_it,  # uint8 [rows, columns]
    changed,  # uint8 [tile rows, tile columns] out: flags of what changed in each tile
    border,  # uint8 [tile rows + 2, tile columns + 2] out: a frontier may run differently there
    tile,  # cells along a tile
):  # fmt: skip
    """Sort the changes of a box by tile; `border` begins one tile before the box.

    Flags: SEEN_NOW where occupancy or what was searched is other than before, HEIGHTS and MEMORY
    as in `came_of_it`. Returns the box of cells that are other than before: row_lo, row_hi,
    column_lo, column_hi.
    """
    rows, columns = before.shape
    row_lo, row_hi, column_lo, column_hi = rows, 0, columns, 0
    remembered = HEIGHTS | MEMORY
    for r in range(rows):
        row = corner[0] + r
        for tc in range(columns // tile):
            first = tc * tile
            was, is_now = before[r][first : first + tile], occupancy[row][corner[1] + first :]
            sought, seeks = (
                searched_before[r][first : first + tile],
                explored[row][corner[1] + first :],
            )
            flags = came_of_it[r][first : first + tile]
            found = np.uint8(0)
            for c in range(tile):  # mostly nothing; in SIMD
                found |= was[c] ^ is_now[c]
            for c in range(tile):
                found |= (sought[c] ^ seeks[c]) | (flags[c] & remembered)
            if found == 0:
                continue
            tr = r // tile
            for c in range(tile):
                changed[tr, tc] |= flags[c] & remembered
                if was[c] == is_now[c] and sought[c] == seeks[c]:
                    continue
                changed[tr, tc] |= SEEN_NOW
                column = first + c
                border[tr + 1, tc + 1] = 1
                border[(r - 1 + tile) // tile, tc + 1] = 1
                border[(r + 1 + tile) // tile, tc + 1] = 1
                border[tr + 1, (column - 1 + tile) // tile] = 1
                border[tr + 1, (column + 1 + tile) // tile] = 1
                row_lo, row_hi = min(row_lo, r), r + 1
                column_lo, column_hi = min(column_lo, column), max(column_hi, column + 1)
    return row_lo, row_hi, column_lo, column_hi


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
