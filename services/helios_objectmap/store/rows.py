"""Which rows belong to which group, without looking at any other row.

The map grows with the time mapped; what one view touches does not. Rows are linked into one list
per group (a block of space, an instance), so that joining, leaving and listing a group cost what
they touch.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

NO_GROUP = 0
_END = -1

Rows = NDArray[np.integer]


class RowGroups:
    """Each row is in one group, or in none (NO_GROUP). Groups are numbers from 1."""

    def __init__(self) -> None:
        self._group = np.empty(0, np.int32)
        self._next = np.empty(0, np.int32)
        self._previous = np.empty(0, np.int32)
        self._head = np.full(16, _END, np.int32)
        self._count = np.zeros(16, np.int32)

    @property
    def group(self) -> NDArray[np.int32]:
        """[capacity] group of each row."""
        return self._group

    def grow(self, capacity: int) -> None:
        """Make room for rows; new ones are in no group."""
        more = capacity - len(self._group)
        self._group = np.concatenate([self._group, np.zeros(more, np.int32)])
        self._next = np.concatenate([self._next, np.full(more, _END, np.int32)])
        self._previous = np.concatenate([self._previous, np.full(more, _END, np.int32)])

    def move(self, rows: Rows, groups: Rows | int) -> None:
        """Put rows [k] into groups [k], or all into one, out of those they were in."""
        if not len(rows):
            return
        target = np.broadcast_to(np.asarray(groups, np.int32), (len(rows),))
        most = int(target.max())
        if most >= len(self._head):
            more = max(most + 1, 2 * len(self._head)) - len(self._head)
            self._head = np.concatenate([self._head, np.full(more, _END, np.int32)])
            self._count = np.concatenate([self._count, np.zeros(more, np.int32)])
        _move(
            np.asarray(rows, np.int64), np.ascontiguousarray(target),
            self._group, self._next, self._previous, self._head, self._count,
        )  # fmt: skip

    def rename(self, sources: Rows, targets: Rows) -> None:
        """Rows get other numbers; the targets must be in no group."""
        _rename(
            np.asarray(sources, np.int64), np.asarray(targets, np.int64),
            self._group, self._next, self._previous, self._head,
        )  # fmt: skip

    def count_of(self, group: int) -> int:
        """How many rows a group has."""
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
