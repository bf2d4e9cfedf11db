"""Frontiers: boundaries between searched free ground and what was not searched (paper 3.1.1).

The cells of frontiers are kept by tile, and only tiles that changed are looked at again. What is
done over all frontiers (clusters, centres, values) costs by their cells, not by the map.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from helios_map2d import frontier_kernels
from helios_map2d.grid import TILE, Box, GridSpec, Tile
from helios_map2d.ground import OpenGround
from helios_map2d.value import values_near

NO_CELLS = np.empty((0, 2), np.int32)


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
        self._cells: dict[Tile, NDArray[np.int32]] = {}  # world cells
        self._scratch = np.zeros(grid.shape, np.int32)
        self._former: tuple[Frontier, ...] = ()
        self._values_at: dict[str, dict[tuple[int, int], float]] = {}  # by world cell

    def grow(self, grid: GridSpec) -> None:
        """Go on over a larger grid."""
        self.grid = grid
        self._scratch = np.zeros(grid.shape, np.int32)

    def reset(self) -> None:
        """Nothing is searched any more."""
        self._cells.clear()
        self._former = ()
        self._values_at.clear()

    def values_changed(self, names: Iterable[str], box: Box) -> None:
        """Layers have changed within a box of world cells: values near it must be found anew."""
        near = box.grown(int(self.rules.value_radius_m / self.grid.cell_m) + 1)
        for name in names:
            kept = self._values_at.get(name, {})
            self._values_at[name] = {
                (row, column): value
                for (row, column), value in kept.items()
                if not (near.row_lo <= row < near.row_hi
                        and near.column_lo <= column < near.column_hi)
            }  # fmt: skip

    def forget_values(self) -> None:
        """All layers are other ones."""
        self._values_at.clear()

    def remember(self, former: tuple[Frontier, ...]) -> None:
        """Frontiers by whose cells those found next are recognised."""
        self._former = former

    def update(
        self,
        occupancy: NDArray[np.int8],
        explored: NDArray[np.uint8],
        tiles: Iterable[Tile],
    ) -> None:
        """Look at the given tiles again; arrays are over the whole grid."""
        corner = np.array(self.grid.corner, np.int32)
        whole = self.grid.to_world(self.grid.whole)
        wanted = [t for t in tiles if whole.holds(Box.of_tile(t))]
        if not wanted:
            return
        first = np.array(wanted, np.int32) * TILE - corner
        cells = np.empty((len(wanted) * TILE**2, 2), np.int32)
        counts = np.empty(len(wanted), np.int32)
        n = frontier_kernels.cells_of_tiles(occupancy, explored, first, TILE, cells, counts)
        parts = np.split(cells[:n] + corner, np.cumsum(counts)[:-1])
        for tile, part in zip(wanted, parts, strict=True):
            if len(part):
                self._cells[tile] = part
            else:
                self._cells.pop(tile, None)

    def find(
        self,
        occupancy: NDArray[np.int8],
        ground: OpenGround,
        robot_xy_m: tuple[float, float],
        values: Mapping[str, NDArray[np.float32]],
    ) -> tuple[Frontier, ...]:
        """The frontiers as they are now, largest first (all arrays are over the whole grid)."""
        rules, cell_m = self.rules, self.grid.cell_m
        corner = np.array(self.grid.corner, np.int32)
        found = [self._cells[t] for t in sorted(self._cells)]
        cells = (np.concatenate(found) if found else NO_CELLS) - corner
        labels, sizes = np.empty((2, len(cells)), np.int32)
        clusters = frontier_kernels.cluster(cells, self._scratch, labels, sizes)
        sizes = sizes[:clusters]
        least = rules.min_size_m / cell_m - 1e-9
        kept = np.argsort(-sizes, kind="stable")[: int(np.count_nonzero(sizes >= least))]
        if not len(kept):
            self._former = ()
            return ()
        place = np.full(clusters, -1, np.int32)
        place[kept] = np.arange(len(kept))
        starts = np.zeros(len(kept) + 1, np.int64)
        np.cumsum(sizes[kept], out=starts[1:])
        own = np.empty((int(starts[-1]), 2), np.int32)
        frontier_kernels.gather(cells, labels, place, starts, own)
        row, column = self.grid.cell_of(*robot_xy_m)
        robot = (min(max(row, 0), self.grid.rows - 1), min(max(column, 0), self.grid.columns - 1))
        reached = ground.reached_from(occupancy, robot, rules.blind_radius_m / cell_m)
        centres = np.empty((len(kept), 2), np.int32)
        reachable = np.empty(len(kept), np.bool_)
        frontier_kernels.describe(
            own, starts, ground.labels, reached.offsets, reached.reached, reached.near,
            reached.near_corner, TILE, centres, reachable,
        )  # fmt: skip
        by_layer = self._values_near(centres, values)
        own += corner
        self._former = tuple(
            self._identified(
                [
                    Frontier(
                        id=0,
                        centre_m=self.grid.centre_of(int(centres[k, 0]), int(centres[k, 1])),
                        size_m=float(sizes[j] * cell_m),
                        reachable=bool(reachable[k]),
                        values={name: float(near[k]) for name, near in by_layer.items()},
                        cells=own[starts[k] : starts[k + 1]],
                    )
                    for k, j in enumerate(kept)
                ]
            )
        )
        return self._former

    def revalued(self, values: Mapping[str, NDArray[np.float32]]) -> tuple[Frontier, ...]:
        """The frontiers that were found last, by the layers as they are now.

        What `find` gives when nothing else has changed, at a fraction of its cost.
        """
        centres = np.array([self.grid.cell_of(*f.centre_m) for f in self._former], np.int32)
        by_layer = self._values_near(centres.reshape(-1, 2), values)
        self._former = tuple(
            replace(f, values={name: float(near[k]) for name, near in by_layer.items()})
            for k, f in enumerate(self._former)
        )
        return self._former

    def _values_near(
        self, centres: NDArray[np.int32], values: Mapping[str, NDArray[np.float32]]
    ) -> dict[str, NDArray[np.float64]]:
        """By layer, near each centre; found anew only where the layers have changed since."""
        radius_cells = self.rules.value_radius_m / self.grid.cell_m
        row, column = self.grid.corner
        places = [(int(r) + row, int(c) + column) for r, c in centres]
        out: dict[str, NDArray[np.float64]] = {}
        for name, layer in values.items():
            known = self._values_at.get(name, {})
            new = [k for k, place in enumerate(places) if place not in known]
            fresh = values_near(layer, centres[new], radius_cells) if new else ()
            found = dict(zip((places[k] for k in new), fresh, strict=True))
            self._values_at[name] = {p: known[p] if p in known else found[p] for p in places}
            out[name] = np.array([self._values_at[name][p] for p in places], np.float64)
        return out

    def _identified(self, found: list[Frontier]) -> list[Frontier]:
        """The frontiers with their numbers: those of former ones, or new ones."""
        same = {f.cells.tobytes(): f.id for f in self._former}
        ids = [0] * len(found)
        taken: set[int] = set()
        for k, f in enumerate(found):
            former_id = same.get(f.cells.tobytes())
            if former_id is not None:
                ids[k] = former_id
                taken.add(former_id)
        new = [k for k, id in enumerate(ids) if id == 0]
        old = [f for f in self._former if f.id not in taken]
        if new and old:
            votes = self._votes([found[k].cells for k in new], [f.cells for f in old])
            for flat in np.argsort(-votes, axis=None, kind="stable"):
                k, j = divmod(int(flat), len(old))
                if votes[k, j] > 0 and ids[new[k]] == 0 and old[j].id not in taken:
                    ids[new[k]] = old[j].id
                    taken.add(old[j].id)
        for k in new:
            if ids[k] == 0:
                ids[k] = self.next_id
                self.next_id += 1
        return [replace(f, id=number) for f, number in zip(found, ids, strict=True)]

    def _votes(
        self, new: list[NDArray[np.int32]], old: list[NDArray[np.int32]]
    ) -> NDArray[np.int32]:
        """How many cells of each new cluster lie close to each old one, [new, old]."""
        corner = np.array(self.grid.corner, np.int32)
        votes = np.zeros((len(new), len(old)), np.int32)
        frontier_kernels.shared_ground(
            np.concatenate(new) - corner, _numbered(new), np.concatenate(old) - corner,
            _numbered(old), int(self.rules.same_within_m / self.grid.cell_m), self._scratch, votes,
        )  # fmt: skip
        return votes


def _numbered(parts: list[NDArray[np.int32]]) -> NDArray[np.int32]:
    return np.repeat(np.arange(len(parts), dtype=np.int32), [len(part) for part in parts])
