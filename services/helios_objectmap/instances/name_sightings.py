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
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from helios_core.geometry import Matrix
from helios_core.types import AlignedBox, Detection
from helios_core.usual_sizes import agreement
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.camera import offset
from helios_objectmap.fusion.label_image import LabelImage
from helios_objectmap.fusion.viewing_sectors import sector_of
from helios_objectmap.instances.clustering import BITS, voxel_keys
from helios_objectmap.instances.furniture import is_furniture
from helios_objectmap.instances.voxel_entries import (
    NONE,
    Column,
    VoxelEntries,
    check_within,
    moved,
)
from helios_objectmap.instances.voxel_numbers import NO_VOXEL

VOXEL_M = 0.1
WIDTH_PX = 160  # largest width of the image from which voxels are filled
OWN_OVERLAP = 0.5  # shared voxels, of the smaller, from which a detection is of an instance
LEAST_OF_LARGEST = 0.3  # overlap of a detection, as a share of the largest one in its view
MOST_VIEWS = 2048  # about 6 kB each
SURE_NAME = 0.9  # probability of a name from which all evidence counts
_is_furniture = lru_cache(maxsize=4096)(is_furniture)


@dataclass(frozen=True)
class NameErrors:
    """Errors of a detector's names; the defaults are a broad prior.

    `helios calibrate` fits them to a detector (`error_model`).
    """

    hit: float = 0.95  # chance of the right name in a view that names the thing
    mistaken: float = 0.1  # chance that such a view gives the name of another thing
    sides_correlate: float = 0.2  # correlation of the errors of two sides of a thing
    rival: float = 0.02  # prior odds of one other name against the own one


BROAD_PRIOR = NameErrors()


@dataclass(frozen=True)
class NameRates:
    """How often an instance was called by each name, by side."""

    names: tuple[str, ...]
    rate: NDArray[np.float64]  # [sides, names] share of the side's views that gave the name
    weight: NDArray[np.float64]  # [sides] in (0, 1]

    def probability(
        self,
        own: str,
        errors: NameErrors = BROAD_PRIOR,
        prior: Callable[[str], float] = lambda _: 1.0,
    ) -> float:
        """Probability that the own name is right, against all others, each on its own. prior:
        factor of the prior odds of another name."""
        if not len(self.weight):
            return 1.0
        hit, mistaken = errors.hit, errors.mistaken
        total = float(self.weight.sum())
        independent = 1 / (1 + errors.sides_correlate * max(total - 1, 0.0))
        named, unnamed = math.log(hit / mistaken), math.log((1 - hit) / (1 - mistaken))
        support = self.weight @ (unnamed + self.rate * (named - unnamed)) * independent
        mine = (
            float(support[self.names.index(own)])
            if own in self.names
            else (total * unnamed * independent)
        )
        others = [(n, s) for n, s in zip(self.names, support, strict=True) if n != own]
        odds = sum(errors.rival * prior(n) * math.exp(min(s - mine, 50.0)) for n, s in others)
        return 1 / (1 + odds)


def evidence_share(own_name: float) -> float:
    """Share in [0, 1] of the evidence for a class that counts where its name has the probability
    own_name in [0, 1] against all others.

    All counts from SURE_NAME on. Below, the share is in proportion to the odds of the name.
    """
    odds, sure = own_name / max(1 - own_name, 1e-9), SURE_NAME / (1 - SURE_NAME)
    return min(1.0, odds / sure)


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


