"""Navigable area of a robot as grid cells, with geodesic distances over it. Pure functions.

A geodesic distance is the length of the shortest path over free cells. Below 0.1 m, for a disc of
0.3 m, such a path is straight to within half a millimetre: the test "within 0.1 m" checks the
straight distance and a free line. Dijkstra's algorithm over 16 neighbours finds longer paths, which
are then shortened by line of sight; their lengths are up to 2 % too long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

Points = NDArray[np.float64]  # [n, 2] m, world
Xy = tuple[float, float]

_LOOKS_PER_CELL = 4
# Moves to half of the 16 neighbours, each with the cells in between that must be free.
_MOVES: tuple[tuple[int, int, tuple[tuple[int, int], ...]], ...] = (
    (0, 1, ()),
    (1, 0, ()),
    (1, 1, ((0, 1), (1, 0))),
    (1, -1, ((0, -1), (1, 0))),
    (1, 2, ((0, 1), (1, 1))),
    (1, -2, ((0, -1), (1, -1))),
    (2, 1, ((1, 0), (1, 1))),
    (2, -1, ((1, 0), (1, -1))),
)


@dataclass(frozen=True, eq=False)
class NavigableArea:
    """Cells [row, column] that the robot can reach; cell (0, 0) has its corner at `origin_m`."""

    free: NDArray[np.bool_]
    origin_m: Xy
    cell_m: float

    def contains(self, points_m: Points) -> NDArray[np.bool_]:
        """Mask [n] of the points [n, 2] that lie in free cells."""
        column, row = np.floor((points_m - np.asarray(self.origin_m)) / self.cell_m).astype(int).T
        rows, columns = self.free.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        inside[inside] = self.free[row[inside], column[inside]]
        return inside

    def line_is_free(self, a_m: Xy, b_m: Xy) -> bool:
        """True if the line from a to b is free. The cell of a, the robot's own, counts as free."""
        away_m = math.dist(a_m, b_m)
        looks = max(2, math.ceil(_LOOKS_PER_CELL * away_m / self.cell_m) + 1)
        line = np.linspace(a_m, b_m, looks)
        cells = np.floor((line - np.asarray(self.origin_m)) / self.cell_m)
        return bool((self.contains(line) | (cells == cells[0]).all(axis=1)).all())

    def within(self, base_xy_m: Xy, goals_m: Points, limit_m: float) -> bool:
        """True if a goal of [n, 2] is within `limit_m` (at most 0.1 m) geodesic of the base."""
        away_m = np.hypot(*(goals_m - np.asarray(base_xy_m)).T)
        near = goals_m[away_m <= limit_m]
        return any(self.line_is_free(base_xy_m, (float(x), float(y))) for x, y in near)

    def shortest_m(self, start_m: Xy, goals_m: Points) -> float:
        """Length of the shortest path to the nearest goal of [n, 2]; inf if there is none."""
        goals_m = goals_m[self.contains(goals_m)] if len(goals_m) else goals_m
        row, column = self._cells(np.array([start_m]))[0]
        rows, columns = self.free.shape
        if len(goals_m) == 0 or not (0 <= row < rows and 0 <= column < columns):
            return math.inf
        source = int(row * columns + column)
        away, before = dijkstra(
            self._graph(), directed=False, indices=source, return_predecessors=True
        )
        ends = self._cells(goals_m) @ (columns, 1)
        best = int(np.argmin(away[ends]))
        if not np.isfinite(away[ends[best]]):
            return math.inf
        way = [int(ends[best])]
        while way[-1] != source:
            way.append(int(before[way[-1]]))
        inner = [self._middle(cell) for cell in way[-2:0:-1]]
        return self._pulled([start_m, *inner, (float(goals_m[best, 0]), float(goals_m[best, 1]))])

    def _pulled(self, way: list[Xy]) -> float:
        """Length of a path after removal of its unnecessary corners."""
        at, length_m = 0, 0.0
        while at < len(way) - 1:
            far = at + 1
            while far + 1 < len(way) and self.line_is_free(way[at], way[far + 1]):
                far += 1
            length_m += math.dist(way[at], way[far])
            at = far
        return length_m

    def _cells(self, points_m: Points) -> NDArray[np.int_]:
        xy = np.floor((points_m - np.asarray(self.origin_m)) / self.cell_m).astype(int)
        return xy[:, ::-1]

    def _middle(self, cell: int) -> Xy:
        row, column = divmod(cell, self.free.shape[1])
        x, y = self.origin_m
        return x + (column + 0.5) * self.cell_m, y + (row + 0.5) * self.cell_m

    def _graph(self) -> coo_array:
        rows, columns = self.free.shape
        number = np.arange(rows * columns).reshape(rows, columns)
        padded = np.pad(self.free, 2)
        starts, ends, lengths = [], [], []
        for dr, dc, between in _MOVES:
            open_ = self.free.copy()
            for r, c in (*between, (dr, dc)):
                open_ &= padded[2 + r : 2 + r + rows, 2 + c : 2 + c + columns]
            found = number[open_]
            starts.append(found)
            ends.append(found + dr * columns + dc)
            lengths.append(np.full(len(found), math.hypot(dr, dc) * self.cell_m))
        joined = (np.concatenate(starts), np.concatenate(ends))
        return coo_array((np.concatenate(lengths), joined), shape=(number.size,) * 2)


def clearance_m(points_m: Points, rectangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance [n] of points [n, 2] to the nearest of rectangles [m, 5]; 0 inside, inf without any.

    A rectangle is (x, y, half_x, half_y, yaw), with half extents along its own axes.
    """
    x, y, half_x, half_y, yaw = rectangles.T
    dx, dy = points_m[:, :1] - x, points_m[:, 1:] - y
    cos, sin = np.cos(yaw), np.sin(yaw)
    out_x = np.maximum(np.abs(cos * dx + sin * dy) - half_x, 0.0)
    out_y = np.maximum(np.abs(cos * dy - sin * dx) - half_y, 0.0)
    return np.hypot(out_x, out_y).min(axis=1, initial=np.inf)
