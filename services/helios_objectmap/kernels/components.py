"""Voxels of points, and connected ones: a union-find over sorted keys."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def components_kernel(keys, deltas, parent):
    """26-connected components of sorted voxel keys; parent [n] ends as each one's first voxel."""
    n = keys.size
    for i in range(n):
        parent[i] = i
        root = i
        for d in range(deltas.size):
            j = np.searchsorted(keys, keys[i] + deltas[d])
            if j < n and keys[j] == keys[i] + deltas[d]:
                other = j
                while parent[other] != other:
                    parent[other] = parent[parent[other]]
                    other = parent[other]
                if other < root:
                    parent[root] = other
                    root = other
                elif other > root:
                    parent[other] = root
    for i in range(n):
        a = i
        while parent[a] != a:
            a = parent[a]
        parent[i] = a


@njit(cache=True, nogil=True)
def voxel_keys_kernel(points, voxel_m, bits, keys):
    """Fill keys [n] with the voxel of each point [n, 3]: x, y, z in `bits` bits each."""
    half = np.int64(1) << (bits - 1)
    for i in range(points.shape[0]):
        key = np.int64(0)
        for axis in range(3):
            step = np.int64(np.floor(np.float64(points[i, axis]) / voxel_m)) + half
            key = (key << bits) | step
        keys[i] = key
