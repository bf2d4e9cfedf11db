"""Pick and place: approach, look again from near, act, and check the result."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from itertools import product
from typing import Any

import numpy as np
from helios_core.robot import Observe, Pick, Place
from helios_core.types import ObjectInstance

from helios_planner.match_radii import (
    ON_OUTLINE_M,
    RECEPTACLE_SHIFT_M,
    SAME_INSTANCE_M,
    SAME_PLACE_M,
    SAME_POINT_M,
    SAME_THING_M,
)
from helios_planner.motion_planning.base_placement import (
    ON_SHELF_M,
    ON_TOP_M,
    OTHER_SIDE_M,
    REACH_SPARE_M,
    AheadRules,
    PlaceRules,
    Spot,
    edge_spot,
    highest_ahead,
    near_outline,
    place_spots,
    stand_for,
    tilt_towards,
    top_at_m,
)
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.motion_planning.path_planner import Reach
from helios_planner.navigation.base_controller import BaseController, Outcome
from helios_planner.navigation.motion_monitor import Dropped
from helios_planner.robot.interface import RobotInterface
from helios_planner.search.candidate_beliefs import Belief
from helios_planner.search.unnamed_things import is_unnamed
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed

Judged = Callable[[ObjectInstance | None], bool]

PLACE_INSET_M = 0.12  # between the place and the edge of the surface
FLATNESS_M = (0.012, 0.045)  # height range of a flat area: clear of objects, then accepted
RELEASE_HEIGHT_M = 0.01  # above the surface
PAPER_RELEASE_HEIGHT_M = 0.10  # above the highest point ahead: the paper's place rule
SURFACE_RADIUS_M = 0.05  # radius around a placing point in which the highest surface counts
BELOW_M = 0.20  # an object lower than the placing surface by this is not on it
AROUND_M = 1.5  # a fallen object lies within this distance of the receptacle


def still_there(near: ObjectInstance | None) -> bool:
    """True if the belief still holds the instance, whatever its score."""
    return near is not None


class SkillOutcome(Enum):
    """Outcome of a pick or a place."""

    SUCCEEDED = auto()
    FAILED = auto()
    DOUBTED = auto()  # rejected after the view from near
    OUT_OF_REACH = auto()


@dataclass
class _Failed:
    """Failed attempts to place: points (x, y, z), and where the robot stood (x, y), in m."""

    points: list[tuple[float, float, float]] = field(default_factory=list)
    stands: list[tuple[float, float]] = field(default_factory=list)

    def lacks(self, point_m: tuple[float, float, float]) -> bool:
        """True if no failed point lies within SAME_POINT_M in the plane."""
        x, y, _ = point_m
        return all(math.hypot(x - p[0], y - p[1]) > SAME_POINT_M for p in self.points)


@dataclass
class Manipulation:
    """Pick and place of one object at a time. `picks` counts over the whole task."""

    robot: RobotInterface
    base: BaseController
    settings: Settings
    belief: Belief
    attempts: int  # picks per object
    picks: int = 0
    falls: int = 0
    last_reason: str = ""
    near: ObjectInstance | None = None  # newest target as estimated from near
    surface_m: float = 0.0  # height of the newest placing point
    placed_on: ObjectInstance | None = None  # receptacle as known at the newest placing
    # Receptacles on which every attempt to place failed: centre x, y in m, and the attempts.
    _failed: list[tuple[tuple[float, float], _Failed]] = field(default_factory=list)

    # --- restart -------------------------------------------------------------------------------
    def checkpoint(self) -> dict[str, Any]:
        """State that must outlive a crash of the planner, as JSON, for `restore`."""
        return {
            "picks": self.picks,
            "falls": self.falls,
            "last_reason": self.last_reason,
            "failed_places": [[center, f.points, f.stands] for center, f in self._failed],
        }

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        self.picks, self.falls = checkpoint["picks"], checkpoint["falls"]
        self.last_reason = checkpoint["last_reason"]
        self._failed = [
            ((x, y), _Failed([(px, py, pz) for px, py, pz in points], [(a, b) for a, b in stands]))
            for (x, y), points, stands in checkpoint.get("failed_places", ())
        ]

    @property
    def failed_places(self) -> int:
        """Number of receptacles on which every attempt to place failed."""
        return len(self._failed)

    # --- pick ----------------------------------------------------------------------------------
    def pick(
        self, thing: ObjectInstance, class_name: str, confirmed: Judged = still_there
    ) -> SkillOutcome:
        """Grasp an object: up to `attempts` times, each from another place. Returns DOUBTED if
        `confirmed` rejects it as seen from there."""
        tried: list[tuple[float, float]] = []
        attempts = 0
        while attempts < self.attempts:
            if not self._approach(np.asarray(thing.center_m), tried, f"reach the {class_name}"):
                return SkillOutcome.FAILED if attempts else SkillOutcome.OUT_OF_REACH
            tried.append(self.robot.pose().xy)
            near = (
                None
                if is_unnamed(thing)
                else self.belief.from_near(thing, class_name, SAME_THING_M)
            )
            self.near = near
            if not confirmed(near):
                return SkillOutcome.DOUBTED
            thing = near or thing
            if self._missing_m(thing.center_m) > 0:
                continue  # it is further away than estimated: try another place
            attempts += 1
            self._count_pick()
            x, y, z = (float(v) for v in thing.center_m)
            result = self.base.monitor.act(Pick((x, y, z), class_name))
            if result.succeeded and self.robot.held():
                self.belief.taken(thing)
                self.base.monitor.carrying = True
                return SkillOutcome.SUCCEEDED
            self.last_reason = result.reason or "the gripper closed and holds nothing"
        return SkillOutcome.FAILED

    def count_fall(self, fall: Dropped, class_name: str) -> None:
        """Count a fall of the carried object. It may be picked again, `falls` times at most. Raises
        TaskFailed beyond that."""
        self.falls += 1
        if self.falls > self.settings.falls:
            raise TaskFailed(
                Cause.PLACE_MISSED,
                f"the {class_name} fell {self.falls} times, the last time near "
                f"({fall.point_m[0]:.2f}, {fall.point_m[1]:.2f}) m: {fall.reason}",
            )

    def _count_pick(self) -> None:
        limit = self.settings.max_picks
        if limit and self.picks >= limit:
            raise TaskFailed(
                Cause.PICK_FAILED, f"{self.picks} picks were tried, the limit: {self.last_reason}"
            )
        self.picks += 1
        self.robot.listener.on_picks(self.picks)

    def _approach(
        self, target_m: np.ndarray, tried: list[tuple[float, float]], purpose: str
    ) -> bool:
        """Stand within reach of a point, facing it, with the head tilted to it; False if no pose
        allows it. Poses that see the point come first, then poses where only what lies above it
        hides it: in a height map the boards of a shelf seem to do so."""
        for above_m, level in product((ON_TOP_M, ON_SHELF_M), self.base.levels):
            stand = stand_for(
                target_m,
                self.base.reach(level),
                self.robot.description,
                self._reach_m,
                tried,
                above_m,
            )
            if stand is None:
                continue
            if self._stand_at(stand, target_m, purpose):
                return True
            tried.append(stand.xy)
        return False

    def _stand_at(self, stand: Pose2, target_m: np.ndarray, purpose: str) -> bool:
        if self.base.go_to(stand, purpose, slip_m=0.1) is not Outcome.ARRIVED:
            return False
        self._face(target_m)
        if (missing_m := self._missing_m(target_m)) > 0:
            step_m = max(missing_m + 0.02, self.robot.description.min_forward_m)
            self.base.ahead(step_m)
            self._face(target_m)
        return self._missing_m(target_m) <= 0

    def _face(self, target_m: np.ndarray) -> None:
        pose = self.robot.pose()
        self.base.turn_to(pose.yaw_rad + pose.bearing_rad(target_m))
        distance_m = self.robot.pose().distance_m(target_m)
        self.base.tilt(tilt_towards(distance_m, float(target_m[2]), self.robot.description))

    @property
    def _reach_m(self) -> float:
        return self.robot.description.reach_m - REACH_SPARE_M

    def _missing_m(self, target_m: np.ndarray) -> float:
        """Distance (m) that the robot stands too far away; at most 0 when the point is in reach."""
        spare = REACH_SPARE_M / 3
        return self.robot.pose().distance_m(target_m) - self.robot.description.reach_m + spare

    # --- place ---------------------------------------------------------------------------------
    def place(
        self, receptacle: ObjectInstance, class_name: str, confirmed: Judged = still_there
    ) -> SkillOutcome:
        """Put the held object down on a receptacle, by the place rule of the settings. Returns
        DOUBTED if `confirmed` rejects the receptacle as seen from near. After a failure, the next
        call tries other points and stands."""
        failed = self._failed_on(receptacle)
        stood = False
        for last in (False,) * (self.settings.places_per_receptacle - 1) + (True,):
            spot = self._spot(receptacle, failed)
            if spot is None:
                break
            target = np.array(spot.point_m)
            if not self._stand_at(spot.stand, target, f"place on the {class_name}"):
                failed.points.append(spot.point_m)
                continue
            stood = True
            near = self.near = self.belief.from_near(receptacle, class_name, RECEPTACLE_SHIFT_M)
            if not confirmed(near):
                return SkillOutcome.DOUBTED
            receptacle = self.placed_on = near or receptacle
            point = self._point_from_here(receptacle, spot, failed)
            if point is None and not last:
                self.last_reason = "from near there was no free place in reach"
            elif self._put(point or self._raised(spot)):
                return SkillOutcome.SUCCEEDED
            else:
                failed.stands.append(self.robot.pose().xy)
            failed.points.append(point or spot.point_m)
        if not stood:
            return SkillOutcome.OUT_OF_REACH
        x, y = (float(v) for v in receptacle.center_m[:2])
        self._failed.append(((x, y), failed))
        return SkillOutcome.FAILED

    def _failed_on(self, receptacle: ObjectInstance) -> _Failed:
        """Attempts on this receptacle in earlier calls that failed."""
        earlier = [
            f
            for middle, f in self._failed
            if math.dist(middle, receptacle.center_m[:2]) < SAME_PLACE_M
        ]
        return _Failed(
            [point for f in earlier for point in f.points],
            [stand for f in earlier for stand in f.stands],
        )

    def _put(self, point_m: tuple[float, float, float]) -> bool:
        """Face a point in reach and release above it. False if that failed and the robot still
        holds the object; raises Dropped if it fell."""
        self._face(np.array(point_m))
        by_paper = self.settings.place_rule == "paper"
        drop_m = PAPER_RELEASE_HEIGHT_M if by_paper else RELEASE_HEIGHT_M
        x, y, z = point_m
        self.surface_m = z
        result = self.base.monitor.act(Place((x, y, z + drop_m)))
        if not self.robot.held():
            self.base.monitor.carrying = False
        if result.succeeded:
            return True
        self.last_reason = result.reason
        if not self.robot.held():
            raise Dropped(self.robot.pose().xy, result.reason or "it fell while it was placed")
        return False

    def _free_spots(
        self, receptacle: ObjectInstance, reached: Reach, failed: _Failed
    ) -> list[Spot]:
        """New spots that are flat and empty. Without any: spots that are nearly flat, then spots
        nearer to an edge, then spots on top of what lies there."""
        choices = product((False, True), (PLACE_INSET_M, PLACE_INSET_M / 2), FLATNESS_M)
        for on_things, inset_m, flat_m in choices:
            rules = PlaceRules(inset_m, flat_m, on_things=on_things)
            spots = place_spots(receptacle, reached, self._reach_m, rules, failed.stands)
            if new := [spot for spot in spots if failed.lacks(spot.point_m)]:
                return new
        return []

    def _spot(self, receptacle: ObjectInstance, failed: _Failed) -> Spot | None:
        """Best spot on a seen surface; without one, a spot at the receptacle's edge, or None."""
        for level in self.base.levels if self.settings.place_rule == "flat" else ():
            spots = self._free_spots(receptacle, self.base.reach(level), failed)
            if spots:
                return spots[0]
        here = self.robot.pose()
        for level in self.base.levels:
            point = edge_spot(receptacle, here, PLACE_INSET_M + 0.05)
            if not failed.lacks(point):
                return None
            stand = stand_for(
                point,
                self.base.reach(level),
                self.robot.description,
                self._reach_m,
                failed.stands,
                tried_m=OTHER_SIDE_M,
            )
            if stand is not None:
                return Spot(point, stand, 0.0)
        return None

    def _point_from_here(
        self, receptacle: ObjectInstance, spot: Spot, failed: _Failed
    ) -> tuple[float, float, float] | None:
        """Best point within reach on the surface as now seen from near. None if every free spot is
        out of reach."""
        here = self.robot.pose()
        if self.settings.place_rule == "paper":
            rules = AheadRules(self._reach_m)
            return highest_ahead(receptacle, self.robot.ground(), here, rules) or spot.point_m
        reached = self.base.reach(self.base.levels[-1])
        seen = self._free_spots(receptacle, reached, failed)
        if not seen:
            return self._raised(spot)
        free = [one for one in seen if self._missing_m(np.array(one.point_m)) <= 0]
        as_good = (s.point_m for s in free if s.inset_m >= spot.inset_m - 0.02)
        return next(as_good, free[0].point_m if free else None)

    def _raised(self, spot: Spot) -> tuple[float, float, float]:
        """The spot's point, raised to the highest surface that is seen there now."""
        x, y, z = spot.point_m
        return x, y, max(z, top_at_m(self.robot.ground(), (x, y), SURFACE_RADIUS_M))


