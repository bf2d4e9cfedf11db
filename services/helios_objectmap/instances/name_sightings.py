"""Names that the detector gave to places: they tell look-alikes apart.

A detector that sometimes calls a glass a mug calls it a glass more often. The map paints one class
per pixel and knows only the task's classes. Here every detection counts under its own name. It
fills the voxels of its mask, and an instance collects the detections that share its voxels.

Views from one side repeat their errors. So the views of one viewing sector count as one side, in
full from `side_views` views on, and the sides of one thing depend on one another
(`NameErrors.sides_correlate`).
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from helios_core.types import Detection
from numpy.typing import NDArray

from helios_objectmap.camera import offset
from helios_objectmap.fusion.label_image import LabelImage
from helios_objectmap.fusion.viewing_sectors import sector_of
from helios_objectmap.instances.clustering import distinct, voxel_keys
from helios_objectmap.instances.furniture import is_furniture

VOXEL_M = 0.1
WIDTH_PX = 160  # largest width of the image from which voxels are filled
OWN_OVERLAP = 0.5  # shared voxels, of the smaller, from which a detection is of an instance
LEAST_OF_LARGEST = 0.3  # overlap of a detection, as a share of the largest one in its view
MOST_VIEWS = 2048  # about 6 kB each
_is_furniture = lru_cache(maxsize=4096)(is_furniture)


@dataclass(frozen=True)
class NameErrors:
    """Errors of a detector's names; the defaults are a broad prior.

    `helios calibrate` fits them to a detector (`error_model`).
    """

    hit: float = 0.95  # chance of the right name in a view that names the thing
    mistaken: float = 0.1  # the same of a wrong name; only its odds against those of `hit` count
    sides_correlate: float = 0.2  # correlation of the errors of two sides of a thing
    rival: float = 0.02  # prior odds of one other name against the own one


BROAD_PRIOR = NameErrors()


@dataclass(frozen=True)
class NameRates:
    """How often an instance was called by each name, by side."""

    names: tuple[str, ...]
    rate: NDArray[np.float64]  # [sides, names] share of the side's views that gave the name
    weight: NDArray[np.float64]  # [sides] in (0, 1]

    def probability(self, own: str, errors: NameErrors = BROAD_PRIOR) -> float:
        """Probability that the own name is right, against all others, each on its own."""
        if not len(self.weight):
            return 1.0
        hit, mistaken = errors.hit, errors.mistaken
        total = float(self.weight.sum())
        independent = 1 / (1 + errors.sides_correlate * max(total - 1, 0.0))
        named, unnamed = math.log(hit / mistaken), math.log((1 - hit) / (1 - mistaken))
        support = self.weight @ (unnamed + self.rate * (named - unnamed)) * independent
        mine = float(support[self.names.index(own)]) if own in self.names else (
            total * unnamed * independent
        )  # fmt: skip
        others = [s for name, s in zip(self.names, support, strict=True) if name != own]
        odds = sum(errors.rival * math.exp(min(s - mine, 50.0)) for s in others)
        return 1 / (1 + odds)


@dataclass(frozen=True)
class NamedViews:
    """Views that gave an instance a name."""

    names: tuple[str, ...]
    given: NDArray[np.bool_]  # [views, names]
    eyes_m: NDArray[np.float64]  # [views, 3] camera, world

    def rates(self, center_m: NDArray[np.floating], side_views: float) -> NameRates:
        """Rates by viewing sector around the instance's centre [3]."""
        sides, of_side = np.unique(sector_of(center_m, self.eyes_m), return_inverse=True)
        count = np.bincount(of_side).astype(float)
        rate = np.zeros((len(sides), len(self.names)))
        np.add.at(rate, of_side, self.given)
        return NameRates(self.names, rate / count[:, None], np.minimum(count / side_views, 1.0))


@dataclass(frozen=True)
class SightingTable:
    """Detections and the voxels that they fill: entry k says that detection `detection[k]` fills
    voxel `voxel[k]`."""

    names: tuple[str, ...]
    name: NDArray[np.int32]  # [detections] index of its name
    voxel: NDArray[np.int64]  # [entries] index of the voxel
    detection: NDArray[np.int32]  # [entries]
    keys: NDArray[np.int64]  # [voxels] voxel keys


class _Column:
    """Growing array of integers."""

    def __init__(self) -> None:
        self._values, self._n = np.empty(1024, np.int32), 0

    def append(self, value: int) -> None:
        if self._n == len(self._values):
            self._values = np.concatenate([self._values, np.empty(1024 + self._n, np.int32)])
        self._values[self._n] = value
        self._n += 1

    def __len__(self) -> int:
        return self._n

    def drop(self, count: int) -> None:
        """Remove the first values."""
        self._values, self._n = self.values[count:].copy(), self._n - count

    @property
    def values(self) -> NDArray[np.int32]:
        return self._values[: self._n]


