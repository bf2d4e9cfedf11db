"""Judgement of detections: what a detector said of each visible object of each image."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from helios_core.geometry import Matrix
from helios_core.types import Detection
from numpy.typing import NDArray

from helios_eval.studies.realism_judging import COVERS_IOU, NOWHERE_IOU

COUNTED = 0.25  # least score of a detection that counts

Box = tuple[float, float, float, float]  # x0, y0, x1, y1 in pixels


@dataclass(frozen=True)
class Visible:
    """An object in one image."""

    name: str
    class_name: str
    box_xyxy: Box
    pixels: int
    center_m: tuple[float, float, float]  # world
    unobstructed: bool


@dataclass(frozen=True)
class Sightings:
    """What a detector said of n visible objects, one row for each object and image."""

    home: NDArray[np.int64]  # [n] seed
    thing: NDArray[np.int64]  # [n] number of the object, unique over the homes
    view: NDArray[np.int64]  # [n] number of the view, unique over the homes
    class_name: NDArray[np.str_]  # [n]
    pixels: NDArray[np.float64]  # [n] visible
    distance_m: NDArray[np.float64]  # [n] camera to the object's middle
    angle_rad: NDArray[np.float64]  # [n] of the camera as seen from the object, world
    unobstructed: NDArray[np.bool_]  # [n]
    right: NDArray[np.float64]  # [n] best score of a right name, 0 without one
    wrong: NDArray[np.float64]  # [n] best score of a wrong name, 0 without one
    wrong_name: NDArray[np.str_]  # [n] that name, empty without one
    wrong_names: NDArray[np.int64]  # [n] number of wrong names with a score of `COUNTED` or more

    def __len__(self) -> int:
        return len(self.home)

    def part(self, rows: NDArray) -> Sightings:
        """These rows only."""
        return Sightings(*(value[rows] for value in vars(self).values()))


@dataclass(frozen=True)
class FalseAlarms:
    """Detections on no object, with the counts of images and of names that were asked for."""

    images: int
    asked: int  # number of names
    score: NDArray[np.float64]  # [m]
    name: NDArray[np.str_]  # [m]
    box_px: NDArray[np.float64]  # [m] pixels of the box
    distance_m: NDArray[np.float64]  # [m] median depth in the box; NaN where it is not known


class SightingLog:
    """Collects judged images of one detector."""

    def __init__(self, right: Mapping[str, frozenset[str]], asked: int) -> None:
        """right: the detector's correct names of each class of object; asked: number of names."""
        self.right, self._asked = right, asked
        self._things: dict[tuple[int, str], int] = {}
        self._views: dict[tuple[int, int], int] = {}
        self._rows: list[tuple] = []
        self._alarms: list[tuple[float, str, float, float]] = []
        self._scores: list[float] = []
        self._images = 0

    def add(
        self,
        home: int,
        view: int,
        T_world_cam: Matrix,
        things: Sequence[Visible],
        found: Iterable[Detection],
        depth_m: NDArray[np.float32] | None = None,
    ) -> None:
        """Judge the detections of one image. things: every object in it; depth_m: [h, w], 0 where
        it is not known."""
        self._images += 1
        found = tuple(found)
        self._scores += [d.score for d in found]
        covers = overlaps([t.box_xyxy for t in things], [d.box_xyxy for d in found])
        eye_m = T_world_cam[:3, 3]
        for row, thing in zip(covers, things, strict=True):
            right = self.right.get(thing.class_name)
            if right is None:
                continue
            here = [d for d, share in zip(found, row, strict=True) if share >= COVERS_IOU]
            own = max((d.score for d in here if d.class_name in right), default=0.0)
            others = [d for d in here if d.class_name not in right]
            other = max(others, key=lambda d: d.score, default=None)
            offset_m = eye_m - np.array(thing.center_m)
            self._rows.append(
                (
                    home,
                    self._things.setdefault((home, thing.name), len(self._things)),
                    self._views.setdefault((home, view), len(self._views)),
                    thing.class_name,
                    thing.pixels,
                    float(np.linalg.norm(offset_m)),
                    math.atan2(offset_m[1], offset_m[0]) % math.tau,
                    thing.unobstructed,
                    own,
                    other.score if other else 0.0,
                    other.class_name if other else "",
                    len({d.class_name for d in others if d.score >= COUNTED}),
                )
            )
        nowhere = covers.max(0, initial=0.0) < NOWHERE_IOU
        self._alarms += [
            (d.score, d.class_name, area(d.box_xyxy), depth_in(d.box_xyxy, depth_m))
            for d, no in zip(found, nowhere, strict=True)
            if no
        ]

    def sightings(self) -> Sightings:
        """All objects of all images so far."""
        columns: list[Sequence[Any]] = [list(c) for c in zip(*self._rows, strict=True)]
        kinds = (np.int64, np.int64, np.int64, np.str_, np.float64, np.float64, np.float64,
                 np.bool_, np.float64, np.float64, np.str_, np.int64)  # fmt: skip
        columns = columns or [[] for _ in kinds]
        arrays: list[Any] = [np.array(c, kind) for c, kind in zip(columns, kinds, strict=True)]
        return Sightings(*arrays)

    def false_alarms(self) -> FalseAlarms:
        """All detections on no object so far."""
        columns = zip(*self._alarms, strict=True) if self._alarms else ((), (), (), ())
        scores, names, pixels, distances_m = (list(column) for column in columns)
        return FalseAlarms(
            self._images,
            self._asked,
            np.array(scores, np.float64),
            np.array(names, np.str_),
            np.array(pixels, np.float64),
            np.array(distances_m, np.float64),
        )

    def scores(self) -> NDArray[np.float64]:
        """Scores of all detections so far."""
        return np.array(self._scores, np.float64)


def area(box: Box) -> float:
    """Pixels of a box."""
    x0, y0, x1, y1 = box
    return float(x1 - x0) * float(y1 - y0)


def depth_in(box: Box, depth_m: NDArray[np.float32] | None) -> float:
    """Median of the known depths [h, w] in a box; NaN without any."""
    if depth_m is None:
        return math.nan
    x0, y0, x1, y1 = (max(0, round(float(v))) for v in box)
    inside = depth_m[y0:y1, x0:x1]
    known = inside[inside > 0]
    return float(np.median(known)) if len(known) else math.nan


def overlaps(a: Sequence[Box], b: Sequence[Box]) -> NDArray[np.float64]:
    """Intersection over union [n, m] of boxes."""
    A, B = (np.array(boxes, np.float64).reshape(-1, 4) for boxes in (a, b))
    low = np.maximum(A[:, None, :2], B[None, :, :2])
    high = np.minimum(A[:, None, 2:], B[None, :, 2:])
    both = np.prod(np.clip(high - low, 0, None), -1)
    areas = [np.prod(boxes[:, 2:] - boxes[:, :2], -1) for boxes in (A, B)]
    union = areas[0][:, None] + areas[1][None] - both
    return np.divide(both, union, out=np.zeros_like(both), where=union > 0)
