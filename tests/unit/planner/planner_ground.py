"""Random ground maps, and places on them where a robot fits."""

from __future__ import annotations

import cv2
import numpy as np
from helios_planner.motion_planning.costmap import GroundMap

CELL_M = 0.05


def random_ground(seed: int, size: int = 120) -> GroundMap:
    """Make a walled square with boxes in it and no unknown cells."""
    rng = np.random.default_rng(seed)
    occupancy = np.zeros((size, size), np.int8)
    occupancy[:2], occupancy[-2:], occupancy[:, :2], occupancy[:, -2:] = 100, 100, 100, 100
    for _ in range(int(rng.integers(3, 14))):
        r, c = rng.integers(2, size - 12, 2)
        h, w = rng.integers(1, 30, 2)
        occupancy[r : r + h, c : c + w] = 100
    return GroundMap(occupancy, np.zeros((size, size), np.float32), CELL_M, (0.0, 0.0))


def free_places(ground: GroundMap, count: int, seed: int) -> list[tuple[float, float]]:
    """Return up to `count` places where the robot fits."""
    distance = cv2.distanceTransform((ground.occupancy == 0).astype(np.uint8), cv2.DIST_L2, 5)
    cells = np.argwhere(distance * CELL_M > 0.42)
    if not len(cells):
        return []
    rng = np.random.default_rng(seed)
    return [(float(x), float(y)) for x, y in ground.centres_of(rng.permutation(cells)[:count])]
