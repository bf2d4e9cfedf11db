"""Pose lattice planner for robots that are not discs; it checks every pose along a path.

The robot's box is enclosed in a capsule. A straight move sweeps one longer capsule, whose clearance
is the least along one line. The lattice has nodes 0.1 m apart, one of them at the robot, and the 32
headings of the steps between them. Each step ahead (0.10 to 0.36 m) and each turn to the next
heading (7 to 18 degrees) is one motion that the robot can carry out. The lattice is kept while the
robot follows it, so a path through a gap stays open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from helios_core.geometry import wrap_angle
from helios_core.robot import Forward, Turn
from numpy.typing import NDArray

from helios_planner.motion_planning import kernels
from helios_planner.motion_planning.costmap import GroundMap, Pose2, clearance_m, least_clearance_m
from helios_planner.motion_planning.kernels import DESCENT_STEPS
from helios_planner.motion_planning.path_planner import NONE, MotionRules, Reach

NODE_M = 0.1
KEPT_M = 0.025  # within this distance of a node the robot stands on it
TURN_COST_M = 0.3  # cost of a radian of turning, in metres at full speed
ALIGNED_RAD = math.radians(1.5)  # heading errors below this are not corrected

_order = np.argsort(np.arctan2(DESCENT_STEPS[:, 0], DESCENT_STEPS[:, 1]))
_STEPS = np.ascontiguousarray(DESCENT_STEPS[_order])  # rows, columns
_HEADINGS = np.arctan2(_STEPS[:, 0], _STEPS[:, 1]).astype(np.float64)


@dataclass(frozen=True)
class Capsule:
    """All points within `radius_m` of the segment from `half_m` behind the middle
    to `half_m` ahead."""

    half_m: float
    radius_m: float

    @staticmethod
    def around(length_m: float, width_m: float) -> Capsule:
        """Slim capsule that contains a box; its ends and its sides protrude a little."""
        inside_m = 0.1 * length_m
        return Capsule(length_m / 2 - inside_m, math.hypot(inside_m, width_m / 2))

    @property
    def reach_m(self) -> float:
        """Radius of the disc in which it turns."""
        return self.half_m + self.radius_m


@dataclass(frozen=True)
class PoseReach(Reach):
    """Poses that such a robot can reach. `arrival` is that of the heading reached first.

    times: float32 [32, rows, columns] of the lattice, in cells at full speed; came: int8, the
    motion that leads to each pose; first: exact row and column of node [0, 0]; node: the robot's.
    """

    capsule: Capsule
    margin_m: float
    times: NDArray[np.float32]
    came: NDArray[np.int8]
    first: tuple[float, float]
    node: tuple[int, int]

    @property
    def node_xy(self) -> tuple[float, float]:
        """World position of the robot's node, by which the next plan can keep this lattice."""
        x, y = self._xy_of(np.array([self.node]))[0]
        return float(x), float(y)

    @property
    def kept(self) -> bool:
        """True if the lattice is an earlier one and differs from a new one at the robot."""
        return self.robot.distance_m(self.node_xy) > 1e-6

    def fits(self, pose: Pose2) -> bool:
        """True if the robot can get there with that heading, or nearly so."""
        k = _nearest_heading(pose.yaw_rad)
        i, j = self._node_at(pose.xy)
        rows, columns = self.times.shape[1:]
        if not (0 <= i < rows and 0 <= j < columns and np.isfinite(self.times[k, i, j])):
            return False
        return self._slack_at(pose, 0.0) >= self.margin_m - 0.5 * self.ground.cell_m

    def best_near(self, goal: Pose2, within_m: float) -> tuple[int, int, int] | None:
        """End pose (heading, row, column of the lattice): near the goal, with nearly its heading
        where that is possible. None if no pose within `within_m` can be reached."""
        i, j = self._node_at(goal.xy)
        n = math.ceil(within_m / NODE_M) + 1
        i0, j0 = max(0, i - n), max(0, j - n)
        part = self.times[:, i0 : i + n + 1, j0 : j + n + 1]
        found = np.argwhere(np.isfinite(part)) + np.array([0, i0, j0])
        if not len(found):
            return None
        xy = self._xy_of(found[:, 1:])
        away_m = np.hypot(xy[:, 0] - goal.x_m, xy[:, 1] - goal.y_m)
        off = np.abs(np.angle(np.exp(1j * (_HEADINGS[found[:, 0]] - goal.yaw_rad))))
        cost = np.where(away_m <= within_m + NODE_M / 2, away_m + 0.1 * off, np.inf)
        best = int(np.argmin(cost))
        if not np.isfinite(cost[best]):
            return None
        k, i, j = (int(v) for v in found[best])
        return k, i, j

    def way_to(self, state: tuple[int, int, int]) -> list[tuple[int, int, int]]:
        """Poses of the lattice from the first heading at the robot's node to this one."""
        way, (k, i, j) = [state], state
        while (how := int(self.came[k, i, j])) != 2:
            if how == 0:
                i, j = i - int(_STEPS[k, 0]), j - int(_STEPS[k, 1])
            else:
                k = (k - how) % len(_STEPS)
            way.append((k, i, j))
        return way[::-1]

    def route_along(self, way: list[tuple[int, int, int]]) -> NDArray[np.float64]:
        """World points [n, 2] of a path."""
        return self._xy_of(np.array([(i, j) for _, i, j in way]))

    def route_to(self, point: tuple[float, float]) -> NDArray[np.float64]:
        state = self.best_near(Pose2(*point, self.robot.yaw_rad), NODE_M)
        return np.empty((0, 2)) if state is None else self.route_along(self.way_to(state))

    def next_move(
        self, way: list[tuple[int, int, int]], rules: MotionRules
    ) -> Forward | Turn | None:
        """Next motion along a path; None at its end, or if the motion is not free."""
        k, i, j = way[0]
        ahead = 0
        while ahead + 1 < len(way) and way[ahead + 1][0] == k:
            ahead += 1
        if ahead == 0 and len(way) > 1:  # a turn comes first
            k = way[1][0]
            for kk, ii, jj in way[1:]:
                if (ii, jj) != (i, j):
                    break
                k = kk
        error = wrap_angle(float(_HEADINGS[k]) - self.robot.yaw_rad)
        if abs(error) >= rules.min_turn_rad:
            turn = self.free_turn_rad(_first_turn(error, rules))
            if abs(turn) < rules.min_turn_rad:
                turn = self.free_turn_rad(-math.copysign(rules.max_turn_rad, error))
            return Turn(turn) if abs(turn) >= rules.min_turn_rad else None
        if ahead == 0:
            return None
        if abs(error) > ALIGNED_RAD:
            over = error + math.copysign(rules.min_turn_rad + 1e-3, error)
            if abs(self.free_turn_rad(over)) >= abs(over):
                return Turn(over)  # then back by the smallest turn
        step_m = NODE_M * math.hypot(*_STEPS[k])
        whole = min(ahead, int(rules.max_forward_m / step_m + 1e-9))  # to end on a node
        distance_m = min(max(whole, 1) * step_m, rules.max_forward_m)
        free_m = self.free_ahead_m(distance_m, rules)
        return Forward(free_m) if free_m >= rules.min_forward_m else None

    def free_turn_rad(self, wanted_rad: float) -> float:
        """Free part of a turn on the spot."""
        steps = max(1, math.ceil(abs(wanted_rad) / kernels.SWEEP_RAD))
        for n in range(1, steps + 1):
            here = self.robot
            pose = Pose2(here.x_m, here.y_m, here.yaw_rad + wanted_rad * n / steps)
            if self._slack_at(pose, 0.0) < self.least_slack_m:
                return wanted_rad * (n - 1) / steps
        return wanted_rad

    def free_ahead_m(self, wanted_m: float, rules: MotionRules) -> float:
        """Free part of a move straight ahead; 0 if less than the smallest move."""
        distance_m = wanted_m
        while distance_m >= rules.min_forward_m - 1e-9:
            if self._slack_at(self.robot, distance_m) >= self.least_slack_m:
                return distance_m
            distance_m -= self.ground.cell_m
        return 0.0

    def free_back_m(self, wanted_m: float, rules: MotionRules) -> float:
        """Free part of a move straight back; 0 if less than the smallest move. Only the rear end
        enters new ground: it keeps more clearance there than the cell size can hide."""
        rear = self.robot.ahead(-self.capsule.half_m)
        least_m = self.capsule.radius_m + 0.75 * self.ground.cell_m
        distance_m = wanted_m
        while distance_m >= rules.min_forward_m - 1e-9:
            end = rear.ahead(-distance_m).xy
            if least_clearance_m(self.clearance, self.ground, rear, end) >= least_m:
                return distance_m
            distance_m -= self.ground.cell_m
        return 0.0

    @property
    def least_slack_m(self) -> float:
        """Slack that a motion from here must keep: the margin, or the present slack if
        that is less."""
        tolerance = 0.5 * self.ground.cell_m
        return min(self.margin_m, self._slack_at(self.robot, 0.0)) - tolerance

    def _slack_at(self, pose: Pose2, ahead_m: float) -> float:
        (row, column), cell = self.ground.exact_cells_of(np.array([pose.xy]))[0], self.ground.cell_m
        return float(
            kernels.capsule_slack(
                self.clearance,
                row,
                column,
                pose.yaw_rad,
                self.capsule.half_m / cell,
                ahead_m / cell,
                self.capsule.radius_m,
            )
        )

    def _node_at(self, point: tuple[float, float]) -> tuple[int, int]:
        row, column = self.ground.exact_cells_of(np.array([point]))[0]
        spacing = NODE_M / self.ground.cell_m
        return round((row - self.first[0]) / spacing), round((column - self.first[1]) / spacing)

    def _xy_of(self, nodes: NDArray[np.integer]) -> NDArray[np.float64]:
        exact = np.asarray(nodes, np.float64) * (NODE_M / self.ground.cell_m) + np.array(self.first)
        return exact[:, ::-1] * self.ground.cell_m + np.asarray(self.ground.origin_m)


