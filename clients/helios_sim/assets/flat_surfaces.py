"""Support surfaces of a model: flat rectangles without any part of the model above them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from helios_sim.assets.surface_sampling import face_normals, sample

_CELL_M = 0.02
_FLAT_COS = 0.93
_MIN_SIDE_M = 0.18
_INSET_M = 0.005


def flat_tops(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    *,
    uneven_m: float,
    heights_m: tuple[float, float],
    at_most: int = 2,
) -> NDArray[np.float64]:
    """Rectangles [n, 5] (centre x, y, half extents x, y, height; metres), the largest first.

    Seen from above, the model within a rectangle is horizontal (within 22°) and at most `uneven_m`
    below its height. Only heights in the closed interval `heights_m` are used.
    """
    found = sample(vertices, faces, _CELL_M / 2.5)
    normals, _ = face_normals(vertices, faces)
    level = np.abs(normals[found.face, 2]) > _FLAT_COS
    low = vertices.min(axis=0)[:2]
    dims = np.maximum(np.ceil((vertices.max(axis=0)[:2] - low) / _CELL_M).astype(int), 1)
    cell = np.clip(((found.points[:, :2] - low) / _CELL_M).astype(int), 0, dims - 1)
    top, floor = np.full(dims, -np.inf), np.full(dims, -np.inf)
    np.maximum.at(top, tuple(cell.T), found.points[:, 2])
    np.maximum.at(floor, tuple(cell[level].T), found.points[level, 2])
    with np.errstate(invalid="ignore"):  # -inf - -inf in empty cells
        flat = top - floor < 0.004
    rectangles = []
    while len(rectangles) < at_most:
        best = max(
            (
                _rectangle_at(top, flat, height, uneven_m)
                for height in _levels(top, flat, heights_m)
            ),
            key=lambda r: r[0],
            default=(0.0, (0, 0, 0, 0)),
        )
        x0, y0, x1, y1 = best[1]
        if min(x1 - x0, y1 - y0) * _CELL_M < _MIN_SIDE_M:
            break
        height = float(top[x0:x1, y0:y1].max())
        half = (np.array([x1 - x0, y1 - y0]) * _CELL_M) / 2 - _INSET_M
        middle = low + np.array([x0 + x1, y0 + y1]) * _CELL_M / 2
        rectangles.append([*middle, *half, height])
        flat[x0:x1, y0:y1] = False
    return np.array(rectangles).reshape(-1, 5)


def _levels(
    top: NDArray[np.float64], flat: NDArray[np.bool_], heights_m: tuple[float, float]
) -> NDArray[np.float64]:
    """Candidate heights: one per centimetre at which the model has a flat cell."""
    heights = top[flat]
    heights = heights[(heights >= heights_m[0]) & (heights <= heights_m[1])]
    return np.unique(np.round(heights, 2))


def _rectangle_at(
    top: NDArray[np.float64], flat: NDArray[np.bool_], height: float, uneven_m: float
) -> tuple[float, tuple[int, int, int, int]]:
    return largest_rectangle(flat & (np.abs(top - height) <= uneven_m / 2 + 0.005))


def largest_rectangle(mask: NDArray[np.bool_]) -> tuple[float, tuple[int, int, int, int]]:
    """Cell count and (row0, column0, row1, column1) of the largest all-true rectangle."""
    best, where = 0.0, (0, 0, 0, 0)
    run = np.zeros(mask.shape[1] + 1, int)  # consecutive true cells up to this row; last entry 0
    for row in range(mask.shape[0]):
        run[:-1] = np.where(mask[row], run[:-1] + 1, 0)
        open_at: list[tuple[int, int]] = []  # (first column, height), by rising height
        for column, height in enumerate(run.tolist()):
            first = column
            while open_at and open_at[-1][1] >= height:
                first, tall = open_at.pop()
                if tall * (column - first) > best:
                    best = float(tall * (column - first))
                    where = (row + 1 - tall, first, row + 1, column)
            open_at.append((first, height))
    return best, where
