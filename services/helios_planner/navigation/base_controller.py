"""Base controller: turns, looks around, follows a path one motion at a time, and recovers.

`BaseController` drives robots whose footprint is a disc, `PoseBaseController` all others. Every
motion uses the newest map. Recovery behaviors: a smaller margin, a look down around the robot, a
look at unknown ground that blocks the path, and moving back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Any, Literal

import numpy as np
from helios_core.geometry import wrap_angle
from helios_core.robot import Forward, Observe, Tilt, Turn
from helios_core.types import RobotDescription
from numpy.typing import NDArray

from helios_planner.match_radii import SAME_BARRIER_M
from helios_planner.motion_planning.costmap import BlindZone, GroundMap, Pose2, facing, unknown_near
from helios_planner.motion_planning.lattice_planner import Capsule, PoseReach, pose_reach
from helios_planner.motion_planning.path_planner import (
    MotionRules,
    Reach,
    free_ahead_m,
    next_primitive,
    reach,
    straightened,
)
from helios_planner.navigation.motion_monitor import NO_MOTION_M, MotionMonitor
from helios_planner.robot.interface import RobotInterface
from helios_planner.settings import Settings

LEAST_FORWARD_M = 0.01  # of a robot that names no smallest move
LEAST_TURN_RAD = math.radians(0.5)  # of a robot that names no smallest turn
MARK_RADIUS_M = 0.08
ARRIVED_M = 0.12
MOST_TURNS = 24  # in a row, towards one place
WEDGED_M = 0.3  # a robot confined to this radius is wedged


class Outcome(Enum):
    """Outcome of a drive."""

    ARRIVED = auto()
    INTERRUPTED = auto()
    UNREACHABLE = auto()


Step = Forward | Turn | Literal[Outcome.ARRIVED, Outcome.UNREACHABLE]


@dataclass(frozen=True)
class BlockedPath:
    """End of the reachable part of a path: the first place beyond (`at`), the last one before
    (`stand`), and the path's length before and after that; metres."""

    at: tuple[float, float]
    stand: tuple[float, float]
    before_m: float
    after_m: float


def never() -> bool:
    return False


