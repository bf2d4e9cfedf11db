"""Cost of a path: length, clearance and unknown ground along it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from helios_core.codec.frames import FARTHEST_M
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import OCCUPIED, UNKNOWN
from numpy.typing import NDArray

from helios_map2d.grid import Box
from helios_map2d.snapshots.snapshot import MapSnapshot

MOST_SAMPLES = 100_000
WIDEST_M = 10.0  # limit of a robot's radius and of the comfortable clearance
SLOWEST = 0.05  # share of full speed without clearance


@dataclass(frozen=True)
class PathCost:
    """Cost of a path, with samples [n, 2] (m) and their clearance beyond the robot's radius (m).

    `cost_m` is the sum of the pieces' length divided by their relative speed, which rises from a
    twentieth without clearance to 1 at the comfortable clearance; infinite for a blocked path.
    """

    samples_m: NDArray[np.float64]
    clearance_m: NDArray[np.float64]
    length_m: float
    cost_m: float
    least_clearance_m: float
    unknown_m: float
    blocked: bool


def cost_along(
    snapshot: MapSnapshot, corners_m: NDArray[np.float64], radius_m: float, comfort_m: float
) -> PathCost:
    """Cost of the path of straight pieces between `corners_m` [n, 2] over the map.

    Clearance is the distance from a sample to the edge of the nearest obstacle cell less the
    radius, at most `comfort_m`. The path is blocked if it is below 0 anywhere. Unknown ground is no
    obstacle; its length is reported. Raises InvalidInput for fewer than two corners, numbers that
    are not finite, or a path that is too long.
    """
    _check(corners_m, radius_m, comfort_m)
    samples, steps = sampled(corners_m, snapshot.grid.cell_m)
    cell_m = snapshot.grid.cell_m
    reach = int(np.ceil((radius_m + comfort_m) / cell_m)) + 2
    cells = np.floor(samples / cell_m).astype(np.int64)[:, ::-1]  # world cells
    (row_lo, column_lo), (row_hi, column_hi) = cells.min(axis=0), cells.max(axis=0) + 1
    whole = snapshot.grid.to_world(snapshot.grid.whole)
    near = Box(int(row_lo), int(row_hi), int(column_lo), int(column_hi)).grown(reach, whole)
    to_edge = np.full(len(samples), np.inf)
    unknown = np.ones(len(samples), bool)
    if not near.empty:
        part = snapshot.occupancy[snapshot.grid.to_local(near).slices]
        if (part == OCCUPIED).any():
            distance = cv2.distanceTransform(
                (part != OCCUPIED).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
            )
        else:
            distance = np.full(part.shape, np.inf, np.float32)
        local = cells - (near.row_lo, near.column_lo)
        inside = ((local >= 0) & (local < part.shape)).all(axis=1)
        at = tuple(local[inside].T)
        to_edge[inside] = np.maximum(0, distance[at] - 0.5) * cell_m
        unknown[inside] = part[at] == UNKNOWN
    clearance = np.minimum(to_edge - radius_m, comfort_m)
    blocked = bool((clearance < 0).any())
    speed = np.maximum(SLOWEST, clearance / comfort_m)
    weights = np.zeros(len(samples))  # each sample represents half a step on each side
    weights[:-1] += steps / 2
    weights[1:] += steps / 2
    return PathCost(
        samples_m=samples,
        clearance_m=clearance,
        length_m=float(steps.sum()),
        cost_m=float("inf") if blocked else float((weights / speed).sum()),
        least_clearance_m=float(clearance.min()),
        unknown_m=float(weights[unknown].sum()),
        blocked=blocked,
    )


def sampled(
    corners_m: NDArray[np.float64], step_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points [n, 2] at most `step_m` apart through all corners, and the steps [n - 1] between
    them."""
    pieces = np.diff(corners_m, axis=0)
    counts = np.maximum(1, np.ceil(np.hypot(*pieces.T) / step_m)).astype(np.int64)
    if counts.sum() > MOST_SAMPLES:
        raise InvalidInput(
            f"a way of {np.hypot(*pieces.T).sum():.0f} m is too long to follow: send at most "
            f"{MOST_SAMPLES * step_m:.0f} m"
        )
    parts = [
        start + piece * np.arange(n)[:, None] / n
        for start, piece, n in zip(corners_m[:-1], pieces, counts, strict=True)
    ]
    samples = np.vstack([*parts, corners_m[-1:]])
    return samples, np.hypot(*np.diff(samples, axis=0).T)


def _check(corners_m: NDArray[np.float64], radius_m: float, comfort_m: float) -> None:
    if corners_m.ndim != 2 or corners_m.shape[1:] != (2,) or len(corners_m) < 2:
        raise InvalidInput(f"a way has at least two corners x, y; {corners_m.shape} came")
    at_home = (np.abs(corners_m) <= FARTHEST_M).all(axis=1)  # False for NaN
    if not at_home.all():
        k = int(at_home.argmin())
        raise InvalidInput(
            f"corner {k + 1} of the way is {corners_m[k].tolist()}: send finite metres within "
            f"{FARTHEST_M:g} m"
        )
    if not (0 <= radius_m <= WIDEST_M and 0 < comfort_m <= WIDEST_M):
        raise InvalidInput(
            f"cannot follow a way with radius {radius_m} m and comfort {comfort_m} m: send a "
            f"radius and a comfort of up to {WIDEST_M:g} m, the comfort above 0"
        )
