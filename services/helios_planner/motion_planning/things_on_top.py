"""What lies on a receptacle, by the height map alone (not in the paper).

A detector may never report an object, or always under another name. It still stands out from the
surface that it lies on.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from helios_core.types import ObjectInstance
from numpy.typing import NDArray

from helios_planner.motion_planning.base_placement import (
    outline_mask,
    outline_of,
    surface_height_m,
)
from helios_planner.motion_planning.costmap import GroundMap

RAISED_M = (0.015, 0.45)  # height above the surface
STEP_M = 0.03  # a larger step between two cells separates two things
LEAST_CELLS = 2
MOST_M = 0.45  # longest side; what is longer is a part of the receptacle
MARGIN_M = 0.03  # of the receptacle's edge, where the map shows what stands behind
FLAT_M = 0.03  # height range of a flat cell and its neighbours
_NOTHING = -10.0  # height where nothing is raised


@dataclass(frozen=True)
class RaisedSpot:
    """Something that stands out from a surface. center_m, size_m: its box [3], world."""

    center_m: NDArray[np.float64]
    size_m: NDArray[np.float64]

    def holds(self, other: RaisedSpot) -> bool:
        """True if the middle of another spot lies within this one's box from above."""
        away_m = np.abs(other.center_m - self.center_m)[:2]
        return bool((away_m <= self.size_m[:2] / 2).all())


def raised_spots(receptacle: ObjectInstance, ground: GroundMap) -> list[RaisedSpot]:
    """Things on the surface of a receptacle, largest first. Empty if no surface was seen."""
    outline = outline_of(receptacle)
    extent_m = float(np.ptp(outline, axis=0).max())
    part = ground.part(ground.window_at(outline.mean(axis=0), extent_m + 4 * ground.cell_m))
    if part.occupancy.size == 0:
        return []
    n = max(1, round(MARGIN_M / part.cell_m))
    mask = cv2.erode(outline_mask(part, outline), np.ones((2 * n + 1, 2 * n + 1), np.uint8))
    seen = (mask != 0) & (part.top_m > 0.05)
    around = np.ones((3, 3), np.uint8)
    flat = seen & (cv2.dilate(part.top_m, around) - cv2.erode(part.top_m, around) <= FLAT_M)
    if not flat.any():
        return []
    surface_m = surface_height_m(part.top_m[flat])
    above_m = np.where(seen, part.top_m - surface_m, _NOTHING).astype(np.float32)
    above_m[(above_m < RAISED_M[0]) | (above_m > RAISED_M[1])] = _NOTHING
    spots = [_spot(part, cells, above_m, surface_m) for cells in _connected(above_m)]
    out: list[RaisedSpot] = []
    for spot in sorted(spots, key=lambda s: -float(s.size_m[:2].prod())):
        if float(spot.size_m[:2].max()) <= MOST_M and not any(o.holds(spot) for o in out):
            out.append(spot)
    return out


def _connected(above_m: NDArray[np.float32]) -> list[NDArray[np.intp]]:
    """Groups of neighbouring raised cells [n, 2] without a step between them."""
    left = above_m > _NOTHING
    out = []
    while left.any():
        row, column = (int(v) for v in np.argwhere(left)[0])
        filled = np.zeros((above_m.shape[0] + 2, above_m.shape[1] + 2), np.uint8)
        flags = 8 | cv2.FLOODFILL_MASK_ONLY | (1 << 8)
        cv2.floodFill(above_m, filled, (column, row), 0.0, STEP_M, STEP_M, flags)
        group = (filled[1:-1, 1:-1] != 0) & left
        left &= ~group
        cells = np.argwhere(group)
        if len(cells) >= LEAST_CELLS:
            out.append(cells)
    return out


def _spot(
    part: GroundMap, cells: NDArray[np.intp], above_m: NDArray[np.float32], surface_m: float
) -> RaisedSpot:
    high_m = float(above_m[cells[:, 0], cells[:, 1]].max())
    xy_m = part.centres_of(cells)
    middle = (xy_m.min(axis=0) + xy_m.max(axis=0)) / 2
    sides_m = np.ptp(xy_m, axis=0) + part.cell_m
    return RaisedSpot(np.array([*middle, surface_m + high_m / 2]), np.array([*sides_m, high_m]))
