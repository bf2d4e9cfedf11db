"""Spatial index of the Gaussians: blocks of half a metre, and the blocks that a view can see."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.camera import View

BLOCK_M = 0.5
_BITS = 21
_HALF = 1 << (_BITS - 1)
NO_GROUP = 0
_END = -1
Rows = NDArray[np.integer]


class Blocks:
    """Assignment of rows to blocks. The number of an empty block may be reused for another one."""

    def __init__(self) -> None:
        self.rows = RowGroups()
        self._number: dict[int, int] = {}  # key of a block -> its group in `rows`
        self._highest = 0  # highest number in use so far
        self._free: list[int] = []  # numbers below it without a block
        self._center_m = np.empty((16, 3))  # indexed by block number; 0 is no block

    def add(self, rows: NDArray[np.integer], means: NDArray[np.float32]) -> None:
        """Assign rows [k] to the blocks of their means [k, 3] in the world."""
        if not len(rows):
            return
        ijk = np.floor(means.astype(np.float64) / BLOCK_M).astype(np.int64)
        keys, first, of_row = np.unique(_keys(ijk), return_index=True, return_inverse=True)
        self._make_room(len(keys))
        numbers = np.empty(len(keys), np.int32)
        for k, (key, i) in enumerate(zip(keys.tolist(), first.tolist(), strict=True)):
            number = self._number.get(key)
            if number is None:
                number = self._number[key] = self._new_number()
                self._center_m[number] = (ijk[i] + 0.5) * BLOCK_M
            numbers[k] = number
        self.rows.move(rows, numbers[of_row])

    def seen_by(self, view: View, far_m: float, margin_m: float) -> NDArray[np.int32]:
        """Rows of the blocks that a view may show: all within margin_m of its pyramid, and more.

        far_m: limit along the optical axis.
        """
        center = (
            self._center_m[1 : self._highest + 1] @ view.T_cam_world[:3, :3].T
            + view.T_cam_world[:3, 3]
        )
        x, y, z = center.T
        reach = BLOCK_M * np.sqrt(3) / 2 + margin_m
        inside = (z > -reach) & (z < far_m + reach)
        # The four side planes contain the camera centre: (normal . center) >= -reach.
        left, right = -(view.cx + 0.5) / view.fx, (view.width - 0.5 - view.cx) / view.fx
        up, down = -(view.cy + 0.5) / view.fy, (view.height - 0.5 - view.cy) / view.fy
        inside &= (x - left * z) >= -reach * np.hypot(1, left)
        inside &= (right * z - x) >= -reach * np.hypot(1, right)
        inside &= (y - up * z) >= -reach * np.hypot(1, up)
        inside &= (down * z - y) >= -reach * np.hypot(1, down)
        return self.rows.rows_of(np.flatnonzero(inside) + 1)

    def near(self, means: NDArray[np.float32], reach_m: float) -> NDArray[np.int32]:
        """Rows within reach_m of at least one of the points [k, 3] along every axis, and more."""
        if not len(means):
            return np.empty(0, np.int32)
        ijk = np.unique(np.floor(means.astype(np.float64) / BLOCK_M).astype(np.int64), axis=0)
        steps = range(-math.ceil(reach_m / BLOCK_M), math.ceil(reach_m / BLOCK_M) + 1)
        offsets = np.array(list(itertools.product(steps, repeat=3)))
        around = np.unique(_keys(ijk[:, None] + offsets))
        found = (self._number.get(key) for key in around.tolist())
        return self.rows.rows_of(np.array([n for n in found if n is not None], np.int64))

    def _make_room(self, blocks: int) -> None:
        """Make room for new blocks: free the numbers of empty ones, then enlarge the table."""
        if self._highest + blocks - len(self._free) < len(self._center_m):
            return
        for key, number in list(self._number.items()):
            if not self.rows.count_of(number):
                del self._number[key]
                self._free.append(number)
        # At least half of the table stays free, so that this is rare.
        while self._highest + blocks - len(self._free) >= len(self._center_m) // 2:
            self._center_m = np.concatenate([self._center_m, self._center_m])

    def _new_number(self) -> int:
        if self._free:
            return self._free.pop()
        self._highest += 1
        return self._highest


def _keys(ijk: NDArray[np.int64]) -> NDArray[np.int64]:
    """One integer per block [..., 3]; the map reaches 2^20 blocks from the origin."""
    shifted = ijk + _HALF
    return (shifted[..., 0] << (2 * _BITS)) | (shifted[..., 1] << _BITS) | shifted[..., 2]


class RowGroups:
    """Partition of rows: each is in one group, numbered from 1, or in none (NO_GROUP)."""

    def __init__(self) -> None:
        self._group = np.empty(0, np.int32)
        self._next = np.empty(0, np.int32)
        self._previous = np.empty(0, np.int32)
        self._head = np.full(16, _END, np.int32)
        self._count = np.zeros(16, np.int32)

    @property
    def group(self) -> NDArray[np.int32]:
        """Group [capacity] of each row."""
        return self._group

    def grow(self, capacity: int) -> None:
        """Enlarge to this capacity; new rows are in no group."""
        more = capacity - len(self._group)
        self._group = np.concatenate([self._group, np.zeros(more, np.int32)])
        self._next = np.concatenate([self._next, np.full(more, _END, np.int32)])
        self._previous = np.concatenate([self._previous, np.full(more, _END, np.int32)])

    def move(self, rows: Rows, groups: Rows | int) -> None:
        """Move rows [k] into groups [k], or all into one group, out of their former ones."""
        if not len(rows):
            return
        target = np.broadcast_to(np.asarray(groups, np.int32), (len(rows),))
        most = int(target.max())
        if most >= len(self._head):
            more = max(most + 1, 2 * len(self._head)) - len(self._head)
            self._head = np.concatenate([self._head, np.full(more, _END, np.int32)])
            self._count = np.concatenate([self._count, np.zeros(more, np.int32)])
        _move(
            np.asarray(rows, np.int64),
            np.ascontiguousarray(target),
            self._group,
            self._next,
            self._previous,
            self._head,
            self._count,
        )

    def rename(self, sources: Rows, targets: Rows) -> None:
        """Renumber rows; the targets must be in no group."""
        _rename(
            np.asarray(sources, np.int64),
            np.asarray(targets, np.int64),
            self._group,
            self._next,
            self._previous,
            self._head,
        )

    def count_of(self, group: int) -> int:
        """Number of rows in a group."""
        return int(self._count[group]) if group < len(self._count) else 0

    def rows_of(self, groups: Rows) -> NDArray[np.int32]:
        """All rows of some distinct groups, in rising order."""
        wanted = np.asarray(groups, np.int64)
        wanted = wanted[(wanted > NO_GROUP) & (wanted < len(self._head))]
        out = np.empty(int(self._count[wanted].sum()), np.int32)
        _collect(wanted, self._head, self._next, out)
        out.sort()
        return out


@njit(cache=True, nogil=True)
def _move(rows, target, group, following, previous, head, count):
    for k in range(rows.size):
        row = rows[k]
        old, new = group[row], target[k]
        if old == new:
            continue
        if old != NO_GROUP:
            before, after = previous[row], following[row]
            if before == _END:
                head[old] = after
            else:
                following[before] = after
            if after != _END:
                previous[after] = before
            count[old] -= 1
        group[row] = new
        previous[row] = _END
        following[row] = _END
        if new != NO_GROUP:
            first = head[new]
            following[row] = first
            if first != _END:
                previous[first] = row
            head[new] = row
            count[new] += 1


@njit(cache=True, nogil=True)
def _rename(sources, targets, group, following, previous, head):
    for k in range(sources.size):
        source, target = sources[k], targets[k]
        g = group[source]
        before, after = previous[source], following[source]
        group[target] = g
        previous[target] = before
        following[target] = after
        if g != NO_GROUP:
            if before == _END:
                head[g] = target
            else:
                following[before] = target
            if after != _END:
                previous[after] = target
        group[source] = NO_GROUP
        previous[source] = _END
        following[source] = _END


@njit(cache=True, nogil=True)
def _collect(groups, head, following, out):
    n = 0
    for k in range(groups.size):
        row = head[groups[k]]
        while row != _END:
            out[n] = row
            n += 1
            row = following[row]