def pose_reach(
    ground: GroundMap,
    robot: Pose2,
    capsule: Capsule,
    rules: MotionRules,
    marks_m: NDArray[np.float64] = NONE,
    trusted_m: NDArray[np.float64] = NONE,
    lattice_xy: tuple[float, float] | None = None,
) -> PoseReach:
    """Everything that such a robot can reach now with the margin of the rules. It may leave a place
    that is too narrow, but never towards narrower ones. marks_m, trusted_m: as in `clearance_m`;
    lattice_xy: a node of the lattice to keep if the robot stands on it."""
    ground = ground.padded(robot.x_m, robot.y_m, capsule.reach_m + 0.3)
    clear = clearance_m(
        ground, robot, capsule.reach_m, rules.margin_m, rules.speck_m2, marks_m, trusted_m
    )
    cell, spacing = ground.cell_m, NODE_M / ground.cell_m
    row, column = _node_under(ground, robot, lattice_xy)
    i0, j0 = int(row / spacing), int(column / spacing)
    first = float(row - i0 * spacing), float(column - j0 * spacing)
    h, w = clear.shape
    rows, columns = int((h - 1 - first[0]) / spacing) + 1, int((w - 1 - first[1]) / spacing) + 1
    shape = (len(_STEPS), rows, columns)
    times, came = np.empty(shape, np.float32), np.zeros(shape, np.int8)
    reached = PoseReach(
        ground, robot, clear, np.full(clear.shape, capsule.radius_m + rules.margin_m, np.float32),
        np.full(clear.shape, np.inf, np.float32), capsule, rules.margin_m, times, came, first,
        (i0, j0),
    )  # fmt: skip
    turns = np.array([wrap_angle(float(h) - robot.yaw_rad) for h in _HEADINGS])
    seeds, seed_turns = [], []
    left, right = reached.free_turn_rad(math.pi), reached.free_turn_rad(-math.pi)
    for k, turn in enumerate(turns):
        for angle in (turn, turn - math.copysign(2 * math.pi, turn)):
            if right <= angle <= left:
                seeds.append(k)
                seed_turns.append(angle)
                break
    size = times.size
    span = int(10 * 4 * spacing + TURN_COST_M / cell) + 2
    queue = size
    while not kernels.march_poses(
        clear, np.array([*first, i0, j0], float), _STEPS, _HEADINGS, np.array(seeds, np.int64),
        np.array(seed_turns, float), capsule.half_m / cell, capsule.radius_m,
        rules.margin_m - 0.5 * cell, reached.least_slack_m, rules.leave_m / cell,
        rules.saturation_m, TURN_COST_M / cell, spacing, cell, times, came,
        np.empty(queue, np.int64), np.empty(queue, np.int64),
        np.empty(1 << span.bit_length(), np.int64),
    ):  # fmt: skip
        queue *= 2
    _spread(reached, times.min(axis=0), spacing)
    return reached


