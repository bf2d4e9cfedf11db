"""Driving over known ground, with the recoveries that moving needs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum, auto

import numpy as np
from helios_core.robot import Forward, Turn
from numpy.typing import NDArray

from helios_planner.ground.blind_ring import BlindRing
from helios_planner.ground.grid import GroundMap, Pose2, facing, unknown_near
from helios_planner.ground.motion import (
    Reach,
    free_ahead_m,
    next_primitive,
    reach,
    straightened,
)
from helios_planner.moving.mishaps import NO_MOTION_M
from helios_planner.moving.on_the_spot import OnTheSpot
from helios_planner.robot.body import Body
from helios_planner.settings import Settings

MARK_RADIUS_M = 0.08
ARRIVED_M = 0.12
WEDGED_M = 0.3  # who cannot get so far away is wedged


class Outcome(Enum):
    """How a drive ended."""

    ARRIVED = auto()
    INTERRUPTED = auto()
    UNREACHABLE = auto()


@dataclass(frozen=True)
class Barred:
    """Where a way leaves the ground that can be reached: its first place beyond (`at`), its last
    one before (`stand`), and how far it leads before and after that; metres."""

    at: tuple[float, float]
    stand: tuple[float, float]
    before_m: float
    after_m: float


def never() -> bool:
    return False


class Legs(OnTheSpot):
    """Moves a Body over known ground only. Remembers what it felt and could not see."""

    def __init__(self, body: Body, settings: Settings) -> None:
        super().__init__(body, settings)
        self.felt: list[tuple[float, float, float]] = []  # x, y, radius: unseen, but met
        self.blind_ring = BlindRing(body.description, self.rules.footprint_m, settings.blind_m)
        self._cached: dict[tuple, Reach] = {}
        self._cleared: list[tuple[float, float]] = []  # unknown ground that was gone to look at

    # --- what can be reached -------------------------------------------------------------------
    def reach(self, level: int = 0) -> Reach:
        """Everything reachable now with the margin of that level (0 is the widest)."""
        ground, robot = self.body.ground(), self.body.pose()
        key = (ground.version, robot, level, len(self.felt), len(self.blind_ring.discs))
        if key not in self._cached:
            if len(self._cached) > 8:
                self._cached.clear()
            self._cached[key] = self._reach_on(ground, level)
        return self._cached[key]

    def _reach_on(self, ground: GroundMap, level: int) -> Reach:
        rules = replace(self.rules, margin_m=self.settings.margins_m[level])
        return reach(self._covering(ground), self.body.pose(), rules, *self._discs())

    def _covering(self, ground: GroundMap) -> GroundMap:
        """A map that also covers the rings taken as free."""
        for x_m, y_m, radius_m in self.blind_ring.discs:
            ground = ground.padded(x_m, y_m, radius_m + 0.1)
        return ground

    def _discs(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What was felt, and what is taken as free: [n, 3] each."""
        felt, trusted = (
            np.array(d, float).reshape(-1, 3) for d in (self.felt, self.blind_ring.discs)
        )
        return felt, trusted

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
        """Drive to a pose, looking after every move; `slip_m`: as near as this is near enough when
        the very place turns out to be taken."""
        self.tilt(self.settings.travel_tilt_rad)
        outcome = self._drive(goal, purpose, stop, slip_m)
        self.body.tell_plan(np.empty((0, 2)), None, "")
        if outcome is Outcome.ARRIVED and face:
            self.turn_to(goal.yaw_rad)
        return outcome

    def _drive(self, goal: Pose2, purpose: str, stop: Callable[[], bool], slip_m: float) -> Outcome:
        level, looked, turns = 0, False, 0
        self._settle_jump()
        self._get_free()
        budget = 80 + int(10 * self.body.pose().distance_m(goal.xy))
        for _ in range(budget):
            pose = self.body.pose()
            if pose.distance_m(goal.xy) < ARRIVED_M:
                return Outcome.ARRIVED
            reached = self.reach(level)
            place = reached.nearest(goal.xy, slip_m)
            if place is None:
                if level + 1 < len(self.settings.margins_m):
                    level += 1
                    continue
                if not looked and self.look_down_around():
                    looked, level = True, 0
                    continue
                return Outcome.UNREACHABLE
            corners = straightened(reached.route_to(place), reached)
            self.body.tell_plan(corners, goal, purpose)
            rules = replace(self.rules, margin_m=self.settings.margins_m[level])
            move = next_primitive(corners, reached, rules)
            if move is None or (isinstance(move, Turn) and turns > 24):
                if pose.distance_m(place) < ARRIVED_M:
                    return Outcome.ARRIVED
                if level + 1 < len(self.settings.margins_m):
                    level, turns = level + 1, 0
                    continue
                if not looked and self.look_down_around():
                    looked, level, turns = True, 0, 0
                    continue
                return Outcome.UNREACHABLE
            turns = turns + 1 if isinstance(move, Turn) else 0
            result = self.mishaps.act(move)
            if isinstance(move, Forward):
                if self.mishaps.stood_still(move, result):
                    self._mark_ahead(pose, result.moved_m)
                    self._get_free()
                level = 0
            self._settle_jump()
            if stop():
                return Outcome.INTERRUPTED
        return Outcome.UNREACHABLE

    def ahead(self, distance_m: float) -> bool:
        """Move straight ahead if every intermediate position is clear; whether it moved."""
        rules = replace(self.rules, margin_m=self.settings.margins_m[-1])
        free_m = free_ahead_m(self.reach(self.levels[-1]), distance_m, rules)
        if free_m < self.rules.min_forward_m:
            return False
        return self.mishaps.act(Forward(free_m)).moved_m > NO_MOTION_M

    def back(self) -> bool:
        """Move straight back, where the robot came from and can do so; whether it moved."""
        most_m = self.body.description.max_back_m
        free_m = self.reach(self.levels[-1]).free_back_m(most_m, self.rules)
        if free_m < self.rules.min_forward_m - 1e-9:
            return False
        return self.mishaps.act(Forward(-free_m)).moved_m > NO_MOTION_M

    def _mark_ahead(self, pose: Pose2, moved_m: float) -> None:
        """Something unseen is in the way: remember it where the rim met it."""
        self.mishaps.blocked()
        ahead_m = moved_m + self.rules.footprint_m + MARK_RADIUS_M
        self.felt.append(
            (
                pose.x_m + ahead_m * math.cos(pose.yaw_rad),
                pose.y_m + ahead_m * math.sin(pose.yaw_rad),
                MARK_RADIUS_M,
            )
        )

    def _wedged(self) -> bool:
        """Whether the ground that can be reached is hardly more than what it stands on."""
        reached = self.reach(self.levels[-1])
        area_m2 = np.isfinite(reached.arrival).sum() * reached.ground.cell_m**2
        return bool(area_m2 < math.pi * WEDGED_M**2)

    def _get_free(self) -> None:
        """While wedged: the camera may be blind for the ground at the feet; or what was felt is
        gone or never was there, so forget it and look all around, then move back, a few times.
        Raises TaskFailed when that does not help."""
        if self._wedged():
            self.look_down_around()
        if self._wedged():
            self.blind_ring.trust(self.body.pose())
        while self._wedged():
            self.mishaps.wedged_in(self.blind_ring.too_wide())
            self.felt.clear()
            self._full_turn(down_only=True)
            self.tilt(self.settings.travel_tilt_rad)
            if self._wedged():
                self.back()

    def _settle_jump(self) -> None:
        """After a jump of the localisation: what was felt lies elsewhere now; look around, so that
        the map holds what is seen from the new pose."""
        while self.mishaps.jumped:
            self.mishaps.jumped = False
            self.felt.clear()
            self.blind_ring.discs.clear()
            self._cleared.clear()
            self.look_around()

    # --- unknown ground in the way -------------------------------------------------------------
    def clear_way(self, target: tuple[float, float], within_m: float) -> bool:
        """Look at the unknown ground that bars the way to within `within_m` of a place, if it is
        only unknown ground that does. Whether there was any that was not looked at before."""
        barred = self.way_ends(self.body.ground(), target, within_m)
        if barred is None or any(math.dist(barred.at, c) < 0.3 for c in self._cleared):
            return False
        self._cleared.append(barred.at)
        self.look_past(barred)
        return True

    def way_ends(
        self, ground: GroundMap, target: tuple[float, float], within_m: float
    ) -> Barred | None:
        """Where the shortest way to within `within_m` of a place leaves the ground that can be
        reached, were all unknown ground of a map free. None where none leads there even so, or
        where all of it can be reached."""
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
        return Barred(
            at, (float(stand[0]), float(stand[1])), before_m, float(steps_m.sum()) - before_m
        )

    def look_past(self, barred: Barred, stop: Callable[[], bool] = never) -> None:
        """Go to where the known way ends, and look at the unknown ground beyond, until `stop`."""
        unknown = unknown_near(self.body.ground(), barred.at, self.rules.footprint_m + 0.2)
        goal = facing(*barred.stand, unknown)
        outcome = self.go_to(goal, "look at unknown ground in the way", stop)
        if outcome is not Outcome.ARRIVED:
            return
        pose = self.body.pose()
        self.turn_to(pose.yaw_rad + pose.bearing_rad(unknown))
        away_m = self.body.pose().distance_m(unknown)
        robot = self.body.description
        ahead_m = max(away_m - robot.camera_forward_m, 0.1)
        self.tilt(math.atan2(robot.camera_height_m, ahead_m))
