"""Instances: 26-connected voxels of Gaussians of one class (appendix, instance creation).

The paper's 20 rounds of min-pooling bound the size of an object; a union-find gives the same
partition without a bound. Gaussians closer than a voxel are always joined, Gaussians farther apart
than two voxels along an axis never: two mugs 0.3 m apart need voxels of at most 7 cm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.gaussians import NO_INSTANCE
from helios_objectmap.kernels.components import components_kernel

_BITS = 21
_HALF = 1 << (_BITS - 1)
# The 13 neighbours of a voxel that come before it in the order of keys; the other 13 come after.
_PRECEDING = np.array(
    [
        (dx << (2 * _BITS)) + (dy << _BITS) + dz
        for dx in (-1, 0, 1)
        for dy in (-1, 0, 1)
        for dz in (-1, 0, 1)
        if (dx, dy, dz) < (0, 0, 0)
    ],
    np.int64,
)


def voxel_keys(points: NDArray[np.float32], voxel_m: float) -> NDArray[np.int64]:
    """One integer per point [n, 3]: its voxel. The map reaches 2^20 voxels from the origin."""
    ijk = np.floor(points.astype(np.float64) / voxel_m).astype(np.int64) + _HALF
    return (ijk[:, 0] << (2 * _BITS)) | (ijk[:, 1] << _BITS) | ijk[:, 2]


def touching(
    points: NDArray[np.float32], others: NDArray[np.float32], voxel_m: float
) -> NDArray[np.bool_]:
    """Whether each point [n, 3] is in the voxel of one of the others [k, 3] or in one beside it."""
    steps = np.concatenate([-_PRECEDING, [0], _PRECEDING])
    around = np.unique(distinct(voxel_keys(others, voxel_m))[0][:, None] + steps)
    return np.isin(voxel_keys(points, voxel_m), around)


def components(points: NDArray[np.float32], voxel_m: float) -> NDArray[np.int64]:
    """Number of the connected component of each point [n], 0, 1, ... without gaps."""
    voxels, of_point = distinct(voxel_keys(points, voxel_m))
    parent = np.empty(len(voxels), np.int64)
    components_kernel(voxels, _PRECEDING, parent)
    _, of_voxel = np.unique(parent, return_inverse=True)
    return of_voxel[of_point]


def relabel(
    component: NDArray[np.int64], former: NDArray[np.int32], next_label: int
) -> tuple[NDArray[np.int32], int]:
    """Stable labels for components: [n] labels, and the next free label.

    former: [n] label of each point so far, NO_INSTANCE for none. A component that holds the larger
    part of a former instance is its heir; of several inheritances it takes the smallest label, so
    a merge keeps the smaller one and in a split the larger part keeps it. Others get new labels.
    """
    n_components = int(component.max(initial=-1)) + 1
    label_of = np.zeros(n_components, np.int32)
    known = former != NO_INSTANCE
    labels, parts, counts = count_pairs(former[known], component[known])
    # Most points first; between equal parts the component with the smaller number.
    by_size = np.lexsort((parts, -counts, labels))
    heirs: set[int] = set()
    for label, part in zip(labels[by_size].tolist(), parts[by_size].tolist(), strict=True):
        if label not in heirs:
            heirs.add(label)
            if label_of[part] == 0:  # labels come in rising order: the first one is the smallest
                label_of[part] = label
    for part in np.flatnonzero(label_of == 0):
        label_of[part] = next_label
        next_label += 1
    return label_of[component], next_label


def count_pairs(
    a: NDArray[np.integer], b: NDArray[np.integer]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Distinct pairs (a, b) of numbers from 0 to 2^31 - 1, and how often each occurs."""
    key, of_pair = distinct((a.astype(np.int64) << 32) | b)
    return key >> 32, key & 0xFFFFFFFF, np.bincount(of_pair, minlength=len(key))


def distinct(values: NDArray[np.integer]) -> tuple[NDArray[np.integer], NDArray[np.intp]]:
    """The distinct values [n] in rising order, and which of them each one is.

    As `numpy.unique`, but neighbours in the store are neighbours in space: only the starts of runs
    of equal values are sorted.
    """
    starts = np.flatnonzero(np.diff(values, prepend=values[:1] - 1))
    found, of_run = np.unique(values[starts], return_inverse=True)
    return found, np.repeat(of_run, np.diff(starts, append=len(values)))
