"""Reachability: ground that the robot's centre can reach, updated incrementally.

Ground is open where it is free and no obstacle lies within the robot's radius. Each cell counts the
obstacles within the radius, so a new or vanished obstacle costs one disc. Each tile stores the
connected components of its open ground, so only changed tiles are relabelled. A search from
component to component over the borders of tiles then finds the reachable ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_map2d.grid import TILE, Box, GridSpec, copy_to_larger_grid
from helios_map2d.kernels import reachability as ground_kernels


@dataclass(frozen=True)
class ReachedCells:
    """Reachable ground, as input of `frontier_cells.describe`.

    Open ground by component: `offsets` int64 [tile rows, tile columns], and `reached` uint8 indexed
    by offset + label - 1. Ground next to the robot: `near` uint8 over a box whose corner is
    `near_corner` (row, column of the grid). `changed` uint8 [tile rows, tile columns]: 1 for each
    tile of which other ground may be reachable than in the former answer.
    """

    offsets: NDArray[np.int64]
    reached: NDArray[np.uint8]
    near: NDArray[np.uint8]
    near_corner: tuple[int, int]
    changed: NDArray[np.uint8]


class ReachableFloor:
    """Open ground and its connected components.

    `obstacle_count` uint16 [rows, columns]: number of obstacles within the robot's radius of a
    cell; `labels` uint16: component of open ground within the cell's tile, 0 where not open;
    `counts` int32 [tile rows, tile columns]: number of components of a tile; `edges` uint16 [tile
    rows, tile columns, 4, TILE]: labels along the sides of a tile.
    """

    def __init__(self, grid: GridSpec, radius_cells: float) -> None:
        self.grid = grid
        self.reach = int(radius_cells)
        self.radius_cells = radius_cells
        down = np.arange(-self.reach, self.reach + 1)
        self._half_widths = np.sqrt(radius_cells**2 - down**2).astype(np.int64)
        self.obstacle_count = np.zeros(grid.shape, np.uint16)
        self.labels = np.zeros(grid.shape, np.uint16)
        self._begin(grid)

    def _begin(self, grid: GridSpec) -> None:
        """Start with empty tiles over a grid."""
        tiles = grid.rows // TILE, grid.columns // TILE
        self.counts = np.zeros(tiles, np.int32)
        self.edges = np.zeros((*tiles, 4, TILE), np.uint16)
        self._offsets, self._components = np.zeros(tiles, np.int64), 0
        self._relabelled = np.ones(tiles, np.uint8)  # since the last answer
        self._former: ReachedCells | None = None  # last answer on this grid

    def grow(self, grid: GridSpec, known: Box) -> None:
        """Continue on a larger grid; `known` (world cells) contains all open ground and
        obstacles."""
        near = known.grown(self.reach)
        self.obstacle_count = copy_to_larger_grid(self.obstacle_count, self.grid, grid, near)
        self.labels = copy_to_larger_grid(self.labels, self.grid, grid, known)
        counts, edges = self.counts, self.edges
        self._begin(grid)
        row = (self.grid.corner[0] - grid.corner[0]) // TILE
        column = (self.grid.corner[1] - grid.corner[1]) // TILE
        at = slice(row, row + len(counts)), slice(column, column + counts.shape[1])
        self.counts[at], self.edges[at] = counts, edges
        self._components = ground_kernels.number_components(self.counts, self._offsets)
        self.grid = grid

    def update(self, occupancy: NDArray[np.int8], before: NDArray[np.int8], box: Box) -> None:
        """Update after a change of `occupancy` (over the whole grid) from `before` within `box`."""
        self._components, relabelled = ground_kernels.update_open_ground(
            before, occupancy, box.row_lo, box.column_lo, self._half_widths,
            self.obstacle_count, self.labels, self.counts, self.edges, self._offsets,
        )  # fmt: skip
        self._relabelled |= relabelled

    def reached_from(
        self, occupancy: NDArray[np.int8], cell: tuple[int, int], blind_cells: float
    ) -> ReachedCells:
        """Ground reachable from a cell of the grid.

        The robot may cross unknown ground within `blind_cells`, which its camera cannot see, and
        leave the cells of its own disc even if they are beside an obstacle.
        """
        reached, near, corner = ground_kernels.reach(
            occupancy,
            self.obstacle_count,
            self.labels,
            self.edges,
            self._offsets,
            self._components,
            cell,
            blind_cells,
            self.radius_cells,
        )
        now = ReachedCells(self._offsets.copy(), reached, near, corner, self._relabelled)
        if self._former is not None:
            ground_kernels.mark_other_reach(
                now.offsets,
                self.counts,
                reached,
                self._former.offsets,
                self._former.reached,
                now.changed,
            )
            for answer in (now, self._former):
                (row, column), (rows, columns) = answer.near_corner, answer.near.shape
                box = Box(row, row + rows, column, column + columns)
                for tile in box.tiles:
                    now.changed[tile] = 1
        self._former, self._relabelled = now, np.zeros_like(self._relabelled)
        return now
