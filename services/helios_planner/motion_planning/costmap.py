"""Costmap of one occupancy grid: clearance, and the robot's near blind zone.

Clearance is the distance to the nearest obstacle, in metres. The blind zone is the floor at the
robot's feet that its camera cannot see.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from helios_core.geometry import Matrix, se2_to_se3, wrap_angle, yaw_of
from helios_core.types import RobotDescription
from numpy.typing import NDArray

from helios_planner.motion_planning import kernels

SPECK_M2 = 0.015  # unknown patches below this area are gaps between depth pixels: floor
SEEN_M = 0.1  # distance beyond the image's edge at which the camera surely sees the floor
Disc = tuple[float, float, float]  # x, y, radius


@dataclass(frozen=True)
class Pose2:
    """Pose of the base: world x, y in metres, heading in radians."""

    x_m: float
    y_m: float
    yaw_rad: float

    @staticmethod
    def of(T_world_base: Matrix) -> Pose2:
        return Pose2(float(T_world_base[0, 3]), float(T_world_base[1, 3]), yaw_of(T_world_base))

    @property
    def T_world_base(self) -> Matrix:
        return se2_to_se3(self.x_m, self.y_m, self.yaw_rad)

    @property
    def xy(self) -> tuple[float, float]:
        return self.x_m, self.y_m

    def ahead(self, distance_m: float) -> Pose2:
        """Pose at this distance straight ahead; behind if it is negative."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return Pose2(self.x_m + distance_m * c, self.y_m + distance_m * s, self.yaw_rad)

    def distance_m(self, point: tuple[float, float] | NDArray[np.float64]) -> float:
        """Distance (m) from the base's middle, in the ground plane."""
        return math.hypot(point[0] - self.x_m, point[1] - self.y_m)

    def bearing_rad(self, point: tuple[float, float] | NDArray[np.float64]) -> float:
        """Turn (rad) that would face the point; positive left, in (-pi, pi]."""
        heading = math.atan2(point[1] - self.y_m, point[0] - self.x_m)
        return wrap_angle(heading - self.yaw_rad)


def facing(x_m: float, y_m: float, target: tuple[float, float] | NDArray[np.float64]) -> Pose2:
    """Pose at (x, y) that faces `target`."""
    return Pose2(x_m, y_m, math.atan2(target[1] - y_m, target[0] - x_m))


