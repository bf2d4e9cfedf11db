"""Borders of the known floor: where free ground meets ground that was never seen.

These are frontiers of the occupancy grid itself. The frontiers of the 2D map belong to a search:
each search begins with new ones, also in a known home.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from helios_planner.motion_planning.costmap import GroundMap, fill_specks


@dataclass(frozen=True)
class Border:
    """One border: its middle cell (world x, y) and its length, in metres."""

    xy_m: tuple[float, float]
    size_m: float


def borders_of(ground: GroundMap, least_m: float, speck_m2: float) -> list[Border]:
    """Borders of at least `least_m`, the longest first. Unknown specks smaller than `speck_m2`
    count as floor."""
    unknown = (ground.occupancy < 0).astype(np.uint8)
    fill_specks(unknown, max(1, int(speck_m2 / ground.cell_m**2)))
    beside = cv2.dilate(unknown, np.ones((3, 3), np.uint8))
    edge = ((ground.occupancy == 0) & (beside != 0) & (unknown == 0)).astype(np.uint8)
    count, labels, stats, middles = cv2.connectedComponentsWithStats(edge, connectivity=8)
    out = []
    for k in range(1, count):
        size_m = float(stats[k, cv2.CC_STAT_AREA]) * ground.cell_m
        if size_m < least_m:
            continue
        left, top = stats[k, cv2.CC_STAT_LEFT], stats[k, cv2.CC_STAT_TOP]
        width, height = stats[k, cv2.CC_STAT_WIDTH], stats[k, cv2.CC_STAT_HEIGHT]
        part = np.asarray(labels)[top : top + height, left : left + width] == k
        cells = np.argwhere(part) + np.array([top, left])
        middle = np.array([middles[k][1], middles[k][0]])
        nearest = cells[np.argmin(((cells - middle) ** 2).sum(axis=1))]
        ((x_m, y_m),) = ground.centres_of(nearest[None])
        out.append(Border((float(x_m), float(y_m)), size_m))
    return sorted(out, key=lambda b: (-b.size_m, b.xy_m))


def floor_m2(ground: GroundMap) -> float:
    """Area of the ground that is known to be free."""
    return float(np.count_nonzero(ground.occupancy == 0)) * ground.cell_m**2
