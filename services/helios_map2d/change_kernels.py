"""Numba kernels that follow up on what came of a frame: what was searched, which tiles changed.

Reached through `explored.py` and `state.py`.
"""

from __future__ import annotations

from numba import njit

from helios_map2d.fuse_kernels import HEIGHTS, SEEN_NOW


@njit(cache=True, nogil=True)
def merge_seen(came_of_it, explored):
    """Count the cells that a frame saw as explored."""
    rows, columns = explored.shape
    for row in range(rows):
        for column in range(columns):
            explored[row, column] |= came_of_it[row, column] & SEEN_NOW


@njit(cache=True, nogil=True)
def note_changes(
    before, after,  # int8 [rows, columns]: occupancy of a box of whole tiles
    searched_before, searched,  # uint8 [rows, columns]
    came_of_it,  # uint8 [rows, columns]
    shown,  # uint8 [tile rows, tile columns] out: what others see of the tile has changed
    kept,  # uint8 [tile rows, tile columns] out: or what is remembered of it
    border,  # uint8 [tile rows + 2, tile columns + 2] out: a frontier may run differently there
    tile,  # cells along a tile
):  # fmt: skip
    """Sort the changes of a box by tile; `border` begins one tile before the box."""
    rows, columns = before.shape
    for r in range(rows):
        for c in range(columns):
            flags = came_of_it[r, c]
            other = before[r, c] != after[r, c] or searched_before[r, c] != searched[r, c]
            if not other and flags < HEIGHTS:
                continue
            tr, tc = r // tile, c // tile
            kept[tr, tc] = 1
            if other or flags & HEIGHTS:
                shown[tr, tc] = 1
            if other:
                border[tr + 1, tc + 1] = 1
                border[(r - 1 + tile) // tile, tc + 1] = 1
                border[(r + 1 + tile) // tile, tc + 1] = 1
                border[tr + 1, (c - 1 + tile) // tile] = 1
                border[tr + 1, (c + 1 + tile) // tile] = 1


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
