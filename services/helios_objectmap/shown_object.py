"""Names that the detector gives to the object that the robot shows to the camera.

This is not in the paper. The robot turns a picked object before its camera. Each turn shows another
side from near, and a detector seldom takes an object for another one from all sides. The map leaves
such frames out; what they show counts for the held object alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from helios_core.geometry import Matrix, lift_pixels
from helios_core.types import Detection, Observation
from numpy.typing import NDArray

from helios_objectmap.instances.furniture import is_furniture
from helios_objectmap.instances.image_text import ImageTextScores, in_odds
from helios_objectmap.instances.name_sightings import NameErrors, NameRates

AROUND_M = 0.25  # a detection with its middle this near the shown point is of the object
SIDE_RAD = math.radians(30)  # turns that differ by less show one side


@dataclass(frozen=True)
class ShownNames:
    """How often the shown object was called by each name. names: with the share of the sides that
    have a detection, largest first."""

    probability: float  # that the asked class is right; 1 without any detection
    sides: int  # with a detection of the object
    names: tuple[tuple[str, float], ...]
    image_text_nats: float | None = None  # in the probability; None if the class is not rated

    def with_image_text(self, nats: float | None) -> ShownNames:
        """The same with the log-likelihood ratio of the class by image-text scores. Without any
        detection, right and wrong were as likely before."""
        if nats is None:
            return self
        before = self.probability if self.sides else 0.5
        return replace(self, probability=in_odds(before, nats), image_text_nats=nats)


@dataclass
class ShownObject:
    """Detections of the object shown now, or last."""

    _views: dict[int, list[set[str]]] = field(default_factory=dict)  # side -> names of each view
    _scores: dict[str, list[float]] = field(default_factory=dict)  # class -> image-text scores
    _over: bool = False

    def note(self, observation: Observation) -> None:
        """Add a frame. One that shows no object ends the views of the present one."""
        shown = observation.frame.shown
        if shown is None:
            self._over = True
            return
        if self._over:
            self._views, self._scores, self._over = {}, {}, False
        for name, score in observation.class_scores.items():
            self._scores.setdefault(name, []).append(score)
        frame = observation.frame
        points_m = lift_pixels(frame.depth_m, frame.camera, frame.T_world_cam)
        named = {
            d.class_name
            for d in (*observation.detections, *observation.others)
            if _is_at(d, points_m, np.asarray(shown.point_m))
        }
        if named:
            side = round(shown.turn_rad / SIDE_RAD) % round(math.tau / SIDE_RAD)
            self._views.setdefault(side, []).append(named)

    def names(
        self, class_name: str, errors: NameErrors, rated: ImageTextScores | None = None
    ) -> ShownNames:
        """Names of the object, and the probability that it is of a class.

        Furniture is compared with furniture only, and other things with other things. rated:
        image-text scores of the map's views, with which those of the object are compared.
        """
        kind = is_furniture(class_name)
        views = {
            side: [{n for n in named if is_furniture(n) == kind} for named in of_side]
            for side, of_side in self._views.items()
        }
        sides = [[named for named in of_side if named] for of_side in views.values()]
        sides = [of_side for of_side in sides if of_side]
        names = sorted({name for of_side in sides for named in of_side for name in named})
        rate = np.array(
            [[np.mean([n in named for named in of_side]) for n in names] for of_side in sides],
            np.float64,
        ).reshape(len(sides), len(names))
        rates = NameRates(tuple(names), rate, np.ones(len(sides)))
        share = rate.mean(axis=0).tolist() if sides else []
        ordered = sorted(zip(names, share, strict=True), key=lambda pair: (-pair[1], pair[0]))
        seen = ShownNames(rates.probability(class_name, errors), len(sides), tuple(ordered))
        if rated is None:
            return seen
        scores = self._scores.get(class_name, [])
        return seen.with_image_text(rated.shown_log_likelihood_ratio(class_name, scores))


def _is_at(detection: Detection, points_m: Matrix, middle_m: NDArray[np.float64]) -> bool:
    """True if the middle of what a detection shows lies at a world point [3]. points_m: [h, w, 3],
    NaN where nothing was measured."""
    x0, y0, x1, y1 = detection.box_xyxy
    shown = points_m[y0:y1, x0:x1][detection.mask[y0:y1, x0:x1]]
    shown = shown[np.isfinite(shown[:, 0])]
    if not len(shown):
        return False
    return float(np.linalg.norm(np.median(shown, axis=0) - middle_m)) <= AROUND_M
