"""Where the robot's centre can get to, kept up to date at the cost of what has changed.

Ground is open where it is free and no obstacle lies within the robot's radius. Two things make
that local: each cell counts the obstacles within the radius, so a new or vanished obstacle costs
one disc; and each tile knows the connected components of its own open ground, so only changed
tiles are labelled again. What can be reached is then found by walking from component to component
over the tiles' borders, not from cell to cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_map2d.grid import TILE, Box, GridSpec, carried_over
from helios_map2d.kernels import reachability as ground_kernels


@dataclass(frozen=True)
class ReachedCells:
    """What can be reached, for `frontier_kernels.describe`.

    Open ground by component: `offsets` int64 [tile rows, tile columns] and `reached` uint8 by
    offset + label - 1. Ground right around the robot: `near` uint8 over a box whose corner is
    `near_corner` (row, column of the grid).
    """

    offsets: NDArray[np.int64]
    reached: NDArray[np.uint8]
    near: NDArray[np.uint8]
    near_corner: tuple[int, int]


class ReachableFloor:
    """`crowd` uint16 [rows, columns]: obstacles within the robot's radius of a cell; `labels`
    uint16: the component of open ground within the cell's tile, 0 where it is not open; `counts`
    int32 [tile rows, tile columns]: components of a tile; `edges` uint16 [tile rows, tile columns,
    4, TILE]: the labels along its sides."""

    def __init__(self, grid: GridSpec, radius_cells: float) -> None:
        self.grid = grid
        self.reach = int(radius_cells)
        self.radius_cells = radius_cells
        down = np.arange(-self.reach, self.reach + 1)
        self._half_widths = np.sqrt(radius_cells**2 - down**2).astype(np.int64)
        self.crowd = np.zeros(grid.shape, np.uint16)
        self.labels = np.zeros(grid.shape, np.uint16)
        self._begin(grid)

    def _begin(self, grid: GridSpec) -> None:
        """No tile of a grid is known."""
        tiles = grid.rows // TILE, grid.columns // TILE
        self.counts = np.zeros(tiles, np.int32)
        self.edges = np.zeros((*tiles, 4, TILE), np.uint16)
        self._offsets, self._components = np.zeros(tiles, np.int64), 0

    def grow(self, grid: GridSpec, known: Box) -> None:
        """Go on over a larger grid; `known` (world cells) holds all open ground and obstacles."""
        near = known.grown(self.reach)
        self.crowd = carried_over(self.crowd, self.grid, grid, near)
        self.labels = carried_over(self.labels, self.grid, grid, known)
        counts, edges = self.counts, self.edges
        self._begin(grid)
        row = (self.grid.corner[0] - grid.corner[0]) // TILE
        column = (self.grid.corner[1] - grid.corner[1]) // TILE
        at = slice(row, row + len(counts)), slice(column, column + counts.shape[1])
        self.counts[at], self.edges[at] = counts, edges
        self._components = ground_kernels.number_components(self.counts, self._offsets)
        self.grid = grid

    def update(self, occupancy: NDArray[np.int8], before: NDArray[np.int8], box: Box) -> None:
        """Follow a change of `occupancy` (over the whole grid) from `before` within `box`."""
        self._components = ground_kernels.follow(
            before, occupancy, box.row_lo, box.column_lo, self._half_widths,
            self.crowd, self.labels, self.counts, self.edges, self._offsets,
        )  # fmt: skip

    def reached_from(
        self, occupancy: NDArray[np.int8], cell: tuple[int, int], blind_cells: float
    ) -> ReachedCells:
        """What can be reached from a cell of the grid.

        The robot may cross unknown ground within `blind_cells`, which its camera cannot see, and
        leave the cells of its own disc even where they are beside an obstacle.
        """
        reached, near, corner = ground_kernels.reach(
            occupancy, self.crowd, self.labels, self.edges, self._offsets, self._components,
            cell, blind_cells, self.radius_cells,
        )  # fmt: skip
        return ReachedCells(self._offsets, reached, near, corner)
