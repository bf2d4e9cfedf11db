"""Grid of all map layers: conversion between world metres, cells and tiles.

World cells are numbered from the world's origin: cell (row, column) spans y in [row, row + 1) and
x in [column, column + 1) times the cell size. A grid is a window of world cells that may grow. So
the world cell of a place does not depend on the start or the size of a map. Tiles are squares of
`TILE` world cells a side, numbered in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TILE = 64
Tile = tuple[int, int]  # row, column of a tile, from the world's origin


@dataclass(frozen=True)
class GridSpec:
    """Grid of square cells, aligned with the world axes.

    Arrays over the grid are indexed `[row, column]`: rows along world y, columns along world x.
    `corner` is the world cell (row, column) of cell (0, 0).
    """

    cell_m: float
    rows: int
    columns: int
    corner: tuple[int, int]

    @staticmethod
    def centred_on(x_m: float, y_m: float, cell_m: float, size_cells: int) -> GridSpec:
        """Square grid of whole tiles around a point, at least `size_cells` a side."""
        half = size_cells / 2
        row, column = math.floor(y_m / cell_m), math.floor(x_m / cell_m)
        around = Box(
            math.floor(row - half),
            math.ceil(row + half),
            math.floor(column - half),
            math.ceil(column + half),
        )
        return GridSpec.over(around.tiled, cell_m)

    @staticmethod
    def over(box: Box, cell_m: float) -> GridSpec:
        """Grid over a box of world cells."""
        return GridSpec(cell_m, box.rows, box.columns, (box.row_lo, box.column_lo))

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows, self.columns

    @property
    def origin_m(self) -> tuple[float, float]:
        """World x, y of the lower-left corner of cell (0, 0)."""
        return self.corner[1] * self.cell_m, self.corner[0] * self.cell_m

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Row and column of a world point, which may lie outside the grid."""
        return (
            math.floor(y_m / self.cell_m) - self.corner[0],
            math.floor(x_m / self.cell_m) - self.corner[1],
        )

    def centre_of(self, row: int, column: int) -> tuple[float, float]:
        """World x, y (m) of a cell's centre."""
        x_m = (self.corner[1] + column + 0.5) * self.cell_m
        return x_m, (self.corner[0] + row + 0.5) * self.cell_m

    def crop(self, box: Box) -> GridSpec:
        """Grid of the sub-array `array[box.slices]`."""
        return GridSpec.over(self.to_world(box), self.cell_m)

    def to_world(self, box: Box) -> Box:
        """Box of world cells for a box of this grid's cells."""
        return box.moved(*self.corner)

    def to_local(self, box: Box) -> Box:
        """Box of this grid's cells for a box of world cells."""
        return box.moved(-self.corner[0], -self.corner[1])

    @property
    def whole(self) -> Box:
        return Box(0, self.rows, 0, self.columns)


@dataclass(frozen=True)
class Box:
    """Half-open box of cells: rows [row_lo, row_hi), columns [column_lo, column_hi)."""

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
    def bounds(self) -> tuple[int, int, int, int]:
        return self.row_lo, self.row_hi, self.column_lo, self.column_hi

    @property
    def slices(self) -> tuple[slice, slice]:
        return slice(self.row_lo, self.row_hi), slice(self.column_lo, self.column_hi)

    @property
    def tiled(self) -> Box:
        """Smallest box of whole tiles around this box."""
        return Box(
            self.row_lo // TILE * TILE,
            -(-self.row_hi // TILE) * TILE,
            self.column_lo // TILE * TILE,
            -(-self.column_hi // TILE) * TILE,
        )

    @property
    def tiles(self) -> Iterator[Tile]:
        """Tiles that intersect this box of world cells."""
        around = self.tiled
        for row in range(around.row_lo // TILE, around.row_hi // TILE):
            for column in range(around.column_lo // TILE, around.column_hi // TILE):
                yield row, column

    @staticmethod
    def of_tile(tile: Tile) -> Box:
        """World cells of a tile."""
        row, column = tile[0] * TILE, tile[1] * TILE
        return Box(row, row + TILE, column, column + TILE)

    def holds(self, other: Box) -> bool:
        return self.union(other) == self

    def moved(self, rows: int, columns: int) -> Box:
        return Box(
            self.row_lo + rows,
            self.row_hi + rows,
            self.column_lo + columns,
            self.column_hi + columns,
        )

    def union(self, other: Box | None) -> Box:
        """Smallest box that contains both; an empty box or None adds nothing."""
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

    def grown(self, cells: int, within: Box | None = None) -> Box:
        """Box with a margin on every side, cut to `within`."""
        out = Box(
            self.row_lo - cells,
            self.row_hi + cells,
            self.column_lo - cells,
            self.column_hi + cells,
        )
        return out if within is None else out.intersection(within)

    def intersection(self, within: Box) -> Box:
        """Intersection of two boxes; may be empty."""
        return Box(
            max(self.row_lo, within.row_lo),
            min(self.row_hi, within.row_hi),
            max(self.column_lo, within.column_lo),
            min(self.column_hi, within.column_hi),
        )


EMPTY = Box(0, 0, 0, 0)


@dataclass(frozen=True)
class TileMask:
    """Set of tiles: `mask` uint8 [tile rows, tile columns] is 1 for each; `first` is its corner."""

    mask: NDArray[np.uint8]
    first: Tile

    @staticmethod
    def of(tiles: Iterable[Tile]) -> TileMask:
        """Mask of the given tiles."""
        places = np.array(list(tiles), np.int64).reshape(-1, 2)
        if not len(places):
            return TileMask(np.zeros((0, 0), np.uint8), (0, 0))
        first, last = places.min(axis=0), places.max(axis=0)
        mask = np.zeros(last - first + 1, np.uint8)
        mask[tuple((places - first).T)] = 1
        return TileMask(mask, (int(first[0]), int(first[1])))


def copy_to_larger_grid(
    array: NDArray, old: GridSpec, new: GridSpec, known: Box, fill: int = 0
) -> NDArray:
    """Copy of an array over `old` for the larger grid `new`; copies only `known` (world cells).

    Zeros use no memory until they are written, because the system allocates zeroed pages lazily.
    """
    out = np.zeros(new.shape, array.dtype) if fill == 0 else np.full(new.shape, fill, array.dtype)
    kept = known.intersection(old.to_world(old.whole))
    if not kept.empty:
        out[new.to_local(kept).slices] = array[old.to_local(kept).slices]
    return out
