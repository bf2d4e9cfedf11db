"""Pick and place: approach, look once more, act, and check the result."""

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
    GROWN_M,
    ON_OUTLINE_M,
    SAME_INSTANCE_M,
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
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed

Judged = Callable[[ObjectInstance | None], bool]

PLACE_INSET_M = 0.12  # between the place and the edge of the surface
FLATNESS_M = (0.012, 0.045)  # height range of a flat area: clear of objects, then accepted
RELEASE_HEIGHT_M = 0.01  # above the surface
PAPER_RELEASE_HEIGHT_M = 0.10  # above the highest point ahead: the paper's place rule
OVER_M = 0.05  # around a point that has to do, what lies there counts
BELOW_M = 0.20  # lower by this than where it was let go is not on it
AROUND_M = 1.5  # what fell lies this near


def still_there(near: ObjectInstance | None) -> bool:
    """Whatever is believed to be there at all holds up."""
    return near is not None


class Done(Enum):
    """How a skill ended."""

    SUCCEEDED = auto()
    FAILED = auto()
    DOUBTED = auto()  # from near it does not look like what it was taken for
    OUT_OF_REACH = auto()


@dataclass
class _Failed:
    """Where placing was tried in vain: points (x, y, z), and where the robot stood (x, y), in m."""

    points: list[tuple[float, float, float]] = field(default_factory=list)
    stands: list[tuple[float, float]] = field(default_factory=list)

    def lacks(self, point_m: tuple[float, float, float]) -> bool:
        """Whether a point is not one of these, or next to one."""
        x, y, _ = point_m
        return all(math.hypot(x - p[0], y - p[1]) > SAME_POINT_M for p in self.points)


