"""What the present search has seen: `explored_for_search`, forgotten when a new search begins.

The occupancy layer keeps what depth really saw, for good. A second task in a known home must
search again, so frontiers are drawn from this layer instead. The ground right around the robot,
which a tilted camera cannot see, counts as searched as far as one can walk there without crossing
an obstacle: otherwise the robot's own blind ring would be its nearest frontier.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from helios_map2d.grid import EMPTY, Box, GridSpec, carried_over
from helios_map2d.kernels import change as change_kernels
from helios_map2d.kernels import flood as flood_kernels


class SearchArea:
    """`explored` uint8 [rows, columns]: 1 where this search has looked; `box` holds all of it, in
    world cells."""

    def __init__(self, grid: GridSpec) -> None:
        self.grid = grid
        self.explored = np.zeros(grid.shape, np.uint8)
        self.box = EMPTY

    def grow(self, grid: GridSpec) -> None:
        """Go on over a larger grid."""
        self.explored = carried_over(self.explored, self.grid, grid, self.box)
        self.grid = grid

    def reset(self) -> None:
        self.explored[self.grid.to_local(self.box).slices] = 0
        self.box = EMPTY

    def add(self, seen: NDArray[np.uint8], window: Box) -> None:
        """Count what one view saw (flags over `window`, `fuse_kernels.SEEN_NOW`) as searched."""
        change_kernels.merge_seen(seen, self.explored[window.slices])
        self.box = self.grid.to_world(window).union(self.box)

    def take_back(self, cells: NDArray[np.bool_], window: Box) -> None:
        """Count cells (bool over `window`) as not searched."""
        self.explored[window.slices][cells] = 0

    def add_near_robot(
        self, occupancy: NDArray[np.int8], x_m: float, y_m: float, radius_m: float
    ) -> None:
        """Count the ground around the robot as searched, up to the obstacles around it."""
        row, column = self.grid.cell_of(x_m, y_m)
        radius_cells = radius_m / self.grid.cell_m
        reach = int(radius_cells) + 1
        box = Box(row, row + 1, column, column + 1).grown(reach, self.grid.whole)
        self.add(near_ground(occupancy, box, (row, column), radius_cells), box)


def near_ground(
    occupancy: NDArray[np.int8], box: Box, cell: tuple[int, int], radius_cells: float
) -> NDArray[np.uint8]:
    """Cells of `box` within a radius of `cell` with no obstacle to cross on the way: uint8."""
    near = np.zeros((box.rows, box.columns), np.uint8)
    flood_kernels.near_ground(occupancy, (box.row_lo, box.column_lo), cell, radius_cells, near)
    return near