class PlacementCheck(Enum):
    ON_IT = auto()
    BESIDE_IT = auto()
    NOWHERE = auto()


def seen_after(
    receptacle: ObjectInstance,
    before: Sequence[ObjectInstance],
    now: Sequence[ObjectInstance],
    least_class_score: float,
    surface_m: float,
) -> tuple[PlacementCheck, ObjectInstance | None]:
    """Visibility of the placed object on or beside the receptacle, and its instance. before, now:
    all instances of its class. surface_m: height of the point at which it was released."""
    believed = [
        o
        for o in now
        if o.class_score >= least_class_score
        and all(math.dist(o.center_m, b.center_m) > SAME_INSTANCE_M for b in before)
        and math.dist(o.center_m[:2], receptacle.center_m[:2]) <= _around_m(receptacle)
    ]
    high = [o for o in believed if float(o.center_m[2]) >= surface_m - BELOW_M]
    on = [o for o in high if near_outline(receptacle, o.center_m, ON_OUTLINE_M)]
    if on:
        return PlacementCheck.ON_IT, max(on, key=lambda o: o.class_score)
    lower = [o for o in believed if float(o.center_m[2]) < surface_m - BELOW_M]
    if lower:
        return PlacementCheck.BESIDE_IT, max(lower, key=lambda o: o.class_score)
    return PlacementCheck.NOWHERE, None


def look_after(
    robot: RobotInterface,
    receptacle: ObjectInstance,
    before: Sequence[ObjectInstance],
    now: Callable[[], Sequence[ObjectInstance]],
    least_class_score: float,
    surface_m: float,
) -> tuple[PlacementCheck, ObjectInstance | None]:
    """Result of `seen_after`, after one more look if the object is seen nowhere."""
    seen, thing = seen_after(receptacle, before, now(), least_class_score, surface_m)
    if seen is PlacementCheck.NOWHERE:
        # The map takes the object in the placing's keyframe for still held. Without a step left to
        # look once more, the placing counts all the same.
        with contextlib.suppress(TaskFailed):
            robot.act(Observe())
        seen, thing = seen_after(receptacle, before, now(), least_class_score, surface_m)
    return seen, thing


def _around_m(receptacle: ObjectInstance) -> float:
    return AROUND_M + float(math.hypot(*receptacle.size_m[:2])) / 2
