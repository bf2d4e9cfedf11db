"""Ground as the planner sees it: one version of the occupancy map, and poses on it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.geometry import Matrix, se2_to_se3, wrap_angle, yaw_of
from numpy.typing import NDArray


@dataclass(frozen=True)
class Pose2:
    """Where the base stands: world x, y in metres, heading in radians."""

    x_m: float
    y_m: float
    yaw_rad: float

    @staticmethod
    def of(T_world_base: Matrix) -> Pose2:
        return Pose2(float(T_world_base[0, 3]), float(T_world_base[1, 3]), yaw_of(T_world_base))

    @property
    def T_world_base(self) -> Matrix:
        return se2_to_se3(self.x_m, self.y_m, self.yaw_rad)

    @property
    def xy(self) -> tuple[float, float]:
        return self.x_m, self.y_m

    def ahead(self, distance_m: float) -> Pose2:
        """The pose so far straight ahead; below 0 behind."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return Pose2(self.x_m + distance_m * c, self.y_m + distance_m * s, self.yaw_rad)

    def distance_m(self, point: tuple[float, float] | NDArray[np.float64]) -> float:
        """In the ground plane, from the base's middle."""
        return math.hypot(point[0] - self.x_m, point[1] - self.y_m)

    def bearing_rad(self, point: tuple[float, float] | NDArray[np.float64]) -> float:
        """Turn that would face the point; positive left, in (-pi, pi]."""
        heading = math.atan2(point[1] - self.y_m, point[0] - self.x_m)
        return wrap_angle(heading - self.yaw_rad)


def facing(x_m: float, y_m: float, target: tuple[float, float] | NDArray[np.float64]) -> Pose2:
    """The pose at (x, y) that faces `target`."""
    return Pose2(x_m, y_m, math.atan2(target[1] - y_m, target[0] - x_m))


@dataclass(frozen=True)
class GroundMap:
    """One version of the 2D map; arrays [h, w], row along world y, column along world x.

    occupancy: int8 (-1 unknown, 0 free, 100 occupied); top_m: float32, height of the highest
    obstacle of a cell, 0 without one; origin_m: world x, y of the corner of cell [0, 0].
    """

    occupancy: NDArray[np.int8]
    top_m: NDArray[np.float32]
    cell_m: float
    origin_m: tuple[float, float]
    version: int = 0

    def exact_cells_of(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows and columns [n, 2], not rounded, of world points [n, 2] (x, y)."""
        return ((np.asarray(points_m, float) - self.origin_m) / self.cell_m)[:, ::-1]

    def cells_of(self, points_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Rows and columns [n, 2] of world points [n, 2]; may lie outside."""
        return np.floor(self.exact_cells_of(points_m)).astype(np.int64)

    def centres_of(self, cells: NDArray[np.integer]) -> NDArray[np.float64]:
        """World x, y [n, 2] of the middles of cells [n, 2]."""
        return (np.asarray(cells, float)[:, ::-1] + 0.5) * self.cell_m + np.asarray(self.origin_m)

    def inside(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which cells [n, 2] lie on the map."""
        rows, columns = self.occupancy.shape
        row, column = cells[:, 0], cells[:, 1]
        return (row >= 0) & (row < rows) & (column >= 0) & (column < columns)

    def window(self, cell: tuple[int, int], radius_m: float) -> tuple[slice, slice]:
        """Rows and columns of the square within `radius_m` of a cell, cut to the map; empty where
        none of it lies on the map."""
        n = math.ceil(radius_m / self.cell_m)
        rows, columns = self.occupancy.shape
        return _cut(int(cell[0]), n, rows), _cut(int(cell[1]), n, columns)

    def window_at(
        self, point_m: Sequence[float] | NDArray[np.float64], radius_m: float
    ) -> tuple[slice, slice]:
        """`window` around the cell of a world point (x, y)."""
        row, column = self.cells_of(np.array([[point_m[0], point_m[1]]]))[0]
        return self.window((int(row), int(column)), radius_m)

    def part(self, near: tuple[slice, slice]) -> GroundMap:
        """The map of a window, which may be empty; a view of these arrays."""
        row, column = near[0].start, near[1].start
        origin = (
            self.origin_m[0] + column * self.cell_m, self.origin_m[1] + row * self.cell_m
        )  # fmt: skip
        return GroundMap(
            self.occupancy[near], self.top_m[near], self.cell_m, origin, self.version
        )  # fmt: skip

    def padded(self, x_m: float, y_m: float, margin_m: float) -> GroundMap:
        """A map that also covers `margin_m` around the point; new cells are unknown."""
        row, column = self.cells_of(np.array([[x_m, y_m]]))[0]
        n = math.ceil(margin_m / self.cell_m)
        rows, columns = self.occupancy.shape
        before = max(0, n - int(row)), max(0, n - int(column))
        after = max(0, int(row) + n + 1 - rows), max(0, int(column) + n + 1 - columns)
        if before == after == (0, 0):
            return self
        pad = ((before[0], after[0]), (before[1], after[1]))
        origin = (
            self.origin_m[0] - before[1] * self.cell_m,
            self.origin_m[1] - before[0] * self.cell_m,
        )
        return GroundMap(
            np.pad(self.occupancy, pad, constant_values=-1),
            np.pad(self.top_m, pad),
            self.cell_m,
            origin,
            self.version,
        )


def corner_of(near: tuple[slice, slice]) -> NDArray[np.int64]:
    """Row and column [2] of the first cell of a window."""
    return np.array([near[0].start, near[1].start])


def unknown_near(
    ground: GroundMap, point: tuple[float, float], radius_m: float
) -> tuple[float, float]:
    """The unknown cell nearest to a point, or the point itself."""
    near = ground.window_at(point, radius_m)
    cells = np.argwhere(ground.occupancy[near] < 0)
    if not len(cells):
        return point
    centres = ground.centres_of(cells + corner_of(near))
    x_m, y_m = centres[np.argmin(np.hypot(*(centres - np.array(point)).T))]
    return float(x_m), float(y_m)


def _cut(middle: int, n: int, length: int) -> slice:
    """Indices middle - n to middle + n that lie in 0 to length - 1."""
    low = min(max(middle - n, 0), length)
    return slice(low, max(low, min(middle + n + 1, length)))