@dataclass
class Manipulation:
    """Acts on one thing at a time. `picks` counts over the whole task."""

    body: RobotInterface
    base: BaseController
    settings: Settings
    belief: Belief
    attempts: int  # picks at one thing
    picks: int = 0
    falls: int = 0
    last_reason: str = ""
    near: ObjectInstance | None = None  # what was acted on last, as it was believed from near
    surface_m: float = 0.0  # height of where something was let go last
    placed_on: ObjectInstance | None = None  # as it was known when something was let go on it

    # --- over a restart ------------------------------------------------------------------------
    def memory(self) -> dict[str, Any]:
        """What must not be forgotten when the planner dies, as JSON, for `recall`."""
        return {"picks": self.picks, "falls": self.falls, "last_reason": self.last_reason}

    def recall(self, memory: Mapping[str, Any]) -> None:
        self.picks, self.falls = memory["picks"], memory["falls"]
        self.last_reason = memory["last_reason"]

    # --- pick ----------------------------------------------------------------------------------
    def pick(self, thing: ObjectInstance, class_name: str, confirmed: Judged = still_there) -> Done:
        """Grasp a thing: up to `attempts` times, each from another place. What does not
        hold up as it is believed from there is doubted."""
        tried: list[tuple[float, float]] = []
        attempts = 0
        while attempts < self.attempts:
            if not self._approach(np.asarray(thing.center_m), tried, f"reach the {class_name}"):
                return Done.FAILED if attempts else Done.OUT_OF_REACH
            tried.append(self.body.pose().xy)
            near = self.near = self.belief.from_near(thing, class_name, SAME_THING_M)
            if not confirmed(near):
                return Done.DOUBTED
            thing = near or thing
            if self._missing_m(thing.center_m) > 0:
                continue  # it is further than it was believed to be: another place
            attempts += 1
            self._count_pick()
            x, y, z = (float(v) for v in thing.center_m)
            result = self.base.monitor.act(Pick((x, y, z), class_name))
            if result.succeeded and self.body.held():
                self.belief.taken(thing)
                self.base.monitor.carrying = True
                return Done.SUCCEEDED
            self.last_reason = result.reason or "the gripper closed and holds nothing"
        return Done.FAILED

    def count_fall(self, fall: Dropped, class_name: str) -> None:
        """What was carried lies somewhere: it may be picked again, `falls` times at most."""
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
        self.body.listener.on_picks(self.picks)

    def _approach(
        self, target_m: np.ndarray, tried: list[tuple[float, float]], purpose: str
    ) -> bool:
        """Stand within reach of a point, facing it, the head towards it: with it in sight, else
        where only what is over it would hide it, as the boards of a shelf seem to do in a map of
        heights."""
        for above_m, level in product((ON_TOP_M, ON_SHELF_M), self.base.levels):
            stand = stand_for(
                target_m, self.base.reach(level), self.body.description, self._reach_m, tried,
                above_m,
            )  # fmt: skip
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
            step_m = max(missing_m + 0.02, self.body.description.min_forward_m)
            self.base.ahead(step_m)
            self._face(target_m)
        return self._missing_m(target_m) <= 0

    def _face(self, target_m: np.ndarray) -> None:
        pose = self.body.pose()
        self.base.turn_to(pose.yaw_rad + pose.bearing_rad(target_m))
        distance_m = self.body.pose().distance_m(target_m)
        self.base.tilt(tilt_towards(distance_m, float(target_m[2]), self.body.description))

    @property
    def _reach_m(self) -> float:
        return self.body.description.reach_m - REACH_SPARE_M

    def _missing_m(self, target_m: np.ndarray) -> float:
        """How much the robot stands too far away; at most 0 when the point is in reach."""
        spare = REACH_SPARE_M / 3
        return self.body.pose().distance_m(target_m) - self.body.description.reach_m + spare

    # --- place ---------------------------------------------------------------------------------
    def place(
        self, receptacle: ObjectInstance, class_name: str, confirmed: Judged = still_there
    ) -> Done:
        """Put the held thing down on a receptacle, by the rule of the settings. What does not
        hold up as it is believed from there is doubted."""
        failed = _Failed()
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
            near = self.near = self.belief.from_near(receptacle, class_name, GROWN_M)
            if not confirmed(near):
                return Done.DOUBTED
            receptacle = self.placed_on = near or receptacle
            point = self._point_from_here(receptacle, spot, failed)
            if point is None and not last:
                self.last_reason = "from near there was no free place in reach"
            elif self._put(point or self._raised(spot)):
                return Done.SUCCEEDED
            else:
                failed.stands.append(self.body.pose().xy)
            failed.points.append(point or spot.point_m)
        return Done.FAILED if stood else Done.OUT_OF_REACH

    def _put(self, point_m: tuple[float, float, float]) -> bool:
        """Face a point in reach and release above it; False when the robot could not and still
        holds the thing."""
        self._face(np.array(point_m))
        by_paper = self.settings.place_rule == "paper"
        drop_m = PAPER_RELEASE_HEIGHT_M if by_paper else RELEASE_HEIGHT_M
        x, y, z = point_m
        self.surface_m = z
        result = self.base.monitor.act(Place((x, y, z + drop_m)))
        if not self.body.held():
            self.base.monitor.carrying = False
        if result.succeeded:
            return True
        self.last_reason = result.reason
        if not self.body.held():
            raise Dropped(self.body.pose().xy, result.reason or "it fell while it was placed")
        return False

    def _free_spots(
        self, receptacle: ObjectInstance, reached: Reach, failed: _Failed
    ) -> list[Spot]:
        """New spots where nothing lies yet; where there is none, those that are only about flat,
        and then those nearer to an edge."""
        for inset_m, flat_m in product((PLACE_INSET_M, PLACE_INSET_M / 2), FLATNESS_M):
            rules = PlaceRules(inset_m, flat_m)
            spots = place_spots(receptacle, reached, self._reach_m, rules, failed.stands)
            if new := [spot for spot in spots if failed.lacks(spot.point_m)]:
                return new
        return []

    def _spot(self, receptacle: ObjectInstance, failed: _Failed) -> Spot | None:
        """The best spot on a surface that was seen; on the second try one without a surface."""
        for level in self.base.levels if self.settings.place_rule == "flat" else ():
            spots = self._free_spots(receptacle, self.base.reach(level), failed)
            if spots:
                return spots[0]
        here = self.body.pose()
        for level in self.base.levels:
            point = edge_spot(receptacle, here, PLACE_INSET_M + 0.05)
            if not failed.lacks(point):
                return None
            stand = stand_for(
                point, self.base.reach(level), self.body.description, self._reach_m, failed.stands,
                tried_m=OTHER_SIDE_M,
            )  # fmt: skip
            if stand is not None:
                return Spot(point, stand, 0.0)
        return None

    def _point_from_here(
        self, receptacle: ObjectInstance, spot: Spot, failed: _Failed
    ) -> tuple[float, float, float] | None:
        """The point again, now that the surface was seen from near: the best one within reach. None
        where there is a better one elsewhere."""
        here = self.body.pose()
        if self.settings.place_rule == "paper":
            rules = AheadRules(self._reach_m)
            return highest_ahead(receptacle, self.body.ground(), here, rules) or spot.point_m
        reached = self.base.reach(self.base.levels[-1])
        seen = self._free_spots(receptacle, reached, failed)
        if not seen:
            return self._raised(spot)
        free = [one for one in seen if self._missing_m(np.array(one.point_m)) <= 0]
        as_good = (s.point_m for s in free if s.inset_m >= spot.inset_m - 0.02)
        return next(as_good, free[0].point_m if free else None)

    def _raised(self, spot: Spot) -> tuple[float, float, float]:
        """Where a spot has to do: over what is seen there now."""
        x, y, z = spot.point_m
        return x, y, max(z, top_at_m(self.body.ground(), (x, y), OVER_M))