class NameSightings:
    """Detections of the latest views, with the voxels that they fill."""

    def __init__(self, most_views: int = MOST_VIEWS) -> None:
        """most_views: beyond, the older half is dropped."""
        self._most_views = most_views
        self._clear()

    def _clear(self) -> None:
        self._names: dict[str, int] = {}  # name -> its number
        self._furniture: list[bool] = []  # of each name
        self._eye_m: list[NDArray[np.float64]] = []  # of each view
        self._entries = VoxelEntries(VOXEL_M, ["detection"])
        self._name, self._view, self._size = Column(), Column(), Column()  # of each detection

    def __len__(self) -> int:
        """Number of views."""
        return len(self._eye_m)

    def note(self, reading: LabelImage, stride: int, detections: Iterable[Detection]) -> None:
        """Add the detections of a view. stride: that of the reading, in pixels of the masks."""
        if len(self) == self._most_views:
            self._forget_views(self._most_views // 2)
        coarse = max(1, -(-reading.view.width // WIDTH_PX))
        first = offset(stride) + stride * offset(coarse)
        depth_m = reading.depth_m[offset(coarse) :: coarse, offset(coarse) :: coarse]
        measured = depth_m > 0
        points = reading.view.strided(coarse).lift(depth_m, measured)
        voxel = np.full(depth_m.shape, NO_VOXEL, np.int32)
        voxel[measured] = self._entries.numbers(points)
        self._eye_m.append(reading.view.T_world_cam[:3, 3])
        stamps = np.full(len(self._entries.voxels), -1, np.int32)
        filled = np.empty(voxel.size, np.int32)
        for k, d in enumerate(detections):
            box = np.array(d.box_xyxy, np.int64)
            n = filled_kernel(d.mask, box, first, stride * coarse, voxel, stamps, k, filled)
            if not n:
                continue
            self._entries.add(filled[:n], np.full(n, len(self._name.values), np.int32))
            self._name.append([self._number_of(d.class_name)])
            self._view.append([len(self) - 1])
            self._size.append([n])

    def forget_at(self, points: NDArray[np.float32]) -> None:
        """Drop what was detected in the voxels of points [n, 3], where a thing was taken away."""
        self._entries.forget_at(points)

    def arrays(self) -> dict[str, NDArray]:
        """Copies of all views and detections."""
        return {
            "names": np.array(list(self._names), np.str_),
            "name": self._name.values.copy(),
            "view": self._view.values.copy(),
            "size": self._size.values.copy(),
            "eye_m": np.array(self._eye_m).reshape(-1, 3),
        } | self._entries.arrays()

    def add_arrays(self, arrays: Mapping[str, NDArray], T_here_there: Matrix | None = None) -> None:
        """Add views that `arrays` returned. T_here_there: their place in this frame; None: the same
        frame. Raises ValueError for inconsistent arrays, and then nothing may be used."""
        names = [str(name) for name in arrays["names"]]
        name, view, size = (arrays[key].astype(np.int32) for key in ("name", "view", "size"))
        eyes_m = arrays["eye_m"].astype(np.float64).reshape(-1, 3)
        if name.shape != view.shape or name.shape != size.shape or not np.isfinite(eyes_m).all():
            raise ValueError("detections have no names, views or sizes")
        if (np.diff(view) < 0).any() or size.min(initial=1) < 1:
            raise ValueError("detections are not in the order of their views, or are empty")
        check_within(name, len(names))
        check_within(view, len(eyes_m))
        check_within(arrays["detection"], len(name))
        first, start = len(self._name.values), len(self._entries)
        self._entries.add_arrays(arrays, first, T_here_there)
        filled = arrays["detection"][arrays["voxel"] != NO_VOXEL]
        added = self._entries.columns["detection"].values[start:] - first
        merged = np.bincount(filled, minlength=len(name)) - np.bincount(added, minlength=len(name))
        numbers = np.array([self._number_of(n) for n in names], np.int32)
        self._name.append(numbers[name])
        self._view.append(view + len(self))
        self._size.append(np.maximum(size - merged, 1))
        self._eye_m.extend(moved(eyes_m, T_here_there))
        if len(self) > self._most_views:
            self._forget_views(len(self) - self._most_views)

    def add_earlier(self, arrays: Mapping[str, NDArray], T_here_there: Matrix | None) -> None:
        """Add views before the present ones, which stay longest. As `add_arrays`."""
        present = self.arrays()
        self._clear()
        self.add_arrays(arrays, T_here_there)
        self.add_arrays(present)

    def _number_of(self, name: str) -> int:
        if name not in self._names:
            self._names[name] = len(self._names)
            self._furniture.append(_is_furniture(name))
        return self._names[name]

    def _forget_views(self, count: int) -> None:
        """Drop the oldest views and their detections, and the voxels that have no more."""
        gone = int(np.searchsorted(self._view.values, count))
        self._entries = self._entries.without(gone)
        for name in ("_name", "_view", "_size"):
            setattr(self, name, Column(getattr(self, name).values[gone:]))
        self._view.values[:] -= count
        del self._eye_m[:count]

    def rates(
        self,
        points: NDArray[np.float32],
        rows: NDArray[np.integer],
        class_name: str,
        side_views: float,
    ) -> NameRates | None:
        """Names of the instance that has the rows [n] of points [., 3]; None if nothing was
        detected there.

        Furniture is compared with furniture only, and other things with other things.
        """
        keys, center_m = voxels_and_mean(points, rows)
        named = self.named(keys, class_name)
        return None if named is None else named.rates(center_m, side_views)

    def probability_in(
        self,
        class_name: str,
        box: AlignedBox,
        side_views: float,
        errors: NameErrors,
    ) -> float:
        """Probability that the thing in a box is of a class, against the other names that it was
        called by and that fit its size; 0.5 if nothing was detected there."""
        center_m, size_m = box
        keys = keys_in_box(center_m, size_m)
        keys = keys[self._entries.filled(keys)]
        named = self.named(keys, class_name) if len(keys) else None
        if named is None:
            return 0.5
        extents_m = np.array([max(size_m[:2]), min(size_m[:2]), size_m[2]])
        return named.rates(center_m, side_views).probability(
            class_name, errors, lambda other: agreement(other, extents_m, 0.0)
        )

    def named(self, keys: NDArray[np.integer], class_name: str) -> NamedViews | None:
        """Views that named the instance with these voxels [n] (keys, which may repeat); None
        without one."""
        entries = self._entries
        voxels = entries.voxels.of_keys(keys)
        entries.newest.resize(len(entries.voxels), NONE)
        overlap = np.zeros(len(self._name.values), np.int32)
        ids = np.empty(len(overlap), np.int32)
        stamps = np.zeros(len(entries.voxels), np.bool_)
        n_voxels, n = overlap_kernel(
            voxels,
            stamps,
            entries.newest.values,
            entries.before.values,
            entries.columns["detection"].values,
            overlap,
            ids,
        )
        ids = np.sort(ids[:n])
        alike = np.array(self._furniture, np.bool_) == _is_furniture(class_name)
        views, of_view, of_name = (np.empty(n, np.int32) for _ in range(3))
        n_views, n_given = naming_kernel(
            ids, overlap, n_voxels, self._size.values, self._name.values, self._view.values, alike,
            OWN_OVERLAP, LEAST_OF_LARGEST, views, of_view, of_name,
        )  # fmt: skip
        if not n_views:
            return None
        numbers, of_number = np.unique(of_name[:n_given], return_inverse=True)
        given = np.zeros((n_views, len(numbers)), bool)
        given[of_view[:n_given], of_number] = True
        names = list(self._names)
        eyes_m = np.stack([self._eye_m[k] for k in views[:n_views].tolist()])
        return NamedViews(tuple(names[k] for k in numbers), given, eyes_m)

    def table(self) -> SightingTable:
        """All detections with their voxels."""
        entries = self._entries
        kept = entries.voxel.values != NO_VOXEL
        filled, voxel = np.unique(entries.voxel.values[kept], return_inverse=True)
        order = np.argsort(voxel, kind="stable")
        return SightingTable(
            tuple(self._names),
            self._name.values.copy(),
            voxel[order],
            entries.columns["detection"].values[kept][order],
            entries.voxels.keys[filled],
        )


def keys_in_box(center_m: NDArray[np.float64], size_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """Keys [n] of the voxels that a box along the axes touches; center_m, size_m: [3]."""
    low, high = (np.floor((center_m + s * size_m / 2) / VOXEL_M).astype(int) for s in (-1, 1))
    cells = np.stack(np.meshgrid(*map(np.arange, low, high + 1), indexing="ij"), -1).reshape(-1, 3)
    return voxel_keys(((cells + 0.5) * VOXEL_M).astype(np.float32), VOXEL_M)


def voxels_and_mean(
    points: NDArray[np.float32], rows: NDArray[np.integer]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Voxel keys [n] and mean [3] of the rows [n] of points [., 3].

    Equals `voxel_keys(points[rows], VOXEL_M)` and `points[rows].mean(axis=0)` bit by bit.
    """
    keys, total = np.empty(len(rows), np.int64), np.zeros(3, np.float32)
    gathered_kernel(points, rows, VOXEL_M, BITS, keys, total)
    return keys, (total / np.float64(len(rows))).astype(np.float32)


@njit(cache=True, nogil=True)
def gathered_kernel(points, rows, voxel_m, bits, keys, total):
    """Fill keys [n] like `clustering.voxel_keys_kernel`; add the points, one after the other, to
    total [3]."""
    half = np.int64(1) << (bits - 1)
    for k in range(rows.size):
        key = np.int64(0)
        for axis in range(3):
            at = points[rows[k], axis]
            total[axis] += at
            key = (key << bits) | (np.int64(np.floor(np.float64(at) / voxel_m)) + half)
        keys[k] = key


@njit(cache=True, nogil=True)
def filled_kernel(mask, box, first, step, voxel, stamps, stamp, filled):
    """List in `filled` the voxels of the pixels of a mask, each once; returns their number.

    mask: [height, width]; box: [4] first and end pixel of the mask, x, y, x, y; voxel: [h, w]
    number at pixel (first + step * row, first + step * column), NO_VOXEL for none; stamps:
    [voxels], where no voxel has the value `stamp` yet.
    """
    n = 0
    first_row, first_column = max(box[1] - first, 0) // step, max(box[0] - first, 0) // step
    end_row = min(voxel.shape[0], (min(box[3], mask.shape[0]) - first + step - 1) // step)
    end_column = min(voxel.shape[1], (min(box[2], mask.shape[1]) - first + step - 1) // step)
    for row in range(first_row, end_row):
        for column in range(first_column, end_column):
            if mask[first + step * row, first + step * column]:
                v = voxel[row, column]
                if v != NO_VOXEL and stamps[v] != stamp:
                    stamps[v] = stamp
                    filled[n] = v
                    n += 1
    return n


@njit(cache=True, nogil=True)
def overlap_kernel(voxels, stamps, newest, before, detection, overlap, ids):
    """Add to overlap [detections] the distinct voxels among `voxels` that each detection fills.

    stamps: [voxels], all False. Lists in `ids` the detections with an overlap. Returns the number
    of distinct voxels, and that of detections.
    """
    n_voxels, n = 0, 0
    for k in range(voxels.size):
        v = voxels[k]
        if stamps[v]:
            continue
        stamps[v] = True
        n_voxels += 1
        entry = newest[v]
        while entry != NONE:
            d = detection[entry]
            if overlap[d] == 0:
                ids[n] = d
                n += 1
            overlap[d] += 1
            entry = before[entry]
    return n_voxels, n


@njit(cache=True, nogil=True)
def naming_kernel(
    ids, overlap, n_voxels, size, name, view, alike, own_overlap, least_of_largest, views, of_view,
    of_name,
):  # fmt: skip
    """Views that named an instance of n_voxels voxels, and the names that they gave.

    ids: [n] detections in rising order, view by view; alike: [names]. A detection counts if its
    name is alike, it overlaps with the share own_overlap of the smaller one's voxels, and with
    least_of_largest of the largest overlap in its view. Fills views with their numbers, and of_view
    (index into views) and of_name for each detection that counts. Returns both numbers.
    """
    n_views, n_given, k = 0, 0, 0
    while k < ids.size:
        number, end, largest = view[ids[k]], k, 0
        while end < ids.size and view[ids[end]] == number:
            d = ids[end]
            if alike[name[d]] and overlap[d] >= own_overlap * min(size[d], n_voxels):
                largest = max(largest, overlap[d])
            end += 1
        if largest > 0:
            for i in range(k, end):
                d = ids[i]
                if (
                    alike[name[d]]
                    and overlap[d] >= own_overlap * min(size[d], n_voxels)
                    and overlap[d] >= least_of_largest * largest
                ):
                    of_view[n_given], of_name[n_given] = n_views, name[d]
                    n_given += 1
            views[n_views] = number
            n_views += 1
        k = end
    return n_views, n_given
