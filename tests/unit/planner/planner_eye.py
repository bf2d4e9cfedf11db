"""Camera view of a fake robot: visible floor up to tall obstacles, visible points, frontiers."""

from __future__ import annotations

import math

import cv2
import numpy as np
from helios_core.geometry import Pinhole
from helios_core.types import RobotDescription
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.robot.interface import Frontier
from numba import njit
from numpy.typing import NDArray

CELL_M = 0.025
TALL_M = 1.3  # an obstacle of at least this height hides what is behind it
CAMERA = Pinhole(fx=554.0, fy=554.0, cx=320.0, cy=240.0, width=640, height=480)
ROBOT = RobotDescription(
    name="fake",
    footprint_radius_m=0.3,
    height_m=1.4,
    camera=CAMERA,
    camera_height_m=1.31,
    reach_m=0.8,
    max_depth_m=5.0,
    tilt_range_rad=(-0.5, 1.2),
    simulated=True,
)


def floor_seen(
    top_m: NDArray[np.float32], pose: Pose2, tilt_rad: float, height_m: float
) -> NDArray[np.bool_]:
    """Return the cells that a camera at that height and tilt sees; both arrays: [rows, columns]."""
    half = CAMERA.hfov_rad / 2
    lowest = tilt_rad + CAMERA.vfov_rad / 2
    highest = tilt_rad - CAMERA.vfov_rad / 2
    near_m = height_m / math.tan(lowest) if lowest < math.pi / 2 else 0.0
    far_m = ROBOT.max_depth_m
    if highest > 0.01:
        far_m = min(far_m, height_m / math.tan(highest))
    angles = pose.yaw_rad + np.linspace(-half, half, 400)
    ranges = np.arange(0, far_m, CELL_M * 0.5)
    seen = np.zeros(top_m.shape, bool)
    _look_along(
        top_m >= TALL_M, pose.x_m, pose.y_m, np.cos(angles), np.sin(angles), ranges, near_m, seen
    )
    return seen


@njit(cache=True)
def _look_along(
    tall: NDArray[np.bool_],
    x_m: float,
    y_m: float,
    cos: NDArray[np.float64],
    sin: NDArray[np.float64],
    ranges: NDArray[np.float64],
    near_m: float,
    seen: NDArray[np.bool_],
) -> None:
    """Mark in `seen` the cells on each ray, up to just behind the first tall cell."""
    rows, columns = tall.shape
    for a in range(cos.size):
        end = ranges.size
        i = 0
        while i < end:
            c = min(max(int((x_m + cos[a] * ranges[i]) / CELL_M), 0), columns - 1)
            r = min(max(int((y_m + sin[a] * ranges[i]) / CELL_M), 0), rows - 1)
            if tall[r, c]:
                end = min(end, i + 4)  # the wall itself is visible
            if ranges[i] >= near_m:
                seen[r, c] = True
            i += 1


def under_robot(shape: tuple[int, int], pose: Pose2) -> NDArray[np.bool_]:
    """Return the cells under a robot and a little around it."""
    column, row, around = int(pose.x_m / CELL_M), int(pose.y_m / CELL_M), int(0.35 / CELL_M) + 2
    rows = np.arange(max(0, row - around), min(shape[0], row + around))
    columns = np.arange(max(0, column - around), min(shape[1], column + around))
    under = np.zeros(shape, bool)
    under[np.ix_(rows, columns)] = (
        np.hypot(columns[None] * CELL_M - pose.x_m, rows[:, None] * CELL_M - pose.y_m) < 0.35
    )
    return under


def sees(top_m: NDArray[np.float32], pose: Pose2, point: NDArray[np.float64]) -> bool:
    """Return whether a point is in the image, near enough, and not hidden by a tall obstacle."""
    d = pose.distance_m(point)
    if d > 4.0 or abs(pose.bearing_rad(point)) > CAMERA.hfov_rad / 2:
        return False
    n = max(2, int(d / (CELL_M * 0.5)))
    s = np.linspace(0, 0.97, n)
    x, y = pose.x_m + (point[0] - pose.x_m) * s, pose.y_m + (point[1] - pose.y_m) * s
    return not (top_m[(y / CELL_M).astype(int), (x / CELL_M).astype(int)] >= TALL_M).any()


def frontiers_of(known: NDArray[np.bool_], top_m: NDArray[np.float32]) -> list[Frontier]:
    """Return the edges of the known free ground that are long enough."""
    unknown = (~known).astype(np.uint8)
    edge = (cv2.dilate(unknown, np.ones((3, 3), np.uint8)) > 0) & known
    edge &= top_m == 0
    count, labels, stats, middles = cv2.connectedComponentsWithStats(edge.astype(np.uint8))
    out = []
    for k in range(1, count):
        if stats[k, cv2.CC_STAT_AREA] * CELL_M < 0.4:
            continue
        cells = np.argwhere(labels == k)
        r, c = cells[np.argmin(np.hypot(cells[:, 1] - middles[k][0], cells[:, 0] - middles[k][1]))]
        xy = ((c + 0.5) * CELL_M, (r + 0.5) * CELL_M)
        size = float(stats[k, cv2.CC_STAT_AREA] * CELL_M)
        out.append(Frontier(k, xy, size, {"pick": 0.2, "place": 0.2}))
    return out
