"""Beliefs about objects: from the object map with its scores, or from detections alone."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from helios_core import proto as pb
from helios_core.codec import object_from_proto, object_to_proto
from helios_core.keyframe_acks import MapPart
from helios_core.types import ObjectInstance

from helios_planner.match_radii import SAME_THING_M
from helios_planner.motion_planning.base_placement import nearest_to
from helios_planner.robot.detections import DETECTIONS, Sighting
from helios_planner.robot.interface import RobotInterface
from helios_planner.settings import Settings


class Belief(ABC):
    """An agent's belief about objects: the instances of a class, and an estimate from near."""

    required_parts: ClassVar[tuple[str, ...]]  # keyframe parts to be acknowledged before a decision

    def __init__(self, robot: RobotInterface, settings: Settings) -> None:
        self.robot, self.settings = robot, settings

    @abstractmethod
    def known(self, class_name: str) -> Sequence[ObjectInstance]:
        """All instances that may be of a class."""

    @abstractmethod
    def from_near(
        self, thing: ObjectInstance, class_name: str, within_m: float
    ) -> ObjectInstance | None:
        """Present estimate of an object in front of the robot; None if it is no longer there."""

    def still_supports(self, thing: ObjectInstance) -> bool:
        """True if driving on to the object is worth it. Beliefs with scores decide on arrival."""
        return True

    @abstractmethod
    def taken(self, thing: ObjectInstance) -> None:
        """Remove an object that was picked up."""

    @abstractmethod
    def checkpoint(self) -> dict[str, Any]:
        """State that only this belief holds, as JSON, for `restore`."""

    @abstractmethod
    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        """Restore the state that `checkpoint` returned."""


class MapBelief(Belief):
    """Belief of the object map, with scores over all views (HELIOS)."""

    required_parts = tuple(MapPart)

    def known(self, class_name: str) -> Sequence[ObjectInstance]:
        return self.robot.objects(class_name)

    def from_near(
        self, thing: ObjectInstance, class_name: str, within_m: float
    ) -> ObjectInstance | None:
        """The same instance within `within_m`; if it is gone, the one now in its place."""
        known = self.robot.objects(class_name)
        same = [o for o in known if o.id == thing.id]
        within_m = within_m if same else min(within_m, SAME_THING_M)
        return nearest_to(thing.center_m, same or known, within_m)

    def taken(self, thing: ObjectInstance) -> None:
        self.robot.retire(thing.id, np.asarray(thing.center_m), "picked up")

    def checkpoint(self) -> dict[str, Any]:
        return {}

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        """Do nothing: the object map keeps its own state."""


class TrustingBelief(Belief):
    """Belief that every detection is true for good: no map, no doubt. A later detection at the same
    place replaces the position."""

    required_parts = (MapPart.OCCUPANCY, MapPart.VALUE, DETECTIONS)

    def __init__(self, robot: RobotInterface, settings: Settings) -> None:
        super().__init__(robot, settings)
        self._things: list[ObjectInstance] = []
        self._read = self._ids = 0

    def known(self, class_name: str) -> Sequence[ObjectInstance]:
        sightings = self.robot.sightings()
        for sighting in sightings[self._read :]:
            self._take_in(sighting)
        self._read = len(sightings)
        return [t for t in self._things if t.class_name == class_name]

    def from_near(
        self, thing: ObjectInstance, class_name: str, within_m: float
    ) -> ObjectInstance | None:
        return nearest_to(thing.center_m, self.known(class_name), within_m) or thing

    def taken(self, thing: ObjectInstance) -> None:
        self._things = [t for t in self._things if t.id != thing.id]

    def checkpoint(self) -> dict[str, Any]:
        things = [object_to_proto(t).SerializeToString().hex() for t in self._things]
        return {"things": things, "newest_id": self._ids}

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        kept = (pb.ObjectInstance.FromString(bytes.fromhex(t)) for t in checkpoint["things"])
        self._things = [object_from_proto(thing) for thing in kept]
        self._ids = checkpoint["newest_id"]

    def _take_in(self, sighting: Sighting) -> None:
        self._put(sighting, self._known_as(sighting))

    def _known_as(self, sighting: Sighting) -> ObjectInstance | None:
        """Known object that the sighting shows; None if it is new."""
        same = [
            t
            for t in self._things
            if t.class_name == sighting.class_name
            and math.dist(t.center_m[:2], sighting.center_m[:2]) < SAME_THING_M
        ]
        return min(same, key=lambda t: math.dist(t.center_m, sighting.center_m), default=None)

    def _put(
        self, sighting: Sighting, known: ObjectInstance | None, uncertainty: float = 0.0
    ) -> None:
        """Store a sighting as a new object, or in place of the known one."""
        if known is None:
            self._ids += 1
            self._things.append(trusted(self._ids, sighting, 1, uncertainty))
        else:
            k = next(k for k, t in enumerate(self._things) if t.id == known.id)
            self._things[k] = trusted(known.id, sighting, known.views + 1, uncertainty)


def trusted(id: int, sighting: Sighting, views: int, uncertainty: float = 0.0) -> ObjectInstance:
    """Instance of a sighting, with score 1 unless an uncertainty is given."""
    return ObjectInstance(
        id=id,
        class_name=sighting.class_name,
        center_m=sighting.center_m,
        size_m=sighting.size_m,
        score=1.0 - uncertainty,
        class_score=1.0,
        uncertainty=uncertainty,
        views=views,
        gaussians=0,
        probabilities={sighting.class_name: 1.0},
        top_m=sighting.top_m,
        outline_m=sighting.outline_m,
        detection_rate=1.0,
    )
