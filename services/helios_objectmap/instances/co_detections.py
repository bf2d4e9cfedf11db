"""Neighbouring voxels that detections tell apart: two things side by side stay two instances.

This is not in the paper, where Gaussians of one class that are near form one instance. A false
detection of a bed beside a table would then swallow the table. Here two neighbouring voxels belong
together only if

- most views that show both and detect one of them as the class cover both with one detection, and
- these are not few beside the views that detect either of them.

The order of the views does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from helios_core.types import Detection
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.camera import offset
from helios_objectmap.fusion.label_image import LabelImage
from helios_objectmap.instances.clustering import PRECEDING, STEPS, distinct, voxel_keys
from helios_objectmap.instances.voxel_numbers import NO_VOXEL, VoxelNumbers

SHARED_FROM = 0.5  # share of the views that show both voxels
OFTEN_FROM = 0.3  # share of the views that detect the voxel that is detected more seldom
WIDTH_PX = 160  # largest width of the image from which voxels are filled
# A detection covers a voxel from this share of its pixels on, and from this share of those of the
# detection that has most of them.
COVERED, OF_MOST = 0.1, 0.5
MOST_DETECTIONS = 63  # of one class in one view

Pairs = NDArray[np.bool_]  # [voxels, 13] for each voxel and each neighbour that precedes it


class CoDetections:
    """Pairs of neighbouring voxels of one class, with the views that detected them."""

    def __init__(self, voxel_m: float) -> None:
        self.voxel_m = voxel_m
        self._numbers = VoxelNumbers()
        self._views = np.zeros(0, np.int32)  # views that detected the voxel
        pairs = (0, len(PRECEDING))
        self._shown = np.zeros(pairs, np.int32)  # views that showed both and detected one
        self._together = np.zeros(pairs, np.int32)  # of these, in one detection
        self._apart: Pairs = np.zeros(pairs, np.bool_)

    def note(
        self, reading: LabelImage, stride: int, detections: Sequence[Detection]
    ) -> NDArray[np.integer]:
        """Add the detections of the class in a view. Returns the keys of voxels with a neighbour
        that is apart now and was not before, or the reverse. stride: that of the reading, in pixels
        of the masks."""
        coarse = max(1, -(-reading.view.width // WIDTH_PX))
        pixel = (slice(offset(coarse), None, coarse),) * 2
        depth_m = reading.depth_m[pixel]
        seen = depth_m > 0
        if not seen.any():
            return np.empty(0, np.int64)
        points = reading.view.strided(coarse).lift(depth_m, seen)
        keys, of_point = distinct(voxel_keys(points, self.voxel_m))
        first = offset(stride) + stride * offset(coarse)
        mask_pixel = (slice(first, None, stride * coarse),) * 2
        inside = np.array(
            [
                np.bincount(of_point, d.mask[mask_pixel][seen], len(keys))
                for d in detections[:MOST_DETECTIONS]
            ]
        ).reshape(-1, len(keys))
        pixels = np.bincount(of_point, minlength=len(keys))
        covers = inside >= np.maximum(COVERED * pixels, OF_MOST * inside.max(axis=0, initial=0.0))
        bits = np.left_shift(np.uint64(1), np.arange(len(inside), dtype=np.uint64))
        return self.count(keys, bits @ (covers & (inside > 0)).astype(np.uint64))

    def count(self, keys: NDArray[np.integer], covering: NDArray[np.uint64]) -> NDArray[np.integer]:
        """Add a view that shows some voxels; returns the same as `note`. keys: [n], distinct, in
        rising order; covering: [n] one bit for each detection that covers the voxel."""
        covered = keys[covering != 0]
        near = np.isin(keys, covered[:, None] + STEPS) | (covering != 0)
        keys, covering = keys[near], covering[near]  # pairs of other voxels do not count
        rows = self._rows_of(keys)
        count_kernel(keys, covering, PRECEDING, rows, self._views, self._shown, self._together)
        mine = covering != 0
        around = keys[mine, None] + STEPS
        beside = self._numbers.known(around.ravel()).reshape(around.shape)
        changed = part_kernel(
            rows[mine],
            beside,
            SHARED_FROM,
            OFTEN_FROM,
            self._views,
            self._shown,
            self._together,
            self._apart,
        )
        return np.union1d(keys[mine][changed.any(axis=1)], around[changed])

    def keep_apart(self, keys: NDArray[np.integer], labels: NDArray[np.integer]) -> None:
        """Make neighbouring voxels with different labels apart, as after one view of each. keys:
        [n], distinct, in rising order; labels: [n]."""
        for label in np.unique(labels):
            of_label = labels == label
            self.count(keys[of_label], np.ones(int(of_label.sum()), np.uint64))

    def apart(self, keys: NDArray[np.integer]) -> Pairs:
        """Which of its 13 preceding neighbours each voxel [n] is kept apart from."""
        rows = self._rows_of(keys)
        return self._apart[rows]

    def _rows_of(self, keys: NDArray[np.integer]) -> NDArray[np.int32]:
        """Rows [n] of the arrays; new voxels get new ones."""
        rows = self._numbers.of_keys(keys)
        lacking = len(self._numbers) - len(self._views)
        if lacking > 0:
            more = max(lacking, len(self._views), 256)
            for name in ("_views", "_shown", "_together", "_apart"):
                old = getattr(self, name)
                new = np.zeros((more, *old.shape[1:]), old.dtype)
                setattr(self, name, np.concatenate([old, new]))
        return rows


@njit(cache=True, nogil=True)
def count_kernel(keys, covering, deltas, rows, views, shown, together):
    """Count a view for its voxels keys [n], in rising order, and all pairs of neighbours among
    them. covering: [n] one bit for each detection; rows: [n] of views [.], shown and together
    [., 13]."""
    for i in range(keys.size):
        if covering[i] != 0:
            views[rows[i]] += 1
        for d in range(deltas.size):
            j = np.searchsorted(keys, keys[i] + deltas[d])
            if j >= keys.size or keys[j] != keys[i] + deltas[d]:
                continue
            if covering[i] == 0 and covering[j] == 0:
                continue
            shown[rows[i], d] += 1
            if covering[i] & covering[j] != 0:
                together[rows[i], d] += 1


@njit(cache=True, nogil=True)
def part_kernel(rows, beside, shared_from, often_from, views, shown, together, apart):
    """Decide anew which pairs of voxels rows [n] and their 26 neighbours beside [n, 26], NO_VOXEL
    for none, are apart. Returns where that changes, [n, 26]."""
    changed = np.zeros(beside.shape, np.bool_)
    for i in range(rows.size):
        for k in range(beside.shape[1]):
            other = beside[i, k]
            if other == NO_VOXEL:
                continue
            d = k % apart.shape[1]
            later = rows[i] if k < apart.shape[1] else other
            both = together[later, d]
            seldom = min(views[rows[i]], views[other])
            now = both < shared_from * shown[later, d] or both < often_from * seldom
            if now != apart[later, d]:
                apart[later, d] = now
                changed[i, k] = True
    return changed
