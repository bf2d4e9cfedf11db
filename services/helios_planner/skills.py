"""Pick and place: approach, look once more, act, look at what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from itertools import product

import numpy as np
from helios_core.robot import Pick, Place
from helios_core.types import ObjectInstance

from helios_planner.belief import Belief
from helios_planner.body import Body
from helios_planner.gaze import tilt_towards
from helios_planner.grid import Pose2
from helios_planner.legs import Legs, Outcome
from helios_planner.mishaps import Dropped
from helios_planner.motion import Reach
from helios_planner.settings import Settings
from helios_planner.stand import (
    ON_SHELF_M,
    ON_TOP_M,
    AheadRules,
    PlaceRules,
    Spot,
    edge_spot,
    highest_ahead,
    place_spots,
    stand_for,
)
from helios_planner.task import Cause, TaskFailed


class Done(Enum):
    """How a skill ended."""

    SUCCEEDED = auto()
    FAILED = auto()
    DOUBTED = auto()  # from near it does not look like what it was taken for
    OUT_OF_REACH = auto()


@dataclass
class Skills:
    """Acts on one thing at a time. `picks` counts over the whole task."""

    body: Body
    legs: Legs
    settings: Settings
    belief: Belief
    attempts: int  # picks at one thing
    picks: int = 0
    falls: int = 0
    last_reason: str = ""
    surface_m: float = 0.0  # height of where something was let go last

    # --- pick ----------------------------------------------------------------------------------
    def pick(self, thing: ObjectInstance, class_name: str) -> Done:
        """Grasp a thing: up to `attempts` times, each from another place."""
        tried: list[tuple[float, float]] = []
        attempts = 0
        while attempts < self.attempts:
            if not self._approach(np.asarray(thing.center_m), tried, f"reach the {class_name}"):
                return Done.FAILED if attempts else Done.OUT_OF_REACH
            tried.append(self.body.pose().xy)
            near = self.belief.from_near(thing, class_name, 0.3)
            if near is None:
                return Done.DOUBTED
            thing = near
            if self._missing_m(thing.center_m) > 0:
                continue  # it is further than it was believed to be: another place
            attempts += 1
            self._count_pick()
            x, y, z = (float(v) for v in thing.center_m)
            result = self.legs.mishaps.act(Pick((x, y, z), class_name))
            if result.succeeded and self.body.held():
                self.belief.taken(thing)
                self.legs.mishaps.carrying = True
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
        self.body.tell_picks(self.picks)

    def _approach(
        self, target_m: np.ndarray, tried: list[tuple[float, float]], purpose: str
    ) -> bool:
        """Stand within reach of a point, facing it, the head towards it: with it in sight, else
        where only what is over it would hide it, as the boards of a shelf seem to do in a map of
        heights."""
        for above_m, level in product((ON_TOP_M, ON_SHELF_M), self.legs.levels):
            stand = stand_for(
                target_m, self.legs.reach(level), self.body.description, self._reach_m, tried,
                above_m,
            )  # fmt: skip
            if stand is None:
                continue
            if self._stand_at(stand, target_m, purpose):
                return True
            tried.append(stand.xy)
        return False

    def _stand_at(self, stand: Pose2, target_m: np.ndarray, purpose: str) -> bool:
        if self.legs.go_to(stand, purpose, slip_m=0.1) is not Outcome.ARRIVED:
            return False
        self._face(target_m)
        if (missing_m := self._missing_m(target_m)) > 0:
            step_m = max(missing_m + 0.02, self.body.description.min_forward_m)
            self.legs.ahead(step_m)
            self._face(target_m)
        return self._missing_m(target_m) <= 0

    def _face(self, target_m: np.ndarray) -> None:
        pose = self.body.pose()
        self.legs.turn_to(pose.yaw_rad + pose.bearing_rad(target_m))
        distance_m = self.body.pose().distance_m(target_m)
        self.legs.tilt(tilt_towards(distance_m, float(target_m[2]), self.body.description))

    @property
    def _reach_m(self) -> float:
        return self.body.description.reach_m - self.settings.reach_spare_m

    def _missing_m(self, target_m: np.ndarray) -> float:
        """How much the robot stands too far away; at most 0 when the point is in reach."""
        spare = self.settings.reach_spare_m / 3
        return self.body.pose().distance_m(target_m) - self.body.description.reach_m + spare

    # --- place ---------------------------------------------------------------------------------
    def place(self, receptacle: ObjectInstance, class_name: str) -> Done:
        """Put the held thing down on a receptacle, by the rule of the settings."""
        failed: list[tuple[float, float, float]] = []
        stood = False
        for _ in range(self.settings.places_per_receptacle):
            receptacle = self.belief.from_near(receptacle, class_name, 0.5) or receptacle
            spot = self._spot(receptacle, failed)
            if spot is None:
                break
            target = np.array(spot.point_m)
            if not self._stand_at(spot.stand, target, f"place on the {class_name}"):
                failed.append(spot.point_m)
                continue
            stood = True
            point = self._point_from_here(receptacle, spot, failed)
            if self._let_go(point):
                return Done.SUCCEEDED
            failed.append(point)
        return Done.FAILED if stood else Done.OUT_OF_REACH

    def _let_go(self, point_m: tuple[float, float, float]) -> bool:
        """Release above a point; False when the robot could not and still holds the thing."""
        by_paper = self.settings.place_rule == "paper"
        drop_m = self.settings.paper_drop_m if by_paper else self.settings.place_drop_m
        x, y, z = point_m
        self.surface_m = z
        result = self.legs.mishaps.act(Place((x, y, z + drop_m)))
        if not self.body.held():
            self.legs.mishaps.carrying = False
        if result.succeeded:
            return True
        self.last_reason = result.reason
        if not self.body.held():
            raise Dropped(self.body.pose().xy, result.reason or "it fell while it was placed")
        return False

    def _free_spots(self, receptacle: ObjectInstance, reached: Reach) -> list[Spot]:
        """Spots where nothing lies yet; where there is none, those that are only about flat."""
        for flat_m in self.settings.place_flats_m:
            rules = PlaceRules(self.settings.place_inset_m, flat_m)
            if spots := place_spots(receptacle, reached, self._reach_m, rules):
                return spots
        return []

    def _spot(
        self, receptacle: ObjectInstance, failed: list[tuple[float, float, float]]
    ) -> Spot | None:
        """The best spot on a surface that was seen; on the second try one without a surface."""
        for level in self.legs.levels if self.settings.place_rule == "flat" else ():
            reached = self.legs.reach(level)
            for spot in self._free_spots(receptacle, reached):
                if _new(spot.point_m, failed):
                    return spot
        here = self.body.pose()
        for level in self.legs.levels:
            point = edge_spot(receptacle, here, self.settings.place_inset_m + 0.05)
            if not _new(point, failed):
                return None
            stand = stand_for(point, self.legs.reach(level), self.body.description, self._reach_m)
            if stand is not None:
                return Spot(point, stand, 0.0)
        return None

    def _point_from_here(
        self, receptacle: ObjectInstance, spot: Spot, failed: list[tuple[float, float, float]]
    ) -> tuple[float, float, float]:
        """The point again, now that the surface was seen from near: the best one within reach."""
        here = self.body.pose()
        if self.settings.place_rule == "paper":
            rules = AheadRules(self._reach_m)
            return highest_ahead(receptacle, self.body.ground(), here, rules) or spot.point_m
        reached = self.legs.reach(self.legs.levels[-1])
        for better in self._free_spots(receptacle, reached):
            xy = better.point_m[:2]
            in_reach = here.distance_m(xy) <= self._reach_m and abs(here.bearing_rad(xy)) < 0.35
            if in_reach and better.inset_m >= spot.inset_m - 0.02 and _new(better.point_m, failed):
                return better.point_m
        return spot.point_m


def _new(point_m: tuple[float, float, float], failed: list[tuple[float, float, float]]) -> bool:
    """Whether a point is not one of those that failed, or next to one."""
    return all(np.hypot(point_m[0] - f[0], point_m[1] - f[1]) > 0.15 for f in failed)
