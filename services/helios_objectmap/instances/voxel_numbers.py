"""Consecutive numbers for voxels, so that kernels use arrays in place of dictionaries.

A hash table with open addressing maps the key of a voxel (`clustering.voxel_keys`) to its number.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.instances.clustering import BITS

NO_VOXEL = -1
_EMPTY = -1  # no voxel has a negative key
_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 divided by the golden ratio


class VoxelNumbers:
    """Number of each voxel that was ever asked for, in the order of the first request."""

    def __init__(self) -> None:
        self._count = 0
        self._slots = np.full(1024, _EMPTY, np.int64)  # keys; the length is a power of two
        self._of_slot = np.empty(1024, np.int32)
        self._keys = np.empty(512, np.int64)  # by number

    def __len__(self) -> int:
        return self._count

    @property
    def keys(self) -> NDArray[np.int64]:
        """Key of each voxel, by number."""
        return self._keys[: self._count]

    def of_keys(self, keys: NDArray[np.integer]) -> NDArray[np.int32]:
        """Number [n] of each key [n]; new keys get new numbers."""
        out = np.empty(len(keys), np.int32)
        keys, first = np.asarray(keys, np.int64), 0
        while first < len(keys):
            first, self._count = number_kernel(
                keys, first, self._slots, self._of_slot, self._keys, self._count, out
            )
            if first < len(keys):
                self._grow()
        return out

    def known(self, keys: NDArray[np.integer]) -> NDArray[np.int32]:
        """Number [n] of each key [n]; NO_VOXEL for one that was never asked for."""
        out = np.empty(len(keys), np.int32)
        known_kernel(np.asarray(keys, np.int64), self._slots, self._of_slot, out)
        return out

    def _grow(self) -> None:
        known = self.keys.copy()
        size = 4 * len(self._slots)
        self._slots, self._of_slot = np.full(size, _EMPTY, np.int64), np.empty(size, np.int32)
        self._keys = np.empty(size // 2, np.int64)
        out = np.empty(len(known), np.int32)
        number_kernel(known, 0, self._slots, self._of_slot, self._keys, 0, out)


@njit(cache=True, nogil=True)
def known_kernel(keys, slots, of_slot, out):
    """Fill out [n] with the numbers of keys [n], NO_VOXEL for unknown ones; slots, of_slot: hash
    table."""
    mask = np.uint64(slots.size - 1)
    for k in range(keys.size):
        mixed = np.uint64(keys[k]) * _MIX
        at = (mixed ^ (mixed >> np.uint64(32))) & mask
        while slots[at] != _EMPTY and slots[at] != keys[k]:
            at = (at + np.uint64(1)) & mask
        out[k] = of_slot[at] if slots[at] != _EMPTY else NO_VOXEL


@njit(cache=True, nogil=True)
def number_kernel(keys, first, slots, of_slot, known, count, out):
    """Fill out [n] from index `first` on with the numbers of keys [n]; new keys get the next ones.

    slots, of_slot: hash table; known: [half of the slots] key of each number; count: voxels so far.
    Returns the index at which the table was full, n if it was not, and the new count.
    """
    mask = np.uint64(slots.size - 1)
    last, number = np.int64(_EMPTY), np.int32(NO_VOXEL)
    for k in range(first, keys.size):
        key = keys[k]
        if key != last:  # neighbours are often in one voxel
            mixed = np.uint64(key) * _MIX
            at = (mixed ^ (mixed >> np.uint64(32))) & mask
            while slots[at] != _EMPTY and slots[at] != key:
                at = (at + np.uint64(1)) & mask
            if slots[at] == _EMPTY:
                if count == known.size:
                    return k, count
                slots[at], of_slot[at], known[count] = key, count, key
                count += 1
            last, number = key, of_slot[at]
        out[k] = number
    return keys.size, count


assert 3 * BITS < 64  # a key fits a non-negative int64
