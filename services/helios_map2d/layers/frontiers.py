"""Frontiers: boundaries between searched free ground and what was not searched (paper 3.1.1).

The cells of frontiers lie tile after tile, and only tiles that changed are looked at again. Where
no cell is other than before, so are no clusters and numbers; a frontier is made anew where its
centre, its values or whether it can be reached are other than before.
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
    """Lengths in metres. `blind_radius_m`: unknown ground this near the robot may be crossed."""

    min_size_m: float = 0.40
    value_radius_m: float = 0.50
    robot_radius_m: float = 0.30
    blind_radius_m: float = 1.00
    same_within_m: float = 0.15


@dataclass(frozen=True)
class Frontier:
    """One frontier.

    `centre_m` is the centre of one of its cells, in the world; `size_m` its length; `values` the
    value of each layer by VLFM's rule; `cells` int32 [n, 2] its world cells (row, column).
    """

    id: int
    centre_m: tuple[float, float]
    size_m: float
    reachable: bool
    values: Mapping[str, float]
    cells: NDArray[np.int32]


class FrontierFinder:
    """Finds frontiers and keeps the identity of those that persist.

    A frontier keeps its number while it does not change, and while some of its cells lie within
    `same_within_m` of where it was; of several that qualify, the one that shares most cells. When
    one splits, the others get new numbers. Numbers are never used twice.
    """

    def __init__(self, grid: GridSpec, rules: FrontierRules, next_id: int = 1) -> None:
        self.grid = grid
        self.rules = rules
        self.next_id = next_id
        self._cells = NO_CELLS  # of all frontiers, large enough or not, tile after tile
        self._values_of: tuple[str, ...] = ()  # the layers of the values that frontiers have
        self._stale: Box | None = EMPTY  # world cells near which values changed since; None: all
        self.remember(())

    def grow(self, grid: GridSpec) -> None:
        """Go on over a larger grid."""
        self.grid = grid

    def reset(self) -> None:
        """Nothing is searched any more."""
        self._cells = NO_CELLS
        self.remember(())

    def values_changed(self, box: Box) -> None:
        """Layers have changed within a box of world cells: values near it must be found anew."""
        near = box.grown(int(self.rules.value_radius_m / self.grid.cell_m) + 1)
        if self._stale is not None and not box.empty:
            self._stale = near.union(self._stale)

    def forget_values(self) -> None:
        """All layers are other ones."""
        self._stale = None

    def remember(self, former: tuple[Frontier, ...]) -> None:
        """Frontiers by whose cells those found next are recognised."""
        self._former = former
        self._same = False  # whether the clusters of all cells are those of the former
        self._own = np.concatenate([NO_CELLS, *(f.cells for f in former)])
        self._starts = np.cumsum([0, *(len(f.cells) for f in former)], dtype=np.int64)
        self._ids = np.array([f.id for f in former], np.int64)
        cells = [self.grid.cell_of(*f.centre_m) for f in former]
        self._centres = np.array(cells, np.int32).reshape(-1, 2) + _pair(self.grid.corner)
        self._reachable = np.full(len(former), 2, np.uint8)  # 0 or 1; 2: to be found out

    def update(
        self, occupancy: NDArray[np.int8], explored: NDArray[np.uint8], tiles: TileMask
    ) -> None:
        """Look at the given tiles again; arrays are over the whole grid."""
        self._cells, other = frontier_kernels.look_again(
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
        """The frontiers as they are now, largest first (all arrays are over the whole grid)."""
        own, starts, ids, same = self._clustered()
        reached = self._reached(occupancy, ground, robot_xy_m)
        centres, reachable, flags = frontier_kernels.describe(
            own, starts, self.grid.corner, ground.labels, reached.offsets, reached.reached,
            reached.near, reached.near_corner, same, self._centres, self._reachable,
            self._stale_for(values),
        )  # fmt: skip
        if not self._same or flags.any():
            self._former = self._renewed(own, starts, ids, same, centres, reachable, flags, values)
        self._own, self._starts, self._ids, self._same = own, starts, ids, True
        self._centres, self._reachable = centres, reachable
        return self._former

    def revalued(self, values: Mapping[str, NDArray[np.float32]]) -> tuple[Frontier, ...]:
        """The frontiers that were found last, by the layers as they are now.

        What `find` gives when nothing else has changed, at a fraction of its cost.
        """
        row_lo, row_hi, column_lo, column_hi = self._stale_for(values)
        rows, columns = self._centres.T
        stale = (rows >= row_lo) & (rows < row_hi) & (columns >= column_lo) & (columns < column_hi)
        which = np.flatnonzero(stale)
        found = list(self._former)
        for k, near in zip(which.tolist(), self._values_at(self._centres[which], values),
                           strict=True):  # fmt: skip
            if found[k].values != near:
                found[k] = replace(found[k], values=near)
        self._former = tuple(found)
        return self._former

    def _clustered(
        self,
    ) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """The cells of each cluster that is large enough, largest first: world cells [m, 2], and
        where in them each begins, and the last ends; their numbers, and their places among the
        former where those have the very same cells, else -1."""
        if self._same:
            return self._own, self._starts, self._ids, np.arange(len(self._ids))
        cell_m = self.grid.cell_m
        least = self.rules.min_size_m / cell_m - 1e-9
        own, starts = cluster_kernels.clusters_of(self._cells, TILE, least)
        ids, same, self.next_id = identity_kernels.recognise(
            own, starts, self._own, self._starts, self._ids,
            int(self.rules.same_within_m / cell_m), self.next_id,
        )  # fmt: skip
        return own, starts, ids, same

    def _reached(
        self, occupancy: NDArray[np.int8], ground: ReachableFloor, robot_xy_m: tuple[float, float]
    ) -> ReachedCells:
        """What can be reached by the robot."""
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
        """Each frontier as it is now, the former itself where nothing is other; see `describe`."""
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
        """The box of world cells near which these layers may be other than frontiers have them:
        row_lo, row_hi, column_lo, column_hi. From now on frontiers have them as they are."""
        box, names = self._stale, tuple(values)
        known = box is not None and names == self._values_of
        self._values_of, self._stale = names, EMPTY
        return box.bounds if known and box is not None else EVERYWHERE

    def _values_at(
        self, centres: NDArray[np.int32], values: Mapping[str, NDArray[np.float32]]
    ) -> list[Mapping[str, float]]:
        """Each layer's value near each of some world cells [n, 2]."""
        if not len(centres) or not values:
            return [{} for _ in centres]
        radius_cells = self.rules.value_radius_m / self.grid.cell_m
        cells = centres - _pair(self.grid.corner)
        found = [values_near(layer, cells, radius_cells).tolist() for layer in values.values()]
        return [dict(zip(values, near, strict=True)) for near in zip(*found, strict=True)]


def _pair(cell: tuple[int, int]) -> NDArray[np.int32]:
    return np.array(cell, np.int32)