class NameSightings:
    """Detections of the latest views, with their voxels."""

    def __init__(self, most_views: int = MOST_VIEWS) -> None:
        """most_views: beyond, the older half is dropped."""
        self._most_views = most_views
        self._at: dict[int, array[int]] = {}  # voxel key -> detections
        self._names: dict[str, int] = {}  # name -> its number
        self._name, self._view, self._size = _Column(), _Column(), _Column()  # of each detection
        self._eye_m: list[NDArray[np.float64]] = []  # of each view

    def __len__(self) -> int:
        """Number of views."""
        return len(self._eye_m)

    def note(self, reading: LabelImage, stride: int, detections: Iterable[Detection]) -> None:
        """Add the detections of a view. stride: that of the reading, in pixels of the masks."""
        if len(self._eye_m) == self._most_views:
            self._forget_views(self._most_views // 2)
        coarse = max(1, -(-reading.view.width // WIDTH_PX))
        first = offset(stride) + stride * offset(coarse)
        grid = (slice(first, None, stride * coarse), slice(first, None, stride * coarse))
        depth_m = reading.depth_m[offset(coarse) :: coarse, offset(coarse) :: coarse]
        measured = depth_m > 0
        points = reading.view.strided(coarse).lift(depth_m, measured)
        keys, of_point = distinct(voxel_keys(points, VOXEL_M))
        voxel: NDArray[np.int64] = np.full(depth_m.shape, -1, np.int64)
        voxel[measured] = of_point
        self._eye_m.append(reading.view.T_world_cam[:3, 3])
        for d in detections:
            mine = voxel[d.mask[grid][: voxel.shape[0], : voxel.shape[1]]]
            filled = np.flatnonzero(np.bincount(mine[mine >= 0], minlength=len(keys)))
            if not len(filled):
                continue
            for key in keys[filled].tolist():
                self._at.setdefault(key, array("i")).append(len(self._name))
            self._name.append(self._names.setdefault(d.class_name, len(self._names)))
            self._view.append(len(self._eye_m) - 1)
            self._size.append(len(filled))

    def forget_at(self, points: NDArray[np.float32]) -> None:
        """Drop what was detected in the voxels of points [n, 3], where a thing was taken away."""
        for key in distinct(voxel_keys(points, VOXEL_M))[0].tolist():
            self._at.pop(key, None)

    def _forget_views(self, count: int) -> None:
        """Drop the oldest views and their detections."""
        gone = int(np.searchsorted(self._view.values, count))
        for key, detections in list(self._at.items()):
            kept = np.frombuffer(detections, np.int32)
            kept = kept[kept >= gone] - gone
            if len(kept):
                self._at[key] = array("i", kept.tolist())
            else:
                del self._at[key]
        for column in (self._name, self._view, self._size):
            column.drop(gone)
        self._view.values[:] -= count
        del self._eye_m[:count]

    def rates(
        self, points: NDArray[np.float32], class_name: str, side_views: float
    ) -> NameRates | None:
        """Names of the instance that has these points [n, 3]; None if nothing was detected there.

        Furniture is compared with furniture only, and other things with other things.
        """
        keys = distinct(voxel_keys(points, VOXEL_M))[0]
        named = self.named(keys, class_name)
        return None if named is None else named.rates(points.mean(axis=0), side_views)

    def named(self, keys: NDArray[np.integer], class_name: str) -> NamedViews | None:
        """Views that named the instance with these voxels [n] (distinct keys); None without one."""
        found = [np.frombuffer(self._at[k], np.int32) for k in keys.tolist() if k in self._at]
        if not found:
            return None
        overlap = np.bincount(np.concatenate(found))
        ids = np.flatnonzero(overlap)
        overlap, size = overlap[ids], self._size.values[ids]
        alike = np.array([_is_furniture(n) == _is_furniture(class_name) for n in self._names])
        good = alike[self._name.values[ids]] & (
            overlap >= OWN_OVERLAP * np.minimum(size, len(keys))
        )
        ids, overlap = ids[good], overlap[good]
        if not len(ids):
            return None
        views, of_view = np.unique(self._view.values[ids], return_inverse=True)
        largest = np.zeros(len(views))
        np.maximum.at(largest, of_view, overlap)
        good = overlap >= LEAST_OF_LARGEST * largest[of_view]
        numbers, of_name = np.unique(self._name.values[ids[good]], return_inverse=True)
        given = np.zeros((len(views), len(numbers)), bool)
        given[of_view[good], of_name] = True
        names = list(self._names)
        eyes_m = np.stack([self._eye_m[k] for k in views])
        return NamedViews(tuple(names[k] for k in numbers), given, eyes_m)

    def table(self) -> SightingTable:
        """All detections with their voxels."""
        keys = np.fromiter(self._at, np.int64, len(self._at))
        lists = [np.frombuffer(a, np.int32) for a in self._at.values()]
        return SightingTable(
            tuple(self._names),
            self._name.values.copy(),
            np.repeat(np.arange(len(keys)), [len(a) for a in lists]),
            np.concatenate([*lists, np.empty(0, np.int32)]),
            keys,
        )
