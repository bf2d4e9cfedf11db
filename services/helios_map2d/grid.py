"""The square grid under every map layer: world metres to cells and back."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class GridSpec:
    """A grid of square cells, axis-aligned with the world.

    Arrays over the grid are indexed `[row, column]`: the row counts along world y, the column
    along world x. Cell (0, 0) has its lower-left corner at `origin_m`.
    """

    cell_m: float
    rows: int
    columns: int
    origin_m: tuple[float, float]

    @staticmethod
    def centred_on(x_m: float, y_m: float, cell_m: float, size_cells: int) -> GridSpec:
        """A square grid around a point; its origin is a whole number of cells from the world's.

        So two maps of one world differ by whole cells wherever each of them started.
        """
        half = size_cells // 2
        column = math.floor(x_m / cell_m) - half
        row = math.floor(y_m / cell_m) - half
        return GridSpec(cell_m, size_cells, size_cells, (column * cell_m, row * cell_m))

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows, self.columns

    @property
    def size_m(self) -> tuple[float, float]:
        """Extent along world x and y, metres."""
        return self.columns * self.cell_m, self.rows * self.cell_m

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Row and column of a world point, which may lie outside (see `contains_cell`)."""
        column = math.floor((x_m - self.origin_m[0]) / self.cell_m)
        return math.floor((y_m - self.origin_m[1]) / self.cell_m), column

    def centre_of(self, row: int, column: int) -> tuple[float, float]:
        """World x, y of a cell's centre, metres."""
        x_m = self.origin_m[0] + (column + 0.5) * self.cell_m
        return x_m, self.origin_m[1] + (row + 0.5) * self.cell_m

    def cells_of(self, points_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Rows and columns [n, 2] of world points [n, 2] (x, y)."""
        cells = np.floor((points_m - np.asarray(self.origin_m)) / self.cell_m).astype(np.int64)
        return cells[:, ::-1]

    def contains_cell(self, row: int, column: int) -> bool:
        return 0 <= row < self.rows and 0 <= column < self.columns

    def contains(self, x_m: float, y_m: float) -> bool:
        return self.contains_cell(*self.cell_of(x_m, y_m))

    def crop(self, box: Box) -> GridSpec:
        """The grid of a sub-array `array[box.slices]`."""
        x_m = self.origin_m[0] + box.column_lo * self.cell_m
        y_m = self.origin_m[1] + box.row_lo * self.cell_m
        return GridSpec(self.cell_m, box.rows, box.columns, (x_m, y_m))

    @property
    def whole(self) -> Box:
        return Box(0, self.rows, 0, self.columns)


@dataclass(frozen=True)
class Box:
    """A half-open box of cells: rows [row_lo, row_hi), columns [column_lo, column_hi)."""

    row_lo: int
    row_hi: int
    column_lo: int
    column_hi: int

    @property
    def rows(self) -> int:
        return self.row_hi - self.row_lo

    @property
    def columns(self) -> int:
        return self.column_hi - self.column_lo

    @property
    def empty(self) -> bool:
        return self.rows <= 0 or self.columns <= 0

    @property
    def slices(self) -> tuple[slice, slice]:
        return slice(self.row_lo, self.row_hi), slice(self.column_lo, self.column_hi)

    def union(self, other: Box | None) -> Box:
        """The smallest box that holds both; an empty or missing one adds nothing."""
        if other is None or other.empty:
            return self
        if self.empty:
            return other
        return Box(
            min(self.row_lo, other.row_lo),
            max(self.row_hi, other.row_hi),
            min(self.column_lo, other.column_lo),
            max(self.column_hi, other.column_hi),
        )

    def grown(self, cells: int, within: Box) -> Box:
        """This box with a margin on every side, cut to `within`."""
        return Box(
            max(self.row_lo - cells, within.row_lo),
            min(self.row_hi + cells, within.row_hi),
            max(self.column_lo - cells, within.column_lo),
            min(self.column_hi + cells, within.column_hi),
        )
