"""Frontiers: boundaries between searched free ground and what was not searched (paper 3.1.1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_map2d import frontier_kernels
from helios_map2d.explored import near_ground
from helios_map2d.grid import Box, GridSpec
from helios_map2d.occupancy import FREE, OCCUPIED
from helios_map2d.value import value_near


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
    value of each layer by VLFM's rule; `cells` int32 [n, 2] its rows and columns on the map.
    """

    id: int
    centre_m: tuple[float, float]
    size_m: float
    reachable: bool
    values: Mapping[str, float]
    cells: NDArray[np.int32]


def frontier_cells(
    occupancy: NDArray[np.int8], explored: NDArray[np.uint8]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Frontier cells [n, 2] (row, column) and the cluster of each [n], counted from 0.

    Clusters are 8-connected and numbered by their first cell in row order.
    """
    mask = np.empty(occupancy.shape, np.uint8)
    frontier_kernels.frontier_mask(occupancy, explored, mask)
    n = int(np.count_nonzero(mask))
    cells = np.empty((n, 2), np.int32)
    parent = np.empty(n, np.int32)
    frontier_kernels.label_cells(mask, cells, parent)
    _, labels = np.unique(parent, return_inverse=True)
    return cells, labels.astype(np.int32)


def reachable_ground(
    occupancy: NDArray[np.int8],
    robot_cell: tuple[int, int],
    robot_radius_cells: float,
    blind_radius_cells: float,
) -> NDArray[np.bool_]:
    """Cells that the robot's centre can get to: bool [rows, columns].

    It keeps its radius from every obstacle and stays on free ground, save for unknown ground
    right around it. The cells at its own place are open to it even beside an obstacle.
    """
    rows, columns = occupancy.shape
    whole = Box(0, rows, 0, columns)
    distance = cv2.distanceTransform(
        (occupancy != OCCUPIED).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
    )
    clear = distance > robot_radius_cells
    if not (occupancy == OCCUPIED).any():
        clear[:] = True
    known = occupancy == FREE
    row, column = robot_cell
    reach = int(blind_radius_cells) + 1
    box = Box(row, row + 1, column, column + 1).grown(reach, whole)
    if not box.empty:
        known[box.slices] |= near_ground(occupancy, box, robot_cell, blind_radius_cells) > 0
    open_ground = (clear & known).astype(np.uint8)
    own = Box(row, row + 1, column, column + 1).grown(int(robot_radius_cells), whole)
    if own.empty:
        return np.zeros(occupancy.shape, np.bool_)
    down = np.arange(own.row_lo, own.row_hi)[:, None] - row
    across = np.arange(own.column_lo, own.column_hi) - column
    disc = (down**2 + across**2 <= robot_radius_cells**2) & (occupancy[own.slices] != OCCUPIED)
    open_ground[own.slices] |= disc.astype(np.uint8)
    open_ground[row, column] = 1
    _, labels = cv2.connectedComponents(open_ground, connectivity=4)
    return np.asarray(labels == labels[row, column])


class FrontierFinder:
    """Finds frontiers and keeps the identity of those that persist.

    A frontier keeps its number while some of its cells lie within `same_within_m` of where it was;
    of several that qualify, the one that shares most cells. When one splits, the others get new
    numbers. Numbers are never used twice.
    """

    def __init__(self, grid: GridSpec, rules: FrontierRules) -> None:
        self.grid = grid
        self.rules = rules
        self._former: tuple[Frontier, ...] = ()
        self._next_id = 1

    def find(
        self,
        occupancy: NDArray[np.int8],
        explored: NDArray[np.uint8],
        box: Box,
        robot_xy_m: tuple[float, float],
        values: Mapping[str, NDArray[np.float32]],
    ) -> tuple[Frontier, ...]:
        """The frontiers inside `box` (all arrays are over the whole grid), largest first."""
        rules, cell_m = self.rules, self.grid.cell_m
        if box.empty:
            self._former = ()
            return ()
        box = box.grown(1, self.grid.whole)
        cells, labels = frontier_cells(occupancy[box.slices], explored[box.slices])
        sizes = np.bincount(labels) if len(labels) else np.zeros(0, np.int64)
        kept = [
            k for k in np.argsort(-sizes, kind="stable") if sizes[k] * cell_m >= rules.min_size_m
        ]
        robot = self.grid.cell_of(*robot_xy_m)
        ground = reachable_ground(
            occupancy[box.slices],
            (int(np.clip(robot[0] - box.row_lo, 0, box.rows - 1)),
             int(np.clip(robot[1] - box.column_lo, 0, box.columns - 1))),
            rules.robot_radius_m / cell_m,
            rules.blind_radius_m / cell_m,
        )  # fmt: skip
        found: list[Frontier] = []
        for k in kept:
            own = cells[labels == k]
            at_hand = ground[own[:, 0], own[:, 1]]
            reachable = bool(at_hand.any())
            centre = snapped_centre(own[at_hand] if reachable else own)
            own = own + np.array([box.row_lo, box.column_lo], np.int32)
            row, column = centre[0] + box.row_lo, centre[1] + box.column_lo
            found.append(
                Frontier(
                    id=0,
                    centre_m=self.grid.centre_of(row, column),
                    size_m=float(sizes[k] * cell_m),
                    reachable=reachable,
                    values=self._values_near(row, column, values),
                    cells=own,
                )
            )
        self._former = tuple(self._identified(found))
        return self._former

    def revalued(self, values: Mapping[str, NDArray[np.float32]]) -> tuple[Frontier, ...]:
        """The frontiers that were found last, by the layers as they are now.

        What `find` gives when nothing else has changed, at a fraction of its cost.
        """
        self._former = tuple(
            replace(f, values=self._values_near(*self.grid.cell_of(*f.centre_m), values))
            for f in self._former
        )
        return self._former

    def _values_near(
        self, row: int, column: int, values: Mapping[str, NDArray[np.float32]]
    ) -> dict[str, float]:
        radius_cells = self.rules.value_radius_m / self.grid.cell_m
        return {n: value_near(layer, row, column, radius_cells) for n, layer in values.items()}

    def _identified(self, found: list[Frontier]) -> list[Frontier]:
        former = self._former
        votes = np.zeros((len(found), len(former)), np.int32)
        if found and former:
            frontier_kernels.shared_ground(
                np.concatenate([f.cells for f in found]),
                np.repeat(np.arange(len(found), dtype=np.int32), [len(f.cells) for f in found]),
                np.concatenate([f.cells for f in former]),
                np.repeat(np.arange(len(former), dtype=np.int32), [len(f.cells) for f in former]),
                int(self.rules.same_within_m / self.grid.cell_m),
                votes,
            )
        ids = [0] * len(found)
        taken: set[int] = set()
        order = np.argsort(-votes, axis=None, kind="stable")
        for flat in order:
            new, old = divmod(int(flat), len(former))
            if votes[new, old] > 0 and ids[new] == 0 and old not in taken:
                ids[new] = former[old].id
                taken.add(old)
        for new, number in enumerate(ids):
            if number == 0:
                ids[new] = self._next_id
                self._next_id += 1
        return [replace(f, id=number) for f, number in zip(found, ids, strict=True)]


def snapped_centre(cells: NDArray[np.int32]) -> tuple[int, int]:
    """The cell (row, column) of a set that lies nearest to its mean; the first of equals."""
    off = cells - cells.mean(axis=0)
    row, column = cells[int(np.argmin((off**2).sum(axis=1)))]
    return int(row), int(column)
