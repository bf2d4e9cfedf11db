"""Numba kernels that cluster frontier cells.

Called by `layers/frontiers.py`; its test has a readable reference version. Cells are sorted by
tile, so all work uses arrays of the size of a tile, which stay in the fastest cache.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, inline="always")
def find_root(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True, inline="always")
def unite(parent, a, b):
    """Merge two sets; the smaller root becomes the root of both."""
    a, b = find_root(parent, a), find_root(parent, b)
    parent[max(a, b)] = min(a, b)


@njit(cache=True, nogil=True)
def clusters_of(cells, side, least):
    """8-connected clusters of at least `least` cells, largest first; equal ones by first cell.

    `cells` int32 [n, 2] are sorted by tile of `side` cells: tiles in row order, and cells in row
    order within a tile. Returns the clusters' cells int32 [m, 2], cluster after cluster, each in
    that order, and the start of each and the end of the last, int64 [clusters + 1].
    """
    n = cells.shape[0]
    parent = np.arange(n).astype(np.int32)
    unite_neighbours(cells, side, parent)
    labels, sizes = np.empty(n, np.int32), np.empty(n, np.int32)
    found = 0
    for i in range(n):
        root = find_root(parent, i)  # smallest index of the cluster
        if root == i:
            labels[i] = found
            sizes[found] = 0
            found += 1
        else:
            labels[i] = labels[root]
        sizes[labels[i]] += 1
    order = np.argsort(-sizes[:found], kind="mergesort")
    kept = 0
    while kept < found and sizes[order[kept]] >= least:
        kept += 1
    starts, filled = np.zeros(kept + 1, np.int64), np.full(found, -1)
    for k in range(kept):
        filled[order[k]] = starts[k]
        starts[k + 1] = starts[k] + sizes[order[k]]
    own = np.empty((starts[kept], 2), np.int32)
    for i in range(n):
        at = filled[labels[i]]
        if at >= 0:
            own[at, 0], own[at, 1] = cells[i, 0], cells[i, 1]
            filled[labels[i]] += 1
    return own, starts


@njit(cache=True, nogil=True)
def unite_neighbours(cells, side, parent):
    """Unite all neighbouring cells in `parent` int32 [n]; see `clusters_of`."""
    n = cells.shape[0]
    if n == 0:
        return
    left = cells[:, 1].min() // side * side
    width = cells[:, 1].max() // side * side + side - left
    # Numbers of cells, from 1. near: those of a tile, with one row and column of the tiles before
    # it. beside: right column of the last tile. tops, below: top rows of this row of tiles and of
    # the row below.
    near = np.zeros((side + 1, side + 2), np.int32)
    beside = np.zeros(side, np.int32)
    tops, below = np.zeros(width + 2, np.int32), np.zeros(width + 2, np.int32)
    i, last_row, last_column = 0, np.int64(0), np.int64(0)
    while i < n:
        row, column = cells[i, 0] // side, cells[i, 1] // side
        if i == 0 or row != last_row:
            tops, below = below, tops
            tops[:] = 0
            if i == 0 or row != last_row + 1:
                below[:] = 0
        if i == 0 or row != last_row or column != last_column + 1:
            beside[:] = 0
        last_row, last_column = row, column
        r0, c0 = row * side - 1, column * side - 1
        near[0, :] = below[c0 + 1 - left : c0 + 3 - left + side]
        near[1:, 0] = beside
        end = i
        while end < n:
            y, x = cells[end, 0] - r0, cells[end, 1] - c0
            if y > side or x < 1 or x > side:
                break
            near[y, x] = end + 1
            end += 1
        for k in range(i, end):
            y, x = cells[k, 0] - r0, cells[k, 1] - c0
            # Only half of the neighbours: each pair occurs once.
            if near[y - 1, x - 1] != 0:
                unite(parent, near[y - 1, x - 1] - 1, k)
            if near[y - 1, x] != 0:
                unite(parent, near[y - 1, x] - 1, k)
            if near[y - 1, x + 1] != 0:
                unite(parent, near[y - 1, x + 1] - 1, k)
            if near[y, x - 1] != 0:
                unite(parent, near[y, x - 1] - 1, k)
            if x == 1 and y < side and near[y + 1, 0] != 0:
                unite(parent, near[y + 1, 0] - 1, k)
        beside[:] = near[1:, side]
        tops[c0 + 2 - left : c0 + 2 - left + side] = near[side, 1 : side + 1]
        for k in range(i, end):
            near[cells[k, 0] - r0, cells[k, 1] - c0] = 0
        i = end
