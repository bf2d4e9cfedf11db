"""Frontiers: boundaries between explored free ground and unexplored ground (paper 3.1.1).

Frontier cells are stored tile after tile, and only changed tiles are examined again. Clusters and
ids change only if a cell changes. A `Frontier` is rebuilt only if its centre, values or
reachability change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from helios_map2d.grid import EMPTY, TILE, Box, GridSpec, TileMask
from helios_map2d.kernels import frontier_cells as frontier_kernels
from helios_map2d.kernels import frontier_clusters as cluster_kernels
from helios_map2d.kernels import frontier_tracking as identity_kernels
from helios_map2d.kernels.frontier_cells import VALUES
from helios_map2d.layers.reachability import ReachableFloor, ReachedCells
from helios_map2d.layers.value_layers import values_near

NO_CELLS = np.empty((0, 2), np.int32)
EVERYWHERE = (-(2**31), 2**31, -(2**31), 2**31)


@dataclass(frozen=True)
class FrontierRules:
    """Parameters of frontiers, in metres. `blind_radius_m`: the robot may cross unknown ground
    within this distance."""

    min_size_m: float = 0.40
    value_radius_m: float = 0.50
    robot_radius_m: float = 0.30
    blind_radius_m: float = 1.00
    same_within_m: float = 0.15


@dataclass(frozen=True)
class Frontier:
    """One frontier.

    `centre_m`: centre of one of its cells, in the world; `size_m`: length; `values`: value of each
    layer by VLFM's rule; `cells`: world cells int32 [n, 2] (row, column).
    """

    id: int
    centre_m: tuple[float, float]
    size_m: float
    reachable: bool
    values: Mapping[str, float]
    cells: NDArray[np.int32]


class FrontierFinder:
    """Finder of frontiers that preserves the ids of persistent ones.

    A frontier keeps its id if its cells do not change, or if some lie within `same_within_m` of its
    former cells; of several candidates the one with most such cells keeps it. If a frontier splits,
    the other parts get new ids. Ids are never reused.
    """

    def __init__(self, grid: GridSpec, rules: FrontierRules, next_id: int = 1) -> None:
        self.grid = grid
        self.rules = rules
        self.next_id = next_id
        self._cells = NO_CELLS  # of all frontiers, also too small ones, tile after tile
        self._values_of: tuple[str, ...] = ()  # layers whose values the frontiers have
        self._stale: Box | None = EMPTY  # box of world cells with changed values; None: all
        self.remember(())

    def grow(self, grid: GridSpec) -> None:
        """Continue on a larger grid."""
        self.grid = grid

    def reset(self) -> None:
        """Remove all frontiers, after a reset of the explored area."""
        self._cells = NO_CELLS
        self.remember(())

    def values_changed(self, box: Box) -> None:
        """Note that layers have changed within a box of world cells, so that values near it need an
        update."""
        near = box.grown(int(self.rules.value_radius_m / self.grid.cell_m) + 1)
        if self._stale is not None and not box.empty:
            self._stale = near.union(self._stale)

    def forget_values(self) -> None:
        """Note that all values need an update."""
        self._stale = None

    def remember(self, former: tuple[Frontier, ...]) -> None:
        """Set the former frontiers, whose ids the next ones inherit."""
        self._former = former
        self._same = False  # True if the cells still have the clusters of the former frontiers
        self._own = np.concatenate([NO_CELLS, *(f.cells for f in former)])
        self._starts = np.cumsum([0, *(len(f.cells) for f in former)], dtype=np.int64)
        self._ids = np.array([f.id for f in former], np.int64)
        cells = [self.grid.cell_of(*f.centre_m) for f in former]
        self._centres = np.array(cells, np.int32).reshape(-1, 2) + _pair(self.grid.corner)
        self._reachable = np.full(len(former), 2, np.uint8)  # 0 or 1; 2: not known yet

    def update(
        self, occupancy: NDArray[np.int8], explored: NDArray[np.uint8], tiles: TileMask
    ) -> None:
        """Update the frontier cells of the given tiles; arrays are over the whole grid."""
        self._cells, other = frontier_kernels.update_frontier_cells(
            occupancy, explored, self.grid.corner, tiles.mask, tiles.first, TILE, self._cells
        )
        self._same = self._same and not other

    def find(
        self,
        occupancy: NDArray[np.int8],
        ground: ReachableFloor,
        robot_xy_m: tuple[float, float],
        values: Mapping[str, NDArray[np.float32]],
    ) -> tuple[Frontier, ...]:
        """Present frontiers, largest first (all arrays are over the whole grid)."""
        own, starts, ids, same = self._clustered()
        reached = self._reached(occupancy, ground, robot_xy_m)
        centres, reachable, flags = frontier_kernels.describe(
            own, starts, self.grid.corner, ground.labels, reached.offsets, reached.reached,
            reached.near, reached.near_corner, reached.changed, same, self._centres,
            self._reachable, self._stale_for(values),
        )  # fmt: skip
        if not self._same or flags.any():
            self._former = self._renewed(own, starts, ids, same, centres, reachable, flags, values)
        self._own, self._starts, self._ids, self._same = own, starts, ids, True
        self._centres, self._reachable = centres, reachable
        return self._former

    def revalued(self, values: Mapping[str, NDArray[np.float32]]) -> tuple[Frontier, ...]:
        """Frontiers of the last `find`, with the present values of the layers.

        Equals `find` if only values have changed, at a fraction of its cost.
        """
        row_lo, row_hi, column_lo, column_hi = self._stale_for(values)
        rows, columns = self._centres.T
        stale = (rows >= row_lo) & (rows < row_hi) & (columns >= column_lo) & (columns < column_hi)
        which = np.flatnonzero(stale)
        found = list(self._former)
        for k, near in zip(
            which.tolist(), self._values_at(self._centres[which], values), strict=True
        ):
            if found[k].values != near:
                found[k] = replace(found[k], values=near)
        self._former = tuple(found)
        return self._former

    def _clustered(
        self,
    ) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Clusters that are large enough, largest first: world cells [m, 2], start of each cluster
        and end of the last, ids, and index of the former frontier with equal cells, else -1."""
        if self._same:
            return self._own, self._starts, self._ids, np.arange(len(self._ids))
        cell_m = self.grid.cell_m
        least = self.rules.min_size_m / cell_m - 1e-9
        own, starts = cluster_kernels.clusters_of(self._cells, TILE, least)
        ids, same, self.next_id = identity_kernels.match_frontier_ids(
            own,
            starts,
            self._own,
            self._starts,
            self._ids,
            int(self.rules.same_within_m / cell_m),
            self.next_id,
        )
        return own, starts, ids, same

    def _reached(
        self, occupancy: NDArray[np.int8], ground: ReachableFloor, robot_xy_m: tuple[float, float]
    ) -> ReachedCells:
        """Ground that the robot can reach."""
        row, column = self.grid.cell_of(*robot_xy_m)
        robot = (min(max(row, 0), self.grid.rows - 1), min(max(column, 0), self.grid.columns - 1))
        return ground.reached_from(occupancy, robot, self.rules.blind_radius_m / self.grid.cell_m)

    def _renewed(
        self,
        own: NDArray[np.int32],
        starts: NDArray[np.int64],
        ids: NDArray[np.int64],
        same: NDArray[np.int64],
        centres: NDArray[np.int32],
        reachable: NDArray[np.uint8],
        flags: NDArray[np.uint8],
        values: Mapping[str, NDArray[np.float32]],
    ) -> tuple[Frontier, ...]:
        """Present frontiers; an unchanged one is the former object. Parameters: see `describe`."""
        cell_m, ends = self.grid.cell_m, starts.tolist()
        numbers, places, can = ids.tolist(), centres.tolist(), reachable.tolist()
        near = iter(self._values_at(centres[(flags & VALUES) != 0], values))
        out = [self._former[j] if j >= 0 else None for j in same.tolist()]
        for k, flag in enumerate(flags.tolist()):
            if not flag:
                continue
            old, (row, column) = out[k], places[k]
            now = next(near) if flag & VALUES or old is None else old.values
            new = (column + 0.5) * cell_m, (row + 0.5) * cell_m
            if old is None or (old.centre_m, old.reachable, old.values) != (new, can[k], now):
                cells = own[ends[k] : ends[k + 1]] if old is None else old.cells
                out[k] = Frontier(numbers[k], new, len(cells) * cell_m, bool(can[k]), now, cells)
        return tuple(f for f in out if f is not None)

    def _stale_for(self, values: Mapping[str, NDArray[np.float32]]) -> tuple[int, int, int, int]:
        """Box of world cells whose frontiers may have outdated values of these layers: row_lo,
        row_hi, column_lo, column_hi. Resets the box: the caller updates these frontiers."""
        box, names = self._stale, tuple(values)
        known = box is not None and names == self._values_of
        self._values_of, self._stale = names, EMPTY
        return box.bounds if known and box is not None else EVERYWHERE

    def _values_at(
        self, centres: NDArray[np.int32], values: Mapping[str, NDArray[np.float32]]
    ) -> list[Mapping[str, float]]:
        """Value of each layer near each world cell [n, 2]."""
        if not len(centres) or not values:
            return [{} for _ in centres]
        radius_cells = self.rules.value_radius_m / self.grid.cell_m
        cells = centres - _pair(self.grid.corner)
        found = [values_near(layer, cells, radius_cells).tolist() for layer in values.values()]
        return [dict(zip(values, near, strict=True)) for near in zip(*found, strict=True)]


def _pair(cell: tuple[int, int]) -> NDArray[np.int32]:
    return np.array(cell, np.int32)