def _node_under(
    ground: GroundMap, robot: Pose2, lattice_xy: tuple[float, float] | None
) -> tuple[float, float]:
    """Exact row and column of the robot's node: of the given lattice, else of a new one."""
    here = ground.exact_cells_of(np.array([robot.xy]))[0]
    if lattice_xy is not None:
        spacing = NODE_M / ground.cell_m
        other = ground.exact_cells_of(np.array([lattice_xy]))[0]
        node = other + np.rint((here - other) / spacing) * spacing
        if math.dist(node, here) * ground.cell_m <= KEPT_M:
            here = node
    return float(here[0]), float(here[1])


def _spread(reached: PoseReach, soonest: NDArray[np.float32], spacing: float) -> None:
    """Set each cell's arrival to the time of its nearest node, where the robot's middle may be."""
    h, w = reached.arrival.shape
    i = np.rint((np.arange(h) + 0.5 - reached.first[0]) / spacing).astype(int)
    j = np.rint((np.arange(w) + 0.5 - reached.first[1]) / spacing).astype(int)
    i, j = np.clip(i, 0, soonest.shape[0] - 1), np.clip(j, 0, soonest.shape[1] - 1)
    reached.arrival[:] = soonest[np.ix_(i, j)]
    reached.arrival[reached.slack < 0] = np.inf


def _first_turn(error_rad: float, rules: MotionRules) -> float:
    """First turn towards a heading: as large as possible, but the rest is 0 or large
    enough to turn."""
    least = rules.min_turn_rad + 1e-6
    left = abs(error_rad) - rules.max_turn_rad
    most = abs(error_rad) if left <= 0 else min(rules.max_turn_rad, abs(error_rad) - least)
    return math.copysign(most, error_rad)


def _nearest_heading(yaw_rad: float) -> int:
    return int(np.argmin(np.abs(np.angle(np.exp(1j * (_HEADINGS - yaw_rad))))))
