"""Instances: 26-connected voxels of Gaussians of one class (appendix, instance creation).

The paper's 20 rounds of min-pooling bound the size of an object; a union-find gives the same
partition without a bound. Gaussians closer than a voxel are always joined, Gaussians farther apart
than two voxels along an axis never: two mugs 0.3 m apart need voxels of at most 7 cm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.kernels.components import components_kernel, voxel_keys_kernel
from helios_objectmap.store.gaussians import NO_INSTANCE

BITS = 21  # of a key for each axis
_PRECEDING = np.array(
    [
        (dx << (2 * BITS)) + (dy << BITS) + dz
        for dx in (-1, 0, 1)
        for dy in (-1, 0, 1)
        for dz in (-1, 0, 1)
        if (dx, dy, dz) < (0, 0, 0)
    ],
    np.int64,
)
# Steps to the 26 neighbours of a voxel: 13 come before it in the order of keys, 13 after.
NEIGHBOURS: tuple[int, ...] = (*_PRECEDING.tolist(), *(-_PRECEDING).tolist())


def voxel_keys(points: NDArray[np.float32], voxel_m: float) -> NDArray[np.int64]:
    """One integer per point [n, 3]: its voxel. The map reaches 2^20 voxels from the origin."""
    keys = np.empty(len(points), np.int64)
    voxel_keys_kernel(points, voxel_m, BITS, keys)
    return keys


def connected(voxels: NDArray[np.integer]) -> NDArray[np.int64]:
    """Number of the connected component of each voxel [n], 0, 1, ... without gaps.

    voxels: distinct keys in rising order. Components are numbered by their first voxel.
    """
    parent = np.empty(len(voxels), np.int64)
    components_kernel(voxels, _PRECEDING, parent)
    return np.unique(parent, return_inverse=True)[1]


def components(points: NDArray[np.float32], voxel_m: float) -> NDArray[np.int64]:
    """Number of the connected component of each point [n], 0, 1, ... without gaps."""
    voxels, of_point = distinct(voxel_keys(points, voxel_m))
    return connected(voxels)[of_point]


def relabel(
    component: NDArray[np.int64],
    former: NDArray[np.int32],
    count: NDArray[np.int64],
    next_label: int,
) -> tuple[NDArray[np.int32], int]:
    """Stable labels for components: [n] labels, and the next free label.

    The n are points, or voxels of points. former: [n] label so far, NO_INSTANCE for none; count:
    [n] points that have it. A component that holds the larger part of a former instance is its
    heir; of several inheritances it takes the smallest label, so a merge keeps the smaller one and
    in a split the larger part keeps it. Others get new labels.
    """
    n_components = int(component.max(initial=-1)) + 1
    label_of = np.zeros(n_components, np.int32)
    known = former != NO_INSTANCE
    pair, of_pair = distinct((former[known].astype(np.int64) << 32) | component[known])
    labels, parts = pair >> 32, pair & 0xFFFFFFFF
    counts = np.bincount(of_pair, count[known], len(pair))
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


def distinct(values: NDArray[np.integer]) -> tuple[NDArray[np.integer], NDArray[np.intp]]:
    """The distinct values [n] in rising order, and which of them each one is.

    As `numpy.unique`, but neighbours in the store are neighbours in space: only the starts of runs
    of equal values are sorted.
    """
    starts = np.flatnonzero(np.diff(values, prepend=values[:1] - 1))
    found, of_run = np.unique(values[starts], return_inverse=True)
    return found, np.repeat(of_run, np.diff(starts, append=len(values)))
