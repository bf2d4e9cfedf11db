"""Simulated detector: simulator ground truth with the errors of `frame_noise`."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from helios_core.geometry import Pinhole, lift_pixels
from helios_core.name_rules import plain
from helios_core.types import Detection, Frame, SearchContext
from numpy.typing import NDArray

from helios_detector.backend import SEEN_SCORE, DetectorBackend, Findings, Seen
from helios_detector.lexical_scorer import household_names
from helios_detector.simulation.frame_noise import Draws, NoiseTable, hashed_voxels
from helios_detector.simulation.ground_truth_detector import Visible, detection, visible
from helios_detector.simulation.mask_errors import eroded, trimmed
from helios_detector.simulator_truth import TruthSource, truth_of
from helios_detector.vocabulary_matching import SearchTarget, open_wanted

VOXEL_M = 0.15  # voxel within which a false positive keeps its position
SUBSAMPLE_PX = 4


class FrameNoiseDetector(DetectorBackend):
    """Detector with misses, class confusions, false positives and small masks; errors repeat for
    the same view."""

    def __init__(self, source: TruthSource, table: NoiseTable, seed: int = 0) -> None:
        self._source, self._table, self._seed = source, table, seed
        self.name = f"simulated:{table.name}@{table.digest}"

    def vocabulary(self) -> tuple[str, ...]:
        """Household names only: false positives would show any other name too, such as unicorn."""
        return tuple(sorted(household_names()))

    def refused(self, context: SearchContext) -> Mapping[str, str]:
        return {}

    def warm_up(self) -> None:
        self._source.check()

    def close(self) -> None:
        """No resources to free."""

    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        truth = truth_of(frame, self._source)
        frame = truth.in_world(frame)
        wanted = open_wanted(context)
        shape = frame.depth_m.shape
        detections: list[Detection] = []
        seen: dict[str, Seen] = {}
        for thing in visible(truth, max(1, self._table.always_missed_below_px)):
            draws, distance_m = self._draws(thing, frame)
            if self._deceives(thing):
                detections += self._imagined(thing, frame, wanted, draws)
            if draws.uniform("miss") < self._table.miss(thing.pixels, distance_m):
                continue
            name, score = self._named(thing, draws)
            if score >= SEEN_SCORE and (name not in seen or seen[name].score < score):
                seen[name] = Seen(name, score)
            takers = [w for w in wanted if plain(name) in w.names and score >= w.threshold]
            if takers:
                erode_px = round(self._table.erode_px * self._table.level)
                box, crop = eroded(thing.box_xyxy, thing.crop, erode_px)
                detections += [detection(w.name, score, box, crop, shape) for w in takers]
        return Findings(tuple(detections), tuple(seen.values()))

    def _draws(self, thing: Visible, frame: Frame) -> tuple[Draws, float]:
        """The object's draws in this view, and its distance from the camera in metres."""
        eye_m = frame.T_world_cam[:3, 3]
        x, y, z = eye_m - thing.instance.center_seen_from(eye_m)
        distance_m = math.sqrt(x * x + y * y + z * z)
        cell = self._table.cell(math.atan2(y, x), distance_m, thing.pixels)
        key = f"{self._seed}/{self._table.name}/{thing.instance.id}/{cell}"
        return Draws(key, frame.stamp_ns, self._table.redrawn), distance_m

    def _named(self, thing: Visible, draws: Draws) -> tuple[str, float]:
        """The reported class and its score."""
        table = self._table
        name, (mean, sd) = thing.instance.class_name, table.true_score
        u = draws.uniform("confusion")
        for other, probability in table.confusion.get(plain(name), {}).items():
            u -= probability * table.level
            if u < 0:
                name, (mean, sd) = other, table.confused_score
                break
        mean *= 1 - min(1.0, table.level) * (1 - table.score_factor_by_pixels(thing.pixels))
        return name, self._score(mean, sd, draws, "score")

    def _score(self, mean: float, sd: float, draws: Draws, purpose: str) -> float:
        noise = sd * draws.normal(purpose)
        noise += self._table.score_jitter * draws.frame_normal(f"{purpose} jitter")
        return min(0.99, max(0.05, mean + self._table.level * noise))

    def _deceives(self, thing: Visible) -> bool:
        """True if the object is furniture that may carry false positives."""
        instance = thing.instance
        never = plain(instance.class_name) in self._table.false_never_on
        return not instance.graspable and not never

    def _imagined(
        self, thing: Visible, frame: Frame, wanted: tuple[SearchTarget, ...], draws: Draws
    ) -> list[Detection]:
        """False positives on a piece of furniture; a hash picks one position per class."""
        out: list[Detection] = []
        for want in wanted:
            purpose = f"false {plain(want.name)}"
            probability = self._table.false_positive * self._table.level
            if not want.is_object or draws.uniform(purpose) >= probability:
                continue
            score = self._score(*self._table.false_score, draws, f"{purpose} score")
            if score < want.threshold:
                continue
            key = f"{self._seed}/{thing.instance.id}/{purpose}"
            crop = self._patch(thing, frame, key)
            if np.count_nonzero(crop) >= self._table.false_min_px:
                box, crop = trimmed(thing.box_xyxy, crop)
                out.append(detection(want.name, score, box, crop, frame.depth_m.shape))
        return out

    def _patch(self, thing: Visible, frame: Frame, key: str) -> NDArray[np.bool_]:
        """The object's pixels within a small ball around the position that the key picks."""
        x0, y0, x1, y1 = thing.box_xyxy
        c = frame.camera
        camera = Pinhole(c.fx, c.fy, c.cx - x0, c.cy - y0, x1 - x0, y1 - y0)
        points_m = lift_pixels(frame.depth_m[y0:y1, x0:x1], camera, frame.T_world_cam)
        usable = thing.crop & np.isfinite(points_m[..., 2])
        if not usable.any():
            return usable
        coarse = points_m[::SUBSAMPLE_PX, ::SUBSAMPLE_PX][usable[::SUBSAMPLE_PX, ::SUBSAMPLE_PX]]
        if not len(coarse):
            return np.zeros_like(usable)
        voxels = np.floor(coarse / VOXEL_M).astype(np.int64)
        place = (voxels[np.argmin(hashed_voxels(voxels, key))] + 0.5) * VOXEL_M
        nearest = coarse[np.argmin(((coarse - place) ** 2).sum(-1))]
        with np.errstate(invalid="ignore"):
            close = ((points_m - nearest) ** 2).sum(-1) < self._table.false_radius_m**2
        return usable & close
