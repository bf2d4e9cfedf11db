"""Footprint and ground: how far the robot's disc is from trouble at every cell (appendix 6.1)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_planner.ground import kernels
from helios_planner.ground.grid import GroundMap, Pose2


def clearance_m(
    ground: GroundMap,
    robot: Pose2,
    footprint_m: float,
    unknown_gain_m: float,
    speck_m2: float,
    marks_m: NDArray[np.float64],
    trusted_m: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Distance [h, w] from each cell's middle to the edge of the nearest obstacle, metres.

    Unknown ground is an obstacle, but one that the rim may come `unknown_gain_m` nearer to. Not
    unknown are specks smaller than `speck_m2`, what lies in and next to the robot's own footprint,
    and the discs `trusted_m`. What was seen or felt to be an obstacle is one there, too.
    marks_m: [n, 3] x, y, radius of obstacles that were felt and not seen; trusted_m: [n, 3]
    likewise, of ground that is taken as free until seen otherwise.
    """
    occupied = (ground.occupancy > 0).astype(np.uint8)
    unknown = (ground.occupancy < 0).astype(np.uint8)
    fill_specks(unknown, max(1, int(speck_m2 / ground.cell_m**2)))
    column, row = (int(v) for v in ground.cells_of(np.array([[robot.x_m, robot.y_m]]))[0][::-1])
    own = int(np.ceil(footprint_m / ground.cell_m)) + 2
    cv2.circle(unknown, (column, row), own, 0, -1)
    for x_m, y_m, radius_m in trusted_m:
        r, c = ground.cells_of(np.array([[x_m, y_m]]))[0]
        cv2.circle(unknown, (int(c), int(r)), int(radius_m / ground.cell_m), 0, -1)
    for x_m, y_m, radius_m in marks_m:
        r, c = ground.cells_of(np.array([[x_m, y_m]]))[0]
        cv2.circle(occupied, (int(c), int(r)), max(1, round(radius_m / ground.cell_m)), 1, -1)
    to_obstacle = _distance_m(occupied, ground.cell_m)
    unknown[[0, -1]] = 1  # beyond the array nothing is known
    unknown[:, [0, -1]] = 1
    to_unknown = _distance_m(unknown, ground.cell_m) + np.float32(unknown_gain_m)
    to_unknown[unknown != 0] = 0
    return np.minimum(to_obstacle, to_unknown)


def least_clearance_m(
    clearance: NDArray[np.float32], ground: GroundMap, start: Pose2, end_m: tuple[float, float]
) -> float:
    """The least clearance at any intermediate position of a straight move to `end_m`.

    Positions are checked every half cell; outside the map is no clearance.
    """
    (r0, c0), (r1, c1) = ground.exact_cells_of(np.array([[start.x_m, start.y_m], end_m]))
    return float(kernels.least_along(clearance, r0, c0, r1, c1))


def _distance_m(blocked: NDArray[np.uint8], cell_m: float) -> NDArray[np.float32]:
    if not blocked.any():
        return np.full(blocked.shape, 1e3, np.float32)
    cells = cv2.distanceTransform((blocked == 0).astype(np.uint8), cv2.DIST_L2, 5)
    # From a cell's middle to the near edge of the blocked cell.
    return np.maximum((cells - 0.5) * cell_m, 0).astype(np.float32)


def fill_specks(unknown: NDArray[np.uint8], smallest: int) -> None:
    """Set connected parts of fewer than `smallest` cells to 0, in place."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(unknown, connectivity=8)
    small = stats[:, cv2.CC_STAT_AREA] < smallest
    small[0] = False
    if small[:count].any():
        unknown[np.take(small, np.asarray(labels, np.int32))] = 0
