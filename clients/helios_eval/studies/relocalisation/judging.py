"""Outcome of the search for a place, on recorded sessions: the same rule as in map2d."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.geometry import invert, yaw_of
from helios_map2d.files.map_file import decode_map
from helios_map2d.layers.parameters import MapRules
from helios_map2d.place_search import EVERY_KEYFRAMES
from helios_map2d.relocalisation.alignment import StoredMap, align, prepared
from helios_map2d.relocalisation.grid_fields import OccupancyGrid
from helios_map2d.relocalisation.poses import Transform2
from helios_map2d.relocalisation.state import Fix, PlaceState
from helios_objectmap import persistence
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings

from helios_eval.episodes.service_settings import of_service, of_stack
from helios_eval.studies.relocalisation.recordings import Recording, landmark
from helios_eval.studies.relocalisation.sessions import AGENT, SavedMap

GOOD_M, GOOD_RAD = 0.15, math.radians(3)  # largest error of a correct fix


@dataclass(frozen=True)
class Outcome:
    """Search for the place of one stored map in one session."""

    seed: int  # home of the session
    stored_seed: int  # home of the stored map
    step: int  # action after which the place was known; 0: it stayed unknown
    error_m: float = 0.0  # at the middle of the present map
    error_rad: float = 0.0
    attempts: int = 0
    reason: str = ""  # why the last attempt did not pass

    @property
    def is_right(self) -> bool:
        """True for a fix in the right home with a small error."""
        same = self.seed == self.stored_seed
        return same and self.step > 0 and self.error_m <= GOOD_M and self.error_rad <= GOOD_RAD

    @property
    def is_false(self) -> bool:
        """True for a fix in another home, or with a large error."""
        return self.step > 0 and not self.is_right


@dataclass(frozen=True)
class SecondVisit:
    """The task of the first visit again, from a random start and with the saved map."""

    found_step: int  # actions until the task ended in front of the object; 0: it did not
    steps: int
    without_map_step: int  # the same from the same start without the saved map
    place_step: int  # action after which the place was known; 0: it stayed unknown
    error_m: float  # of the robot's position in the saved map
    error_rad: float

    @property
    def is_false(self) -> bool:
        """True for a fix with a large error."""
        return self.place_step > 0 and not (self.error_m <= GOOD_M and self.error_rad <= GOOD_RAD)


@dataclass(frozen=True)
class HomeOutcome:
    """All results of one home."""

    seed: int
    sensor: str
    starts_on_known_floor: bool  # the later session starts on floor that the saved map knows
    first_found_step: int  # actions until the first visit found the object; 0: not found
    own: Outcome
    other: Outcome
    second: SecondVisit | None  # None if the first visit did not find the object

    @staticmethod
    def from_json(raw: dict[str, Any]) -> HomeOutcome:
        """Outcome from the JSON of its fields."""
        second = raw["second"]
        return HomeOutcome(
            raw["seed"],
            raw["sensor"],
            raw["starts_on_known_floor"],
            raw["first_found_step"],
            Outcome(**raw["own"]),
            Outcome(**raw["other"]),
            None if second is None else SecondVisit(**second),
        )


def outcome_of(session: Recording, stored_seed: int, stored: StoredMap) -> Outcome:
    """Search in a recorded session, with an attempt after every few actions."""
    fix, attempts, reason = Fix(), 0, ""
    for moment in session.moments:
        if moment.step % EVERY_KEYFRAMES:
            continue
        found = align(stored, moment.grid, moment.landmarks)
        attempts += 1
        reason = "the map is too small" if found is None else found.reason
        fix = fix.after(found, moment.grid.known_m2, moment.middle_m)
        if fix.state is PlaceState.RELOCALISED and fix.T_stored_present is not None:
            truth = true_transform(moment.T_estimated_true)
            error_m, error_rad = fix.T_stored_present.difference(truth, moment.middle_m)
            return Outcome(session.seed, stored_seed, moment.step, error_m, error_rad, attempts)
    return Outcome(session.seed, stored_seed, 0, attempts=attempts, reason=reason)


def starts_on_known_floor(session: Recording, stored: StoredMap) -> bool:
    """True if the robot's start is on floor that the stored map knows."""
    start = true_transform(session.moments[0].T_estimated_true).of(np.zeros((1, 2)))
    cell, on = stored.fields.cells_of(start)
    return bool(on[0] and stored.fields.free.ravel()[cell[0]])


def true_transform(T_estimated_true: np.ndarray) -> Transform2:
    """T_stored_present of a stored map in the true frame."""
    T = invert(T_estimated_true)
    return Transform2(float(T[0, 3]), float(T[1, 3]), yaw_of(T))


def transform_of(pose: pb.Pose2) -> Transform2:
    """Transform of a message."""
    return Transform2(pose.x_m, pose.y_m, pose.yaw_rad)


@lru_cache(maxsize=4)
def stored_map(saved: SavedMap) -> StoredMap | None:
    """Saved map, prepared for alignment; None if it has no surfaces."""
    ground, _ = decode_map(saved.map2d, MapRules(), 0.0, 0)
    published = ground.published
    grid = OccupancyGrid(published.occupancy, published.grid.origin_m, published.grid.cell_m)
    objects = ObjectMap(ObjectMapSettings(**of_service("objectmap", of_stack(AGENT, {}))))
    objects.load_content(persistence.read(saved.objects, objects.empty_viewpoints()).content)
    marks = [landmark(o.center_m.tolist(), o.probabilities) for o in objects.objects()]
    return prepared(grid, marks)