class Seen(Enum):
    ON_IT = auto()
    BESIDE_IT = auto()
    NOWHERE = auto()


def seen_after(
    receptacle: ObjectInstance,
    before: Sequence[ObjectInstance],
    now: Sequence[ObjectInstance],
    least_class_score: float,
    surface_m: float,
) -> tuple[Seen, ObjectInstance | None]:
    """Where the placed thing is seen; before, now: all instances of its class. surface_m: height
    of what it was put on, where it was let go."""
    believed = [
        o for o in now
        if o.class_score >= least_class_score
        and all(math.dist(o.center_m, b.center_m) > SAME_INSTANCE_M for b in before)
        and math.dist(o.center_m[:2], receptacle.center_m[:2]) <= _around_m(receptacle)
    ]  # fmt: skip
    high = [o for o in believed if float(o.center_m[2]) >= surface_m - BELOW_M]
    on = [o for o in high if near_outline(receptacle, o.center_m, ON_OUTLINE_M)]
    if on:
        return Seen.ON_IT, max(on, key=lambda o: o.class_score)
    lower = [o for o in believed if float(o.center_m[2]) < surface_m - BELOW_M]
    if lower:
        return Seen.BESIDE_IT, max(lower, key=lambda o: o.class_score)
    return Seen.NOWHERE, None


def look_after(
    body: RobotInterface,
    receptacle: ObjectInstance,
    before: Sequence[ObjectInstance],
    now: Callable[[], Sequence[ObjectInstance]],
    least_class_score: float,
    surface_m: float,
) -> tuple[Seen, ObjectInstance | None]:
    """As `seen_after`; what is seen nowhere is looked for once more."""
    seen, thing = seen_after(receptacle, before, now(), least_class_score, surface_m)
    if seen is Seen.NOWHERE:
        # In the image of the placing the map took it for still held. Where no step is left to
        # look once more, it is placed all the same.
        with contextlib.suppress(TaskFailed):
            body.act(Observe())
        seen, thing = seen_after(receptacle, before, now(), least_class_score, surface_m)
    return seen, thing


def _around_m(receptacle: ObjectInstance) -> float:
    return AROUND_M + float(math.hypot(*receptacle.size_m[:2])) / 2
