"""Entries that are listed by voxel: what each voxel was seen as, and in which view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from helios_core.geometry import Matrix
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.instances.clustering import BITS, voxel_centers_m, voxel_keys
from helios_objectmap.instances.voxel_numbers import NO_VOXEL, VoxelNumbers

NONE = -1  # end of a list of entries

Int32 = NDArray[np.int32]


class Column:
    """Growing array of int32."""

    def __init__(self, values: Sequence[int] | NDArray[np.integer] = ()) -> None:
        self._values, self._n = np.empty(1024, np.int32), 0
        self.append(values)

    def append(self, values: NDArray[np.integer] | Sequence[int]) -> None:
        end = self._n + len(values)
        if end > len(self._values):
            more = max(end, 2 * len(self._values)) - len(self._values)
            self._values = np.concatenate([self._values, np.empty(more, np.int32)])
        self._values[self._n : end] = values
        self._n = end

    def resize(self, n: int, fill: int) -> None:
        """Make it at least n long; new values are `fill`."""
        if n > self._n:
            self.append(np.full(n - self._n, fill, np.int32))

    @property
    def values(self) -> Int32:
        return self._values[: self._n]


class VoxelEntries:
    """Entries of a few integers each, in a linked list by voxel that kernels can follow.

    `newest` of a voxel is its first entry, and `before` of an entry the next one. `columns` are the
    integers of the entries, by name; the first one is the owner of the entry, such as its view.
    """

    def __init__(self, voxel_m: float, names: Sequence[str]) -> None:
        self.voxel_m, self.voxels = voxel_m, VoxelNumbers()
        self.newest, self.before, self.voxel = Column(), Column(), Column()
        self.columns = {name: Column() for name in names}

    def __len__(self) -> int:
        return len(self.voxel.values)

    def numbers(self, points: NDArray[np.float32]) -> Int32:
        """Numbers of the voxels of points [n, 3]."""
        return self.voxels.of_keys(voxel_keys(points, self.voxel_m))

    def add(self, voxels: Int32, *values: NDArray[np.integer]) -> None:
        """Add entries in numbered voxels [n], with a value [n] for each column."""
        self.newest.resize(len(self.voxels), NONE)
        start = len(self)
        self.voxel.append(voxels)
        for column, added in zip(self.columns.values(), values, strict=True):
            column.append(added)
        self.before.append(np.empty(len(voxels), np.int32))
        link_kernel(voxels, start, self.newest.values, self.before.values)

    def filled(self, keys: NDArray[np.integer]) -> NDArray[np.bool_]:
        """True [n] for the voxels with these keys [n] that have an entry."""
        numbers = self.voxels.known(keys)
        self.newest.resize(len(self.voxels), NONE)
        out = numbers != NO_VOXEL
        out[out] = self.newest.values[numbers[out]] != NONE
        return out

    def forget_at(self, points: NDArray[np.float32]) -> None:
        """Drop the entries in the voxels of points [n, 3]."""
        voxels = np.unique(self.numbers(points))
        self.newest.resize(len(self.voxels), NONE)
        self.newest.values[voxels] = NONE
        self.voxel.values[np.isin(self.voxel.values, voxels)] = NO_VOXEL

    def without(self, gone: int) -> VoxelEntries:
        """The entries whose owner is at least `gone`, which becomes owner 0."""
        out = VoxelEntries(self.voxel_m, list(self.columns))
        owner, *others = (column.values for column in self.columns.values())
        kept = (owner >= gone) & (self.voxel.values != NO_VOXEL)
        voxels = out.voxels.of_keys(self.voxels.keys[self.voxel.values[kept]])
        out.add(voxels, owner[kept] - gone, *(values[kept] for values in others))
        return out

    # --- on disk ------------------------------------------------------------------------------
    def arrays(self) -> dict[str, NDArray]:
        """Copies of all entries."""
        columns = {name: column.values.copy() for name, column in self.columns.items()}
        return {"keys": self.voxels.keys.copy(), "voxel": self.voxel.values.copy()} | columns

    def add_arrays(
        self,
        arrays: Mapping[str, NDArray],
        first_owner: int,
        T_here_there: Matrix | None,
    ) -> None:
        """Add entries that `arrays` returned. first_owner: added to their owners. T_here_there:
        their place in this frame; None: the same frame. Entries of one owner that come into one
        voxel become one; its other values are summed. Raises ValueError for inconsistent arrays."""
        keys = moved_keys(arrays["keys"], self.voxel_m, T_here_there)
        voxel = arrays["voxel"].astype(np.int32)
        values = [arrays[name].astype(np.int32) for name in self.columns]
        if any(v.shape != voxel.shape for v in values) or voxel.ndim != 1:
            raise ValueError("entries by voxel have columns of different lengths")
        if len(voxel) and (voxel.min() < NO_VOXEL or voxel.max() >= len(keys)):
            raise ValueError("an entry is in a voxel that is not there")
        kept = voxel != NO_VOXEL
        voxel, (owner, *others) = voxel[kept], [v[kept] for v in values]
        keys, same = np.unique(keys, return_inverse=True)
        voxel = same.reshape(-1)[voxel]
        if T_here_there is not None and len(voxel):
            pair = owner.astype(np.int64) * len(keys) + voxel
            pair, first, of_pair = np.unique(pair, return_index=True, return_inverse=True)
            owner, voxel = owner[first], voxel[first]
            others = [np.bincount(of_pair.reshape(-1), v, len(pair)) for v in others]
        self.add(self.voxels.of_keys(keys[voxel]), owner + first_owner, *others)


def check_within(index: NDArray[np.integer], n: int) -> None:
    """Raise ValueError unless all indices are in [0, n)."""
    if len(index) and (index.min() < 0 or index.max() >= n):
        raise ValueError(f"an index is not below {n}")


def moved(points_m: NDArray[np.float64], T: Matrix | None) -> NDArray[np.float64]:
    """Points [n, 3] after a motion; None: none."""
    return points_m if T is None else points_m @ T[:3, :3].T + T[:3, 3]


def moved_keys(keys: NDArray[np.integer], voxel_m: float, T: Matrix | None) -> NDArray[np.int64]:
    """Keys [n] of the voxels that hold the centres of others after a motion. Raises ValueError."""
    keys = np.asarray(keys, np.int64)
    if keys.ndim != 1 or (len(keys) and (keys.min() < 0 or keys.max() >= 1 << (3 * BITS))):
        raise ValueError("a voxel has an impossible key")
    if T is None or not len(keys):
        return keys
    return voxel_keys(moved(voxel_centers_m(keys, voxel_m), T).astype(np.float32), voxel_m)


@njit(cache=True, nogil=True)
def link_kernel(voxels, start, newest, before):
    """Prepend entries, numbered from `start`, to the lists of their voxels.

    newest: [voxels] first entry of each list; before: [entries] the next one, NONE at the end.
    """
    for k in range(voxels.size):
        before[start + k] = newest[voxels[k]]
        newest[voxels[k]] = start + k
