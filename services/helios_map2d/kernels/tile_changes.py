"""Numba kernels that evaluate the effect of a frame: explored cells and changed tiles.

Called by `layers/explored_area.py` and `layer_stack.py`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from helios_map2d.kernels.occupancy_fusion import HEIGHTS, MEMORY, SEEN_NOW


@njit(cache=True, nogil=True)
def merge_seen(came_of_it, explored):
    """Mark the cells that a frame saw as explored."""
    rows, columns = explored.shape
    for row in range(rows):
        for column in range(columns):
            explored[row, column] |= came_of_it[row, column] & SEEN_NOW


@njit(cache=True, nogil=True)
def note_changes(
    before,
    searched_before,  # int8, uint8 [rows, columns]: former state of a box of whole tiles
    occupancy,
    explored,  # int8, uint8: present state of the whole map
    corner,  # (row, column) of the box on the map: a multiple of the tile
    came_of_it,  # uint8 [rows, columns]
    changed,  # uint8 [tile rows, tile columns] out: flags of the changes in each tile
    border,  # uint8 [tile rows + 2, tile columns + 2] out: 1 where frontiers may have changed
    tile,  # cells along the side of a tile
):
    """Sort the changes of a box by tile; `border` begins one tile before the box.

    Flags: SEEN_NOW if occupancy or explored area has changed, HEIGHTS and MEMORY as in
    `came_of_it`. Returns the box of changed cells: row_lo, row_hi, column_lo, column_hi.
    """
    rows, columns = before.shape
    row_lo, row_hi, column_lo, column_hi = rows, 0, columns, 0
    remembered = HEIGHTS | MEMORY
    # By row, tile and cell: an index into a tile is never negative, which SIMD needs.
    box = rows, columns // tile, tile
    was, sought, flags = before.reshape(box), searched_before.reshape(box), came_of_it.reshape(box)
    whole = occupancy.shape[0], occupancy.shape[1] // tile, tile
    is_now, seeks = occupancy.reshape(whole), explored.reshape(whole)
    for r in range(rows):
        row, tr = abs(corner[0] + r), r // tile
        for tc in range(columns // tile):
            at = abs(corner[1] // tile + tc)
            found = kept = np.uint8(0)
            for c in range(tile):  # mostly no change
                found |= was[r, tc, c] ^ is_now[row, at, c]
            for c in range(tile):
                found |= (sought[r, tc, c] ^ seeks[row, at, c]) | (flags[r, tc, c] & remembered)
            if found == 0:
                continue
            for c in range(tile):
                kept |= flags[r, tc, c] & remembered
            changed[tr, tc] |= kept
            lo, hi = 0, tile  # range of the changed cells
            while lo < tile and (
                was[r, tc, lo] == is_now[row, at, lo] and sought[r, tc, lo] == seeks[row, at, lo]
            ):
                lo += 1
            if lo == tile:
                continue
            while (
                was[r, tc, hi - 1] == is_now[row, at, hi - 1]
                and sought[r, tc, hi - 1] == seeks[row, at, hi - 1]
            ):
                hi -= 1
            changed[tr, tc] |= SEEN_NOW
            border[tr + 1, tc + 1] = 1
            border[(r - 1 + tile) // tile, tc + 1] = 1
            border[(r + 1 + tile) // tile, tc + 1] = 1
            if lo == 0:
                border[tr + 1, tc] = 1
            if hi == tile:
                border[tr + 1, tc + 2] = 1
            row_lo, row_hi = min(row_lo, r), r + 1
            column_lo = min(column_lo, tc * tile + lo)
            column_hi = max(column_hi, tc * tile + hi)
    return row_lo, row_hi, column_lo, column_hi


@njit(cache=True, nogil=True)
def known_extent(occupancy, searched):
    """Box of the known or searched cells of a window: row_lo, row_hi, column_lo, column_hi."""
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