@dataclass(frozen=True)
class GroundMap:
    """One version of the 2D map; arrays [h, w], row along world y, column along world x.

    occupancy: int8 (-1 unknown, 0 free, 100 occupied); top_m: float32, height of the highest
    obstacle of a cell, 0 without one; origin_m: world x, y of the corner of cell [0, 0]. Versions
    begin anew with a new map id.
    """

    occupancy: NDArray[np.int8]
    top_m: NDArray[np.float32]
    cell_m: float
    origin_m: tuple[float, float]
    version: int = 0
    map_id: str = ""

    @property
    def identity(self) -> tuple[str, int]:
        """Equal for equal maps."""
        return self.map_id, self.version

    def exact_cells_of(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows and columns [n, 2], not rounded, of world points [n, 2] (x, y)."""
        return ((np.asarray(points_m, float) - self.origin_m) / self.cell_m)[:, ::-1]

    def cells_of(self, points_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Rows and columns [n, 2] of world points [n, 2]; may lie outside."""
        return np.floor(self.exact_cells_of(points_m)).astype(np.int64)

    def centres_of(self, cells: NDArray[np.integer]) -> NDArray[np.float64]:
        """World x, y [n, 2] of the middles of cells [n, 2]."""
        return (np.asarray(cells, float)[:, ::-1] + 0.5) * self.cell_m + np.asarray(self.origin_m)

    def inside(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Mask [n] of the cells [n, 2] that lie on the map."""
        rows, columns = self.occupancy.shape
        row, column = cells[:, 0], cells[:, 1]
        return (row >= 0) & (row < rows) & (column >= 0) & (column < columns)

    def distance_m(self, point_m: tuple[float, float]) -> float:
        """Distance from a world point (x, y) to the map's rectangle; 0 within it."""
        rows, columns = self.occupancy.shape
        beyond = [
            max(low - value, value - low - n * self.cell_m, 0.0)
            for value, low, n in zip(point_m, self.origin_m, (columns, rows), strict=True)
        ]
        return math.hypot(*beyond)

    def window(self, cell: tuple[int, int], radius_m: float) -> tuple[slice, slice]:
        """Rows and columns of the square within `radius_m` of a cell, cut to the map; empty if it
        lies off the map."""
        n = math.ceil(radius_m / self.cell_m)
        rows, columns = self.occupancy.shape
        return _cut(int(cell[0]), n, rows), _cut(int(cell[1]), n, columns)

    def window_at(
        self, point_m: Sequence[float] | NDArray[np.float64], radius_m: float
    ) -> tuple[slice, slice]:
        """`window` around the cell of a world point (x, y)."""
        row, column = self.cells_of(np.array([[point_m[0], point_m[1]]]))[0]
        return self.window((int(row), int(column)), radius_m)

    def part(self, near: tuple[slice, slice]) -> GroundMap:
        """Map of a window, which may be empty; a view of these arrays."""
        row, column = near[0].start, near[1].start
        origin = (self.origin_m[0] + column * self.cell_m, self.origin_m[1] + row * self.cell_m)
        return replace(
            self, occupancy=self.occupancy[near], top_m=self.top_m[near], origin_m=origin
        )

    def padded(self, x_m: float, y_m: float, margin_m: float) -> GroundMap:
        """Map that also covers `margin_m` around the point; new cells are unknown."""
        row, column = self.cells_of(np.array([[x_m, y_m]]))[0]
        n = math.ceil(margin_m / self.cell_m)
        rows, columns = self.occupancy.shape
        before = max(0, n - int(row)), max(0, n - int(column))
        after = max(0, int(row) + n + 1 - rows), max(0, int(column) + n + 1 - columns)
        if before == after == (0, 0):
            return self
        pad = ((before[0], after[0]), (before[1], after[1]))
        origin = (
            self.origin_m[0] - before[1] * self.cell_m,
            self.origin_m[1] - before[0] * self.cell_m,
        )
        return replace(
            self,
            occupancy=np.pad(self.occupancy, pad, constant_values=-1),
            top_m=np.pad(self.top_m, pad),
            origin_m=origin,
        )


def corner_of(near: tuple[slice, slice]) -> NDArray[np.int64]:
    """Row and column [2] of the first cell of a window."""
    return np.array([near[0].start, near[1].start])


def unknown_near(
    ground: GroundMap, point: tuple[float, float], radius_m: float
) -> tuple[float, float]:
    """Centre of the nearest unknown cell around a point; the point itself if there is none."""
    near = ground.window_at(point, radius_m)
    cells = np.argwhere(ground.occupancy[near] < 0)
    if not len(cells):
        return point
    centres = ground.centres_of(cells + corner_of(near))
    x_m, y_m = centres[np.argmin(np.hypot(*(centres - np.array(point)).T))]
    return float(x_m), float(y_m)


def _cut(middle: int, n: int, length: int) -> slice:
    """Indices middle - n to middle + n that lie in 0 to length - 1."""
    low = min(max(middle - n, 0), length)
    return slice(low, max(low, min(middle + n + 1, length)))


def clearance_m(
    ground: GroundMap,
    robot: Pose2,
    footprint_m: float,
    unknown_gain_m: float,
    speck_m2: float,
    marks_m: NDArray[np.float64],
    trusted_m: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Distance [h, w] (m) from each cell's middle to the edge of the nearest obstacle.

    Unknown ground is an obstacle, but the footprint's rim may come `unknown_gain_m` nearer to it.
    These do not count as unknown: specks smaller than `speck_m2`, ground in and next to the robot's
    own footprint, and the discs `trusted_m`. Obstacles that were seen or felt there count.
    marks_m: [n, 3] x, y, radius of obstacles that were felt and not seen; trusted_m: [n, 3] x, y,
    radius of ground that counts as free until seen otherwise.
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
    unknown[[0, -1]] = 1  # ground beyond the array is unknown
    unknown[:, [0, -1]] = 1
    to_unknown = _distance_m(unknown, ground.cell_m) + np.float32(unknown_gain_m)
    to_unknown[unknown != 0] = 0
    return np.minimum(to_obstacle, to_unknown)


def least_clearance_m(
    clearance: NDArray[np.float32], ground: GroundMap, start: Pose2, end_m: tuple[float, float]
) -> float:
    """Least clearance at any position of a straight move to `end_m`.

    Positions are checked every half cell; outside the map there is no clearance.
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
        kernels.clear_labels(np.asarray(labels, np.int32), small, unknown)


def blind_m(robot: RobotDescription) -> float:
    """Radius (m) around the base's middle in which the robot sees no floor, however it turns
    and tilts where it stands: the lower edge of the image meets the floor there. Infinite if
    it never does."""
    lowest_rad = robot.tilt_range_rad[1] + robot.camera.vfov_rad / 2
    if lowest_rad <= 0:
        return math.inf
    if lowest_rad >= math.pi / 2:
        return 0.0
    return max(0.0, robot.camera_forward_m + robot.camera_height_m / math.tan(lowest_rad))


class BlindZone:
    """Near blind zone of one robot in one task. `discs`: where its ring was taken as free."""

    def __init__(self, robot: RobotDescription, rim_m: float, most_m: float) -> None:
        """rim_m: radius in which the robot turns. most_m: longest path over ground that
        was never seen."""
        self._blind_m, self._rim_m, self._most_m = blind_m(robot), rim_m, most_m
        self.discs: list[Disc] = []

    @property
    def width_m(self) -> float:
        """Width (m) of the ring, from the rim outwards; 0 if the robot sees the floor
        at its feet."""
        return max(0.0, self._blind_m - self._rim_m)

    def trust(self, pose: Pose2) -> bool:
        """Take the ring around a pose as free; False if it already is, or must not be."""
        within = any(math.dist(pose.xy, disc[:2]) <= disc[2] for disc in self.discs)
        if within or not 0 < self.width_m <= self._most_m:
            return False
        self.discs.append((pose.x_m, pose.y_m, self._blind_m + SEEN_M))
        return True

    def too_wide(self) -> str:
        """Advice about a ring that is too wide to be trusted; empty for any other."""
        if self.width_m <= self._most_m:
            return ""
        seen = "never" if math.isinf(self._blind_m) else f"only from {self._blind_m:.1f} m on"
        return (
            f"its camera sees the floor {seen}; tilt it further down, or set "
            f"HELIOS_PLANNER_BLIND_M above {self._most_m:g}"
        )
