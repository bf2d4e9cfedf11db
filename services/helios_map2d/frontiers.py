"""Frontiers: boundaries between searched free ground and what was not searched (paper 3.1.1).

The cells of frontiers are kept by tile, and only tiles that changed are looked at again. Where no
cell is other than before, so are no clusters and numbers; a frontier is made anew where its centre,
its values or whether it can be reached are other than before.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from helios_map2d import frontier_kernels
from helios_map2d.grid import EMPTY, TILE, Box, GridSpec, Tile
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
        self._by_cells: dict[bytes, Frontier] = {}
        # Of the clusters of these cells, as the former frontiers are ordered; None: to be found.
        self._clusters: tuple[NDArray[np.int32], NDArray[np.int64]] | None = None
        self._centres = NO_CELLS  # world cells
        self._described_as = (b"", b"")  # their centres, and which can be reached, as bytes
        self._values_of: tuple[str, ...] = ()  # the layers of the values that frontiers have
        self._stale: Box | None = EMPTY  # world cells near which values changed since; None: all

    def grow(self, grid: GridSpec) -> None:
        """Go on over a larger grid."""
        self.grid = grid
        self._scratch = np.zeros(grid.shape, np.int32)

    def reset(self) -> None:
        """Nothing is searched any more."""
        self._cells.clear()
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
        self._keep(former, [f.cells.tobytes() for f in former])
        cells = [self.grid.cell_of(*f.centre_m) for f in former]
        self._centres = np.array(cells, np.int32).reshape(-1, 2) + _pair(self.grid.corner)
        self._clusters = None

    def _keep(self, found: Iterable[Frontier], keys: list[bytes]) -> None:
        """These are the frontiers now; `keys` are their cells as bytes."""
        self._former = tuple(found)
        self._by_cells = dict(zip(keys, self._former, strict=True))

    def update(
        self,
        occupancy: NDArray[np.int8],
        explored: NDArray[np.uint8],
        tiles: Iterable[Tile],
    ) -> None:
        """Look at the given tiles again; arrays are over the whole grid."""
        whole = self.grid.to_world(self.grid.whole)
        rows = range(-(-whole.row_lo // TILE), whole.row_hi // TILE)
        columns = range(-(-whole.column_lo // TILE), whole.column_hi // TILE)
        wanted = [t for t in tiles if t[0] in rows and t[1] in columns]
        if not wanted:
            return
        corner = _pair(self.grid.corner)
        first = np.array(wanted, np.int32) * TILE - corner
        cells = np.empty((len(wanted) * TILE**2, 2), np.int32)
        counts = np.empty(len(wanted), np.int32)
        n = frontier_kernels.cells_of_tiles(occupancy, explored, first, TILE, cells, counts)
        found, start = cells[:n] + corner, 0
        for tile, count in zip(wanted, counts.tolist(), strict=True):
            part, old = found[start : start + count], self._cells.get(tile, NO_CELLS)
            start += count
            if len(old) == count and old.tobytes() == part.tobytes():
                continue
            self._clusters = None
            if count:
                self._cells[tile] = part
            else:
                del self._cells[tile]

    def find(
        self,
        occupancy: NDArray[np.int8],
        ground: OpenGround,
        robot_xy_m: tuple[float, float],
        values: Mapping[str, NDArray[np.float32]],
    ) -> tuple[Frontier, ...]:
        """The frontiers as they are now, largest first (all arrays are over the whole grid)."""
        same = self._clusters is not None
        own, starts = self._clusters = self._clusters or self._clustered()
        centres, reachable = self._described(own, starts, occupancy, ground, robot_xy_m)
        before: Sequence[Frontier | None] = self._former
        if same:
            still = self._stale == EMPTY and tuple(values) == self._values_of
            if still and (centres.tobytes(), reachable.tobytes()) == self._described_as:
                return self._former
            keys, numbers = list(self._by_cells), [f.id for f in self._former]
            parts = [f.cells for f in self._former]
        else:
            parts = [own[a:b] for a, b in itertools.pairwise(starts.tolist())]
            keys = [part.tobytes() for part in parts]
            numbers = self._numbers(parts, keys)
            before = [self._by_cells.get(key) for key in keys]
        self._centres, self._described_as = centres, (centres.tobytes(), reachable.tobytes())
        cell_m = self.grid.cell_m
        places = [((c + 0.5) * cell_m, (r + 0.5) * cell_m) for r, c in centres.tolist()]
        near = self._values_near(centres, places, before, values)
        found_now = []
        for k, (id, can) in enumerate(zip(numbers, reachable.tolist(), strict=True)):
            old, now = before[k], (places[k], can, near[k])
            if old is None or (old.centre_m, old.reachable, old.values) != now:
                old = Frontier(id, places[k], len(parts[k]) * cell_m, can, near[k], parts[k])
            found_now.append(old)
        self._keep(found_now, keys)
        return self._former

    def revalued(self, values: Mapping[str, NDArray[np.float32]]) -> tuple[Frontier, ...]:
        """The frontiers that were found last, by the layers as they are now.

        What `find` gives when nothing else has changed, at a fraction of its cost.
        """
        places = [f.centre_m for f in self._former]
        near = self._values_near(self._centres, places, self._former, values)
        found = [
            f if f.values == now else replace(f, values=now)
            for f, now in zip(self._former, near, strict=True)
        ]
        self._keep(found, list(self._by_cells))
        return self._former

    def _clustered(self) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """The cells of each cluster that is large enough, largest first: world cells [m, 2], and
        where in them each begins, and the last ends."""
        corner = _pair(self.grid.corner)
        found = [self._cells[t] for t in sorted(self._cells)]
        cells = (np.concatenate(found) if found else NO_CELLS) - corner
        labels, sizes = np.empty((2, len(cells)), np.int32)
        clusters = frontier_kernels.cluster(cells, self._scratch, labels, sizes)
        sizes = sizes[:clusters]
        least = self.rules.min_size_m / self.grid.cell_m - 1e-9
        kept = np.argsort(-sizes, kind="stable")[: int(np.count_nonzero(sizes >= least))]
        place = np.full(clusters, -1, np.int32)
        place[kept] = np.arange(len(kept))
        starts = np.zeros(len(kept) + 1, np.int64)
        np.cumsum(sizes[kept], out=starts[1:])
        own = np.empty((int(starts[-1]), 2), np.int32)
        frontier_kernels.gather(cells, labels, place, starts, own)
        own += corner
        return own, starts

    def _described(
        self,
        own: NDArray[np.int32],
        starts: NDArray[np.int64],
        occupancy: NDArray[np.int8],
        ground: OpenGround,
        robot_xy_m: tuple[float, float],
    ) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """The centre (world cell) of each cluster, and whether it can be reached."""
        row, column = self.grid.cell_of(*robot_xy_m)
        robot = (min(max(row, 0), self.grid.rows - 1), min(max(column, 0), self.grid.columns - 1))
        blind_cells = self.rules.blind_radius_m / self.grid.cell_m
        reached = ground.reached_from(occupancy, robot, blind_cells)
        centres = np.empty((len(starts) - 1, 2), np.int32)
        reachable = np.empty(len(starts) - 1, np.bool_)
        frontier_kernels.describe(
            own, starts, self.grid.corner, ground.labels, reached.offsets, reached.reached,
            reached.near, reached.near_corner, centres, reachable,
        )  # fmt: skip
        return centres, reachable

    def _values_near(
        self,
        centres: NDArray[np.int32],
        places: Sequence[tuple[float, float]],
        before: Sequence[Frontier | None],
        values: Mapping[str, NDArray[np.float32]],
    ) -> list[Mapping[str, float]]:
        """Each layer's value near each centre (world cells [n, 2], and the same in metres): that of
        the frontier `before` where it had the same centre and no layer has changed near it since.
        """
        names, stale = tuple(values), self._stale
        out: list[Mapping[str, float]] = [{}] * len(places)
        fresh = []
        for k, (row, column) in enumerate(centres.tolist()):
            old = before[k]
            if (
                old is not None and old.centre_m == places[k] and names == self._values_of
                and stale is not None
                and not (stale.row_lo <= row < stale.row_hi
                         and stale.column_lo <= column < stale.column_hi)
            ):  # fmt: skip
                out[k] = old.values
            else:
                fresh.append(k)
        self._values_of, self._stale = names, EMPTY
        if not fresh:
            return out
        radius_cells = self.rules.value_radius_m / self.grid.cell_m
        cells = centres[fresh] - _pair(self.grid.corner)
        found = [values_near(layer, cells, radius_cells).tolist() for layer in values.values()]
        for i, k in enumerate(fresh):
            out[k] = {name: near[i] for name, near in zip(names, found, strict=True)}
        return out

    def _numbers(self, found: list[NDArray[np.int32]], keys: list[bytes]) -> list[int]:
        """The number of each cluster: that of a former frontier, or a new one."""
        same = [self._by_cells.get(key) for key in keys]
        ids = [0 if f is None else f.id for f in same]
        taken = set(ids)
        new = [k for k, id in enumerate(ids) if id == 0]
        old = [f for f in self._former if f.id not in taken]
        if new and old:
            votes = self._votes([found[k] for k in new], [f.cells for f in old])
            for flat in np.argsort(-votes, axis=None, kind="stable").tolist():
                k, j = divmod(flat, len(old))
                if votes[k, j] == 0:
                    break
                if ids[new[k]] == 0 and old[j].id not in taken:
                    ids[new[k]] = old[j].id
                    taken.add(old[j].id)
        for k in new:
            if ids[k] == 0:
                ids[k] = self.next_id
                self.next_id += 1
        return ids

    def _votes(
        self, new: list[NDArray[np.int32]], old: list[NDArray[np.int32]]
    ) -> NDArray[np.int32]:
        """How many cells of each new cluster lie close to each old one, [new, old]."""
        corner = _pair(self.grid.corner)
        votes = np.zeros((len(new), len(old)), np.int32)
        frontier_kernels.shared_ground(
            np.concatenate(new) - corner, _numbered(new), np.concatenate(old) - corner,
            _numbered(old), int(self.rules.same_within_m / self.grid.cell_m), self._scratch, votes,
        )  # fmt: skip
        return votes


def _pair(cell: tuple[int, int]) -> NDArray[np.int32]:
    return np.array(cell, np.int32)


def _numbered(parts: list[NDArray[np.int32]]) -> NDArray[np.int32]:
    return np.repeat(np.arange(len(parts), dtype=np.int32), [len(part) for part in parts])
