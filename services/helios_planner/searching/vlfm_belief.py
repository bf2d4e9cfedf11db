"""What VLFM takes for true of what the detector reports (its object map, written anew).

A detection counts from a confidence on, unless the thing is too near to be trusted. Seen at the
side of an image, or from too far, it is tentative: gone to where nothing else is known, and dropped
as soon as the robot sees its place from near. What was seen well once stays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from helios_core.types import ObjectInstance

from helios_planner.ground.gaze import eye_of, outline_of
from helios_planner.robot.sightings import Sighting
from helios_planner.searching.belief import TrustingBelief
from helios_planner.searching.look import nearest_to

RANGE_M = 5.0  # of VLFM's camera
FAR_SHARE, NEAR_SHARE = 0.95, 0.5  # of the range: tentative beyond, and dropped within
TOO_NEAR_M = 1.0
TENTATIVE = 1.0  # its uncertainty, so that its score is 0


class VlfmBelief(TrustingBelief):
    """See the module."""

    doubts_sides: ClassVar[bool] = True

    def known(self, class_name: str) -> Sequence[ObjectInstance]:
        """What was seen well; if there is nothing, what is tentative."""
        super().known(class_name)  # reads what came
        self._things = [t for t in self._things if not (_tentative(t) and self._disproved(t))]
        things = [t for t in self._things if t.class_name == class_name]
        return [t for t in things if not _tentative(t)] or things

    def from_near(
        self, thing: ObjectInstance, class_name: str, within_m: float
    ) -> ObjectInstance | None:
        return nearest_to(thing.center_m, self.known(class_name), within_m)

    def holds(self, thing: ObjectInstance) -> bool:
        """Also False where another one was seen well meanwhile."""
        return any(t.id == thing.id for t in self.known(thing.class_name))

    @property
    def _range_m(self) -> float:
        return min(RANGE_M, self.body.description.max_depth_m)

    def _take_in(self, sighting: Sighting) -> None:
        if sighting.confidence < self.settings.vlfm_confidence or sighting.nearest_m < TOO_NEAR_M:
            return
        well = sighting.nearest_m <= FAR_SHARE * self._range_m
        well = well and not (self.doubts_sides and sighting.at_side)
        known = self._known_as(sighting)
        if well:
            self._put(sighting, known)
        elif sighting.nearest_m > NEAR_SHARE * self._range_m and (
            known is None or _tentative(known)
        ):
            self._put(sighting, known, TENTATIVE)

    def _disproved(self, thing: ObjectInstance) -> bool:
        """Whether the camera is turned to any of it from near: it would have been seen well."""
        robot, pose = self.body.description, self.body.pose()
        eye = (*eye_of(pose, robot), robot.camera_height_m)
        points = np.vstack([outline_of(thing), thing.center_m[:2]])
        return any(
            abs(pose.bearing_rad(xy)) <= robot.camera.hfov_rad / 2
            and math.dist(eye, (*xy, thing.center_m[2])) <= NEAR_SHARE * self._range_m
            for xy in points
        )


class UnfilteredBelief(VlfmBelief):
    """Without the doubt about what is at the side of an image (Table 2)."""

    doubts_sides = False


def _tentative(thing: ObjectInstance) -> bool:
    return thing.uncertainty >= TENTATIVE