class BaseController:
    """Moves a robot over known ground only, and records unseen obstacles that it met."""

    def __init__(self, robot: RobotInterface, settings: Settings) -> None:
        description = robot.description
        self.robot, self.settings = robot, settings
        self.rules = MotionRules(
            footprint_m=description.footprint_radius_m,
            margin_m=settings.margins_m[0],
            min_forward_m=max(description.min_forward_m, LEAST_FORWARD_M),
            max_forward_m=description.max_forward_m,
            min_turn_rad=max(description.min_turn_rad, LEAST_TURN_RAD),
            max_turn_rad=description.max_turn_rad,
        )
        self.monitor = MotionMonitor(robot)
        self.felt_obstacles: list[tuple[float, float, float]] = []  # x, y, radius: unseen, but met
        self.blind_zone = BlindZone(robot.description, self.rules.footprint_m, settings.blind_m)
        self._cached: dict[tuple, Reach] = {}
        self._turns = 0  # in a row, since the last move ahead
        self._cleared: list[tuple[float, float]] = []  # unknown ground that was looked at

    # --- turning and looking --------------------------------------------------------------------
    def turn_to(self, yaw_rad: float) -> None:
        """Turn on the spot until the heading is within the smallest turn."""
        for _ in range(16):
            error = wrap_angle(yaw_rad - self.robot.pose().yaw_rad)
            if abs(error) < self.rules.min_turn_rad:
                return
            most = self.rules.max_turn_rad
            if not self._turn(float(np.clip(error, -most, most))):
                return

    def _turn(self, angle_rad: float) -> bool:
        """Turn on the spot; False if the turn is not fully free."""
        self.monitor.act(Turn(angle_rad))
        return True

    def tilt(self, tilt_rad: float) -> bool:
        """Tilt the head; False if no action was needed."""
        low, high = self.robot.description.tilt_range_rad
        wanted = float(np.clip(tilt_rad, low, high))
        if abs(wanted - self.robot.tilt_rad()) < math.radians(2):
            return False
        self.monitor.act(Tilt(wanted))
        return True

    def look_around(self, enough: Callable[[], bool] = lambda: False) -> None:
        """Make a full turn, until `enough()`, and look at the ground next to the robot."""
        self._full_turn(enough=enough)

    def turn_around(self, stop: Callable[[], bool]) -> None:
        """Make a full turn with the head as while driving, until `stop()` is true."""
        turns = math.ceil(2 * math.pi / self.rules.max_turn_rad - 1e-6)
        for _ in range(turns):
            if stop() or not self._turn(2 * math.pi / turns):
                return

    def look_down_around(self) -> bool:
        """Look at the ground next to the robot, all around; False if it is already known."""
        if not near_ground_unknown(self.robot.ground(), self.robot.pose(), self.rules.footprint_m):
            return False
        self._full_turn(down_only=True)
        self.tilt(self.settings.travel_tilt_rad)
        return True

    def _full_turn(
        self, down_only: bool = False, enough: Callable[[], bool] = lambda: False
    ) -> None:
        description = self.robot.description
        turns = math.ceil(2 * math.pi / self.rules.max_turn_rad - 1e-6)
        step = 2 * math.pi / turns
        apart = max(
            1, int(0.85 * description.camera.hfov_rad / step)
        )  # turns between two looks down
        travel, down = self.settings.travel_tilt_rad, down_tilt_rad(description)
        both = not down_only and down > travel + math.radians(5)
        if not self.tilt(down if down_only else travel):
            self.monitor.act(Observe())
        for k in range(turns):
            if both and k % apart == 0:
                self.tilt(down)
                self.tilt(travel)
            if enough() or not self._turn(step):
                return

    # --- what can be reached -------------------------------------------------------------------
    def reach(self, level: int = 0) -> Reach:
        """Everything reachable now with the margin of that level (0 is the widest)."""
        ground, pose = self.robot.ground(), self.robot.pose()
        discs = tuple(self.felt_obstacles), tuple(self.blind_zone.discs)
        key = (ground.identity, pose, level, *discs)
        if key not in self._cached:
            if len(self._cached) > 8:
                self._cached.clear()
            self._cached[key] = self._reach_on(ground, level)
        return self._cached[key]

    def _reach_on(self, ground: GroundMap, level: int) -> Reach:
        rules = replace(self.rules, margin_m=self.settings.margins_m[level])
        return reach(self._covering(ground), self.robot.pose(), rules, *self._discs())

    def checkpoint(self) -> dict[str, Any]:
        """State that must outlive a crash of the planner, as JSON, for `restore`."""
        return {
            "felt": [list(f) for f in self.felt_obstacles],
            "trusted": [list(disc) for disc in self.blind_zone.discs],
        }

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        self.felt_obstacles[:] = [(x, y, r) for x, y, r in checkpoint["felt"]]
        self.blind_zone.discs[:] = [(x, y, r) for x, y, r in checkpoint["trusted"]]

    def _covering(self, ground: GroundMap) -> GroundMap:
        """The map, enlarged where it does not reach around the discs of ground that the robot takes
        as free without having seen it."""
        for x_m, y_m, radius_m in self.blind_zone.discs:
            ground = ground.padded(x_m, y_m, radius_m + 0.1)
        return ground

    def _discs(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Felt obstacles, and ground taken as free: [n, 3] each."""
        contacts, trusted = (
            np.array(d, float).reshape(-1, 3) for d in (self.felt_obstacles, self.blind_zone.discs)
        )
        return contacts, trusted

    @property
    def levels(self) -> range:
        return range(len(self.settings.margins_m))

    # --- driving -------------------------------------------------------------------------------
    def go_to(
        self,
        goal: Pose2,
        purpose: str,
        stop: Callable[[], bool] = never,
        slip_m: float = 0.3,
        face: bool = True,
    ) -> Outcome:
        """Drive to a pose, with a look after every move; `slip_m`: accepted distance from the goal
        if it turns out to be occupied."""
        self.tilt(self.settings.travel_tilt_rad)
        self._turns = 0
        outcome = self._drive(goal, purpose, stop, slip_m)
        self.robot.listener.on_plan(np.empty((0, 2)), None, "")
        if outcome is Outcome.ARRIVED and face:
            self.turn_to(goal.yaw_rad)
        return outcome

    def _drive(self, goal: Pose2, purpose: str, stop: Callable[[], bool], slip_m: float) -> Outcome:
        """Drive one motion at a time; without a free one, try a smaller margin,
        then look around."""
        level, looked = 0, False
        self._settle_jump()
        self._get_free()
        for _ in range(self._most_motions(goal)):
            pose = self.robot.pose()
            step = self._next_step(goal, purpose, slip_m, level)
            if step is Outcome.ARRIVED:
                return Outcome.ARRIVED
            if step is Outcome.UNREACHABLE:
                if level + 1 < len(self.settings.margins_m):
                    level += 1
                elif not looked and self.look_down_around():
                    looked, level = True, 0
                else:
                    return Outcome.UNREACHABLE
                continue
            result = self.monitor.act(step)
            if isinstance(step, Forward):
                if self.monitor.stood_still(step, result):
                    self._mark_ahead(pose, result.moved_m)
                    self._get_free()
                level = 0
            self._settle_jump()
            if stop():
                return Outcome.INTERRUPTED
        return Outcome.UNREACHABLE

    def _most_motions(self, goal: Pose2) -> int:
        return 80 + int(10 * self.robot.pose().distance_m(goal.xy))

    def _next_step(self, goal: Pose2, purpose: str, slip_m: float, level: int) -> Step:
        """Next motion towards a goal with the margin of a level; or ARRIVED, or UNREACHABLE
        with that margin."""
        pose = self.robot.pose()
        if pose.distance_m(goal.xy) < ARRIVED_M:
            return Outcome.ARRIVED
        reached = self.reach(level)
        place = reached.nearest(goal.xy, slip_m)
        if place is None:
            return Outcome.UNREACHABLE
        corners = straightened(reached.route_to(place), reached)
        self.robot.listener.on_plan(corners, goal, purpose)
        rules = replace(self.rules, margin_m=self.settings.margins_m[level])
        move = next_primitive(corners, reached, rules)
        if move is None or (isinstance(move, Turn) and self._turns > MOST_TURNS):
            self._turns = 0
            return Outcome.ARRIVED if pose.distance_m(place) < ARRIVED_M else Outcome.UNREACHABLE
        self._turns = self._turns + 1 if isinstance(move, Turn) else 0
        return move

    def ahead(self, distance_m: float) -> bool:
        """Move straight ahead if every intermediate position is clear; True if it moved."""
        rules = replace(self.rules, margin_m=self.settings.margins_m[-1])
        free_m = free_ahead_m(self.reach(self.levels[-1]), distance_m, rules)
        if free_m < self.rules.min_forward_m:
            return False
        return self.monitor.act(Forward(free_m)).moved_m > NO_MOTION_M

    def back(self) -> bool:
        """Move straight back as far as the robot can and the ground is clear; True if it moved."""
        most_m = self.robot.description.max_back_m
        free_m = self.reach(self.levels[-1]).free_back_m(most_m, self.rules)
        if free_m < self.rules.min_forward_m - 1e-9:
            return False
        return self.monitor.act(Forward(-free_m)).moved_m > NO_MOTION_M

    def _mark_ahead(self, pose: Pose2, moved_m: float) -> None:
        """Record an unseen obstacle where the rim met it."""
        self.monitor.blocked()
        ahead_m = moved_m + self.rules.footprint_m + MARK_RADIUS_M
        self.felt_obstacles.append(
            (
                pose.x_m + ahead_m * math.cos(pose.yaw_rad),
                pose.y_m + ahead_m * math.sin(pose.yaw_rad),
                MARK_RADIUS_M,
            )
        )

    def _wedged(self) -> bool:
        """True if the reachable ground is hardly more than what the robot stands on."""
        reached = self.reach(self.levels[-1])
        area_m2 = np.isfinite(reached.arrival).sum() * reached.ground.cell_m**2
        return bool(area_m2 < math.pi * WEDGED_M**2)

    def _get_free(self) -> None:
        """Free a wedged robot. First look down, and trust the ground in the blind zone. Then a few
        times: discard felt obstacles, which may be gone, look all around, and move back. Raises
        TaskFailed if that does not help."""
        if self._wedged():
            self.look_down_around()
        if self._wedged():
            self.blind_zone.trust(self.robot.pose())
        while self._wedged():
            self.monitor.wedged_in(self.blind_zone.too_wide())
            self.felt_obstacles.clear()
            self._full_turn(down_only=True)
            self.tilt(self.settings.travel_tilt_rad)
            if self._wedged():
                self.back()

    def _settle_jump(self) -> None:
        """Recover from a jump of the localisation: discard felt obstacles, whose positions are now
        wrong, and look around, so that the map holds the view from the new pose."""
        while self.monitor.jumped:
            self.monitor.jumped = False
            self.felt_obstacles.clear()
            self.blind_zone.discs.clear()
            self._cleared.clear()
            self.look_around()

    # --- unknown ground that blocks a path -----------------------------------------------------
    def clear_way(self, target: tuple[float, float], within_m: float) -> bool:
        """Look at the unknown ground that blocks the path to within `within_m` of a place. False if
        something else blocks it, or if it was looked at before."""
        barred = self.way_ends(self.robot.ground(), target, within_m)
        if barred is None or any(math.dist(barred.at, c) < SAME_BARRIER_M for c in self._cleared):
            return False
        self._cleared.append(barred.at)
        self.look_past(barred)
        return True

    def way_ends(
        self, ground: GroundMap, target: tuple[float, float], within_m: float
    ) -> BlockedPath | None:
        """End of the reachable part of the shortest path to within `within_m` of a place, if all
        unknown ground were free. None without such a path, or if all of it can be reached."""
        level = self.levels[-1]
        known = np.where(ground.occupancy < 0, np.int8(0), ground.occupancy)
        hopeful = self._reach_on(replace(ground, occupancy=known), level)
        place = hopeful.nearest(target, within_m)
        if place is None:
            return None
        route = hopeful.route_to(place)
        reachable = np.isfinite(self.reach(level).at(route))
        if reachable.all() or len(route) < 2:
            return None
        first = int(np.argmin(reachable))
        at = (float(route[first, 0]), float(route[first, 1]))
        stand = route[max(first - 1, 0)]
        steps_m = np.hypot(*np.diff(route, axis=0).T)
        before_m = float(steps_m[: max(first - 1, 0)].sum())
        return BlockedPath(
            at, (float(stand[0]), float(stand[1])), before_m, float(steps_m.sum()) - before_m
        )

    def look_past(self, barred: BlockedPath, stop: Callable[[], bool] = never) -> None:
        """Go to the end of the known path, and look at the unknown ground beyond, until
        `stop()` is true."""
        unknown = unknown_near(self.robot.ground(), barred.at, self.rules.footprint_m + 0.2)
        goal = facing(*barred.stand, unknown)
        outcome = self.go_to(goal, "look at unknown ground in the way", stop)
        if outcome is not Outcome.ARRIVED:
            return
        pose = self.robot.pose()
        self.turn_to(pose.yaw_rad + pose.bearing_rad(unknown))
        away_m = self.robot.pose().distance_m(unknown)
        description = self.robot.description
        ahead_m = max(away_m - description.camera_forward_m, 0.1)
        self.tilt(math.atan2(description.camera_height_m, ahead_m))


class PoseBaseController(BaseController):
    """Controller of a robot whose footprint is a box: plans over poses on a lattice."""

    def __init__(self, robot: RobotInterface, settings: Settings, capsule: Capsule) -> None:
        super().__init__(robot, settings)
        self.capsule = capsule
        self.rules = replace(self.rules, footprint_m=capsule.reach_m)
        self.blind_zone = BlindZone(robot.description, capsule.reach_m, settings.blind_m)
        self._lattice_xy: tuple[float, float] | None = None

    def reach(self, level: int = 0) -> PoseReach:
        reached = super().reach(level)
        assert isinstance(reached, PoseReach)
        return reached

    def _reach_on(self, ground: GroundMap, level: int) -> Reach:
        rules = replace(self.rules, margin_m=self.settings.margins_m[level])
        reached = pose_reach(
            self._covering(ground),
            self.robot.pose(),
            self.capsule,
            rules,
            *self._discs(),
            lattice_xy=self._lattice_xy,
        )
        self._lattice_xy = reached.node_xy
        return reached

    def _new_lattice(self) -> None:
        """Start a new lattice at the robot: it may hold a path that the present one misses."""
        self._lattice_xy = None
        self._cached.clear()

    def _most_motions(self, goal: Pose2) -> int:
        return 80 + int(20 * self.robot.pose().distance_m(goal.xy))

    def _next_step(self, goal: Pose2, purpose: str, slip_m: float, level: int) -> Step:
        pose = self.robot.pose()
        reached = self.reach(level)
        end = reached.best_near(goal, slip_m)
        if end is not None:
            way = reached.way_to(end)
            self.robot.listener.on_plan(reached.route_along(way), goal, purpose)
            if len(way) == 1 and pose.distance_m(goal.xy) < max(slip_m, ARRIVED_M):
                return Outcome.ARRIVED
            move = reached.next_move(way, self.rules)
            if move is not None:
                return move
            if pose.distance_m(goal.xy) < ARRIVED_M:
                return Outcome.ARRIVED
        if reached.kept:
            self._new_lattice()
            return self._next_step(goal, purpose, slip_m, level)
        return Outcome.UNREACHABLE

    def ahead(self, distance_m: float) -> bool:
        free_m = self.reach(self.levels[-1]).free_ahead_m(distance_m, self.rules)
        if free_m < self.rules.min_forward_m:
            return False
        return self.monitor.act(Forward(free_m)).moved_m > NO_MOTION_M

    def _turn(self, angle_rad: float) -> bool:
        free_rad = self.reach(self.levels[-1]).free_turn_rad(angle_rad)
        if abs(free_rad) < self.rules.min_turn_rad:
            return False
        self.monitor.act(Turn(free_rad))
        return abs(free_rad) >= abs(angle_rad) - 1e-6


def base_controller_for(robot: RobotInterface, settings: Settings) -> BaseController:
    """Base controller for the robot's footprint."""
    box = robot.description.footprint_box_m
    return (
        BaseController(robot, settings)
        if box is None
        else PoseBaseController(robot, settings, Capsule.around(*box))
    )


def down_tilt_rad(description: RobotDescription) -> float:
    """Tilt at which the lower edge of the image shows the ground at the rim."""
    # A little within the rim: the image's lower edge is straight, the rim is round.
    rim_m = 0.8 * description.footprint_radius_m - description.camera_forward_m
    rim = math.atan2(description.camera_height_m, rim_m)
    return float(np.clip(rim - description.camera.vfov_rad / 2, *description.tilt_range_rad))


def near_ground_unknown(ground: GroundMap, pose: Pose2, footprint_m: float) -> bool:
    """True if more than 2 % of the ground up to 0.7 m beyond a robot's rim was never seen."""
    reach_m = footprint_m + 0.7
    ground = ground.padded(pose.x_m, pose.y_m, reach_m + 0.1)
    row, column = ground.cells_of(np.array([pose.xy]))[0]
    n = int(reach_m / ground.cell_m)
    part = ground.occupancy[row - n : row + n + 1, column - n : column + n + 1]
    return bool((part < 0).mean() > 0.02)
