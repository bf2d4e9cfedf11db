"""Collision boxes of a mesh: its voxels, merged into few boxes that are shrunk to the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from helios_sim.assets.surface_sampling import sample

_COARSER = 1.3
_MIN_HALF_M = 0.004
# Axis orders in which a box grows; the largest resulting box is used.
_ORDERS = ((0, 1, 2), (2, 1, 0), (1, 0, 2), (0, 2, 1))


def merged_boxes(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], pitch_m: float, at_most: int
) -> NDArray[np.float64]:
    """Boxes [n, 6] (centre, half extents; metres) that cover a surface and its enclosed volume.

    Voxels of `pitch_m` are merged greedily; the pitch grows by 1.3 until `at_most` boxes suffice.
    A box ends where the surface in its voxels ends.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    while True:
        points = sample(vertices, faces, pitch_m / 2.5).points
        dims = np.maximum(np.ceil((high - low) / pitch_m - 1e-6).astype(int), 1)
        cell = np.maximum((high - low) / dims, 1e-9)
        index = np.clip(((points - low) / cell).astype(int), 0, dims - 1)
        shell = np.zeros(dims, bool)
        shell[tuple(index.T)] = True
        filled = np.asarray(ndimage.binary_fill_holes(shell), bool)
        spans = _merge(filled, at_most)
        if spans is not None:
            break
        pitch_m *= _COARSER
    # Occupied extent of each voxel: that of its samples on the surface, the full voxel inside.
    grid = np.stack(np.meshgrid(*(np.arange(d) for d in dims), indexing="ij"), axis=-1)
    lows, highs = low + grid * cell, low + (grid + 1) * cell
    lows[shell], highs[shell] = np.inf, -np.inf
    np.minimum.at(lows, tuple(index.T), points)
    np.maximum.at(highs, tuple(index.T), points)
    boxes = []
    for start, end in spans:
        part = tuple(slice(a, b) for a, b in zip(start, end, strict=True))
        a, b = lows[part].min(axis=(0, 1, 2)), highs[part].max(axis=(0, 1, 2))
        boxes.append(np.concatenate([(a + b) / 2, np.maximum((b - a) / 2, _MIN_HALF_M)]))
    return np.array(boxes)


def _merge(
    filled: NDArray[np.bool_], at_most: int
) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]] | None:
    """Disjoint spans [start, end) of voxels that cover the filled ones; None if too many."""
    free, spans = filled.copy(), []
    for first in np.argwhere(filled):
        if not free[tuple(first)]:
            continue
        if len(spans) == at_most:
            return None
        start, end = max((_grown(free, first, o) for o in _ORDERS), key=_volume)
        free[tuple(slice(a, b) for a, b in zip(start, end, strict=True))] = False
        spans.append((start, end))
    return spans


def _grown(
    free: NDArray[np.bool_], first: NDArray[np.int64], order: tuple[int, int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    end = first + 1
    for axis in order:
        while end[axis] < free.shape[axis]:
            layer = [slice(a, b) for a, b in zip(first, end, strict=True)]
            layer[axis] = slice(end[axis], end[axis] + 1)
            if not free[tuple(layer)].all():
                break
            end[axis] += 1
    return first, end


def _volume(span: tuple[NDArray[np.int64], NDArray[np.int64]]) -> int:
    return int(np.prod(span[1] - span[0]))


def levelled(
    boxes: NDArray[np.float64], surfaces: NDArray[np.float64], slab_m: float = 0.02
) -> NDArray[np.float64]:
    """Boxes [n, 6] without any volume above the surfaces [k, 5], and a flat slab under each.

    Parts of voxels above a surface are cut off, because the model is empty there.
    """
    for x, y, half_x, half_y, height in surfaces:
        low = np.array([x - half_x, y - half_y, height])
        high = np.array([x + half_x, y + half_y, np.inf])
        boxes = np.concatenate([_cut(box, low, high) for box in boxes])
        slab = [x, y, height - slab_m / 2, half_x, half_y, slab_m / 2]
        boxes = np.concatenate([boxes, [slab]])
    return boxes


def _cut(
    box: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Remainder of a box outside a region, as disjoint boxes [k, 6]."""
    a, b = box[:3] - box[3:], box[:3] + box[3:]
    if (np.minimum(b, high) - np.maximum(a, low) <= 1e-4).any():
        return box[None]
    left = []
    for axis in (2, 0, 1):
        if a[axis] < low[axis]:
            end = b.copy()
            end[axis] = low[axis]
            left.append((a.copy(), end))
            a[axis] = low[axis]
        if b[axis] > high[axis]:
            start = a.copy()
            start[axis] = high[axis]
            left.append((start, b.copy()))
            b[axis] = high[axis]
    rows = [np.concatenate([(p + q) / 2, (q - p) / 2]) for p, q in left]
    return np.array([row for row in rows if row[3:].min() > 5e-4]).reshape(-1, 6)
