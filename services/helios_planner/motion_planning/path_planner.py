"""Fast Marching Square (FM²): paths that keep clear of obstacles (Garrido et al. 2007; app. 6.1).

Speed rises with the distance to the nearest obstacle up to a maximum. The arrival time of a front
with that speed has one minimum, its source, so its descent gives the path. `next_primitive` turns
the path into the robot's next motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.robot import Forward, Turn
from numpy.typing import NDArray

from helios_planner.motion_planning import kernels
from helios_planner.motion_planning.costmap import (
    SPECK_M2,
    GroundMap,
    Pose2,
    clearance_m,
    corner_of,
    least_clearance_m,
)

BUCKET_WIDTH = 0.1  # in units of the time to cross a cell at full speed
SLOWEST = 0.05  # least speed of an open cell; bounds the width of the front
LEAST_SPEED = 0.1  # of a cell that is just wide enough, as a share of full speed
NONE = np.empty((0, 3))  # no discs
WIDE_ENOUGH_M = 0.10  # clearance to spare from which a straight line is always taken


def speed_field(
    clearance_m: NDArray[np.float32], required_m: float, contact_m: float, saturation_m: float
) -> NDArray[np.float32]:
    """Speed [h, w] in 0 to 1: 0 where clearance is below `required_m`, else proportional to the
    distance beyond `contact_m`, full from `saturation_m` beyond it, and never below LEAST_SPEED.
    The border is closed."""
    speed = np.clip((clearance_m - contact_m) / saturation_m, LEAST_SPEED, 1.0).astype(np.float32)
    speed[clearance_m < required_m] = 0
    speed[[0, -1]] = 0
    speed[:, [0, -1]] = 0
    return speed


def arrival_time(speed: NDArray[np.float32], sources: NDArray[np.integer]) -> NDArray[np.float32]:
    """Arrival time [h, w] of a front from the source cells [k, 2] (row, column), in cells at full
    speed; inf without a path. speed: float32 [h, w], 0 (closed) to 1; an open cell is never slower
    than SLOWEST. Raises InvalidInput for an open border, or a source on the border or beyond."""
    field = np.ascontiguousarray(speed, np.float32)
    rows, columns = field.shape
    if field[[0, -1]].any() or field[:, [0, -1]].any():
        raise InvalidInput("the speed field is open at its border; close it, a front ends there")
    if ((sources < 1) | (sources > (rows - 2, columns - 2))).any():
        raise InvalidInput(f"a source lies on the border of the {rows}x{columns} field or beyond")
    flat = np.ravel_multi_index((sources[:, 0], sources[:, 1]), field.shape).astype(np.int64)
    arrival = np.empty(field.shape, np.float32)
    span = int(1 / (SLOWEST * BUCKET_WIDTH)) + 2
    head = np.empty(1 << span.bit_length(), np.int32)
    nodes = field.size + len(flat)
    while not kernels.march(
        field,
        flat,
        arrival,
        np.empty(nodes, np.int32),
        np.empty(nodes, np.int32),
        head,
        np.float32(BUCKET_WIDTH),
        np.float32(SLOWEST),
    ):
        nodes *= 2
    return arrival


def descend(arrival: NDArray[np.float32], start: tuple[int, int]) -> NDArray[np.int32]:
    """Cells [n, 2] from `start` down to a source, at most 3 apart along an axis, with only reached
    cells between them; empty if `start` was not reached."""
    if not np.isfinite(arrival[start]):
        return np.empty((0, 2), np.int32)
    out = np.empty((arrival.size, 2), np.int32)
    n = kernels.descend(arrival, start[0], start[1], out)
    return out[:n].copy()


@dataclass(frozen=True)
class MotionRules:
    """Limits and margins of the robot's motion. Lengths in metres, angles in radians.

    `margin_m` is kept between the footprint's rim and obstacles. The front has full speed, without
    a pull away from obstacles, from `saturation_m` beyond the rim.
    """

    footprint_m: float
    margin_m: float = 0.05
    saturation_m: float = 0.30
    speck_m2: float = SPECK_M2
    # Distance from the start over which the required clearance rises to the full margin. At the
    # start it is the clearance that the robot has there.
    leave_m: float = 0.60
    min_forward_m: float = 0.1
    max_forward_m: float = 1.0
    min_turn_rad: float = math.radians(5)
    max_turn_rad: float = math.radians(30)


@dataclass(frozen=True)
class Reach:
    """Places that the robot can reach from its present pose.

    `arrival` float32 [h, w] in cells at full speed, inf without a path; `required_m` float32 [h,
    w]: least clearance of a cell.
    """

    ground: GroundMap
    robot: Pose2
    clearance: NDArray[np.float32]
    required_m: NDArray[np.float32]
    arrival: NDArray[np.float32]

    @cached_property
    def slack(self) -> NDArray[np.float32]:
        """Clearance [h, w] beyond the required one; the robot must not stand where it
        is below 0."""
        return self.clearance - self.required_m

    def at(self, points_m: NDArray[np.float64]) -> NDArray[np.float32]:
        """Arrival time at world points [n, 2]; inf off the map and without a path."""
        cells = self.ground.cells_of(points_m)
        inside = self.ground.inside(cells)
        out = np.full(len(cells), np.inf, np.float32)
        out[inside] = self.arrival[cells[inside, 0], cells[inside, 1]]
        return out

    def fits(self, pose: Pose2) -> bool:
        """True if the robot fits there with that heading; a disc does wherever it can get."""
        return True

    def free_back_m(self, wanted_m: float, rules: MotionRules) -> float:
        """Distance that it can move straight back without coming nearer to an obstacle than it is
        now; 0 if less than the smallest move."""
        here = least_clearance_m(self.clearance, self.ground, self.robot, self.robot.xy)
        least_m = min(here, rules.footprint_m)
        distance_m = wanted_m
        while distance_m >= rules.min_forward_m - 1e-9:
            end = self.robot.ahead(-distance_m).xy
            if least_clearance_m(self.clearance, self.ground, self.robot, end) >= least_m:
                return distance_m
            distance_m -= self.ground.cell_m
        return 0.0

    def nearest(self, point: tuple[float, float], within_m: float) -> tuple[float, float] | None:
        """Reachable place nearest to a point, if any lies within `within_m`."""
        ground = self.ground
        near = ground.window_at(point, within_m)
        cells = np.argwhere(np.isfinite(self.arrival[near])) + corner_of(near)
        if not len(cells):
            return None
        centres = ground.centres_of(cells)
        d = np.hypot(centres[:, 0] - point[0], centres[:, 1] - point[1])
        k = int(np.argmin(d))
        return (float(centres[k, 0]), float(centres[k, 1])) if d[k] <= within_m else None

    def route_to(self, point: tuple[float, float]) -> NDArray[np.float64]:
        """World points [n, 2] from the robot to a reachable place; empty without a path."""
        cells = self.ground.cells_of(np.array([point]))
        if not self.ground.inside(cells)[0]:
            return np.empty((0, 2))
        back = descend(self.arrival, (int(cells[0, 0]), int(cells[0, 1])))
        if not len(back):
            return np.empty((0, 2))
        route = self.ground.centres_of(back[::-1])
        route[0], route[-1] = self.robot.xy, point
        return route


def reach(
    ground: GroundMap,
    robot: Pose2,
    rules: MotionRules,
    marks_m: NDArray[np.float64] = NONE,
    trusted_m: NDArray[np.float64] = NONE,
) -> Reach:
    """Everything that can be reached now with the margin of the rules. The robot may leave a place
    that is too narrow, but never towards narrower ones. marks_m, trusted_m: as in `clearance_m`."""
    ground = ground.padded(robot.x_m, robot.y_m, rules.footprint_m + 0.3)
    clear = clearance_m(
        ground, robot, rules.footprint_m, rules.margin_m, rules.speck_m2, marks_m, trusted_m
    )
    wanted = rules.footprint_m + rules.margin_m
    row, column = (int(v) for v in ground.cells_of(np.array([robot.xy]))[0])
    required = np.full(clear.shape, wanted, np.float32)
    here = float(clear[row, column]) - 0.5 * ground.cell_m
    if here < wanted:
        near = ground.window((row, column), rules.leave_m)
        r, c = np.ogrid[near]
        far_m = np.hypot(r - row, c - column) * ground.cell_m
        # The required clearance rises to the full margin with the distance from the robot.
        required[near] = np.minimum(wanted, here + far_m * (wanted - here) / rules.leave_m)
    speed = speed_field(clear, 0.0, rules.footprint_m, rules.saturation_m)
    speed[clear < required] = 0
    speed[row, column] = max(float(speed[row, column]), LEAST_SPEED)
    arrival = arrival_time(speed, np.array([[row, column]]))
    return Reach(ground, robot, clear, required, arrival)


def straightened(route: NDArray[np.float64], reached: Reach) -> NDArray[np.float64]:
    """The route [n, 2] with every detour pulled straight that costs no clearance."""
    if len(route) < 3:
        return route
    exact = reached.ground.exact_cells_of(route)
    kept = np.empty(len(route), np.int64)
    n = kernels.pull_straight(reached.slack, exact, np.float32(WIDE_ENOUGH_M), kept)
    return route[kept[:n]]


def next_primitive(
    corners: NDArray[np.float64], reached: Reach, rules: MotionRules
) -> Forward | Turn | None:
    """Next motion along a straightened route that starts at the robot. None at its end, or if no
    move forward is free of collision (then look again or find another route)."""
    robot = reached.robot
    if len(corners) == 0 or robot.distance_m(corners[-1]) < rules.min_forward_m:
        return None
    target = next(
        (p for p in corners[1:] if robot.distance_m(p) >= rules.min_forward_m), corners[-1]
    )
    error_rad = robot.bearing_rad(target)
    if abs(error_rad) >= rules.min_turn_rad:
        return Turn(float(np.clip(error_rad, -rules.max_turn_rad, rules.max_turn_rad)))
    distance_m = min(robot.distance_m(target), rules.max_forward_m)
    free_m = free_ahead_m(reached, distance_m, rules)
    if free_m >= rules.min_forward_m:
        return Forward(free_m)
    if abs(error_rad) > 0.2 * rules.min_turn_rad:
        # Too small a turn for the robot: overshoot, then turn back by its smallest turn.
        return Turn(error_rad + math.copysign(rules.min_turn_rad, error_rad))
    return None


def free_ahead_m(reached: Reach, wanted_m: float, rules: MotionRules) -> float:
    """Part of `wanted_m` that the robot can move straight ahead, with every intermediate position
    of its footprint clear; 0 if less than the smallest move."""
    robot, slack = reached.robot, reached.slack
    distance = wanted_m
    while distance >= rules.min_forward_m:
        end = (
            robot.x_m + distance * math.cos(robot.yaw_rad),
            robot.y_m + distance * math.sin(robot.yaw_rad),
        )
        tolerance = 0.5 * reached.ground.cell_m
        if least_clearance_m(slack, reached.ground, robot, end) >= -tolerance:
            return distance
        distance -= reached.ground.cell_m
    return 0.0
