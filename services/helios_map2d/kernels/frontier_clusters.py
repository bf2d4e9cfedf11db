"""Numba kernels of clusters of frontier cells: which cells hang together, and in which order.

Reached through `frontiers.py`; a readable twin stands in its test. Cells come tile after tile, so
that all work is done on arrays of the size of a tile, which stay in the fastest cache.
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
    """The smaller of two roots becomes the root of both."""
    a, b = find_root(parent, a), find_root(parent, b)
    parent[max(a, b)] = min(a, b)


@njit(cache=True, nogil=True)
def clusters_of(cells, side, least):
    """The 8-connected clusters of at least so many cells, the largest first, of equals the one of
    the first cell.

    `cells` int32 [n, 2] lie tile after tile of `side` cells, the tiles in row order and so the
    cells of each. Returns their cells int32 [m, 2], cluster after cluster, in the same order, and
    int64 [clusters + 1] where each begins, and the last ends.
    """
    n = cells.shape[0]
    parent = np.arange(n).astype(np.int32)
    hang_together(cells, side, parent)
    labels, sizes = np.empty(n, np.int32), np.empty(n, np.int32)
    found = 0
    for i in range(n):
        root = find_root(parent, i)  # the smallest of its cluster
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
def hang_together(cells, side, parent):
    """Unite in `parent` int32 [n] all cells that are neighbours; see `clusters_of`."""
    n = cells.shape[0]
    if n == 0:
        return
    left = cells[:, 1].min() // side * side
    width = cells[:, 1].max() // side * side + side - left
    # Numbers of cells from 1: those of a tile, with one row and column of the tiles before it; of
    # the right column of the last tile, and of the top rows of this row of tiles and the one below.
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
            # Half of the neighbours: each pair is met once.
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
