"""Refinement of a transform on distances to stored surfaces, and how well it fits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_map2d.relocalisation.correlation import (
    CONTRADICTED_FREE_PER_M,
    CONTRADICTED_SURFACE,
)
from helios_map2d.relocalisation.grid_fields import PresentPoints, StoredFields
from helios_map2d.relocalisation.poses import Points, Transform2

_REACHES_M = (0.3,) * 4 + (0.2,) * 4 + (0.1,) * 6 + (0.06,) * 6  # of the nearest surface, by round
_MOST_POINTS = 1500
SIGMA_M = 0.04  # standard deviation of a surface that agrees
AGREES_M = 0.075  # a surface this near to a stored one agrees
FAR_M = 0.15  # a surface this far from any stored one, on free floor, contradicts
INSIDE_M = 0.075  # floor this deep inside a stored obstacle contradicts


@dataclass(frozen=True)
class Fit:
    """How the present map fits the stored one under a transform.

    Only points on known cells of the stored map count.
    """

    T_stored_present: Transform2
    score_m: float  # surface that agrees, less what contradicts
    overlap_m: float  # surface on known cells
    overlap: float  # share of the surface that is on known cells
    agreement: float  # share of that surface within AGREES_M of a stored surface
    contradiction: float  # share of free floor on known cells that is inside an obstacle
    free_overlap_m2: float  # free floor on known cells


def refined(stored: StoredFields, present: PresentPoints, start: Transform2) -> Transform2:
    """Transform after alignment of present surfaces with the nearest stored ones."""
    points = present.surface_m
    points = points[:: max(1, len(points) // _MOST_POINTS)]
    T = start
    rows_columns = stored.nearest.reshape(2, -1)
    for reach_m in _REACHES_M:
        moved = T.of(points)
        cell, on = stored.cells_of(moved)
        away = stored.surface_m.ravel()[cell]
        near = on & (away < reach_m)
        if near.sum() < 10:
            return T
        row, column = rows_columns[:, cell[near]]
        target = np.stack([column + 0.5, row + 0.5], 1) * stored.grid.cell_m
        target += stored.grid.origin_m
        weight = 1 / (1 + (away[near] / (0.5 * reach_m)) ** 2)
        T = _rigid(points[near], target, weight)
    return T


def fit_of(stored: StoredFields, present: PresentPoints, T: Transform2) -> Fit:
    """Fit of a transform."""
    away, known, free = _at(stored, T.of(present.surface_m))
    inside, floor_known = _inside(stored, T.of(present.free_m))
    agrees = np.exp(-0.5 * (away / SIGMA_M) ** 2) * known
    against = free & (away > FAR_M)
    blocked = floor_known & (inside > INSIDE_M)
    weight_m, floor_m2 = present.surface_weight_m, present.free_weight_m2
    score = (agrees.sum() - CONTRADICTED_SURFACE * against.sum()) * weight_m
    score -= CONTRADICTED_FREE_PER_M * blocked.sum() * floor_m2
    n, m = max(int(known.sum()), 1), max(int(floor_known.sum()), 1)
    return Fit(
        T,
        float(score),
        float(known.sum() * weight_m),
        float(known.mean()) if len(known) else 0.0,
        float((known & (away < AGREES_M)).sum() / n),
        float(blocked.sum() / m),
        float(floor_known.sum() * floor_m2),
    )


def _at(
    stored: StoredFields, points_m: Points
) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_]]:
    """Distance to the nearest stored surface [n], and whether the cell is known, and free."""
    cell, on = stored.cells_of(points_m)
    known, free = stored.known.ravel()[cell] & on, stored.free.ravel()[cell] & on
    return stored.surface_m.ravel()[cell], known, free


def _inside(
    stored: StoredFields, points_m: Points
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    cell, on = stored.cells_of(points_m)
    return stored.inside_m.ravel()[cell], stored.known.ravel()[cell] & on


def _rigid(points: Points, target: Points, weight: NDArray[np.float64]) -> Transform2:
    """Transform with the least weighted sum of squared distances (Kabsch)."""
    w = weight / weight.sum()
    a, b = w @ points, w @ target
    da, db = points - a, target - b
    dot = float((w * (da * db).sum(axis=1)).sum())
    cross = float((w * (da[:, 0] * db[:, 1] - da[:, 1] * db[:, 0])).sum())
    turn = Transform2(0.0, 0.0, math.atan2(cross, dot))
    x, y = b - turn.of(a[None])[0]
    return Transform2(float(x), float(y), turn.yaw_rad)
