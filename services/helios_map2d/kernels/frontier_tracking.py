"""Numba kernels that match frontiers with former ones, by equal cells or by near cells.

Called by `layers/frontiers.py`; its test has a readable reference version.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from helios_map2d.kernels.frontier_cells import equal

CHUNK = 16  # cells per run; the boxes of two runs are compared before their cells


@njit(cache=True, nogil=True)
def match_frontier_ids(cells, starts, former, former_starts, former_ids, reach, next_id):
    """Id of each cluster: that of a matching former frontier, or a new one from `next_id` on.

    Clusters are cells int32 [m, 2] with `starts` int64 [clusters + 1]; former ones have the same
    form, with ids `former_ids` int64. A cluster with the cells of a former one takes its id. Then
    the remaining pairs match by the number of cells within `reach` cells (a square), highest first.
    Returns the ids int64 [clusters], the indices of former ones with equal cells, -1 for none,
    int64 [clusters], and the next id.
    """
    count, before = starts.size - 1, former_starts.size - 1
    ids, same, taken = np.zeros(count, np.int64), np.full(count, -1), np.zeros(before, np.bool_)
    firsts = keys_of_first_cells(former, former_starts)
    order = np.argsort(firsts, kind="mergesort")
    sorted_firsts, own_firsts = firsts[order], keys_of_first_cells(cells, starts)
    for k in range(count):
        at = np.searchsorted(sorted_firsts, own_firsts[k])
        if at == before or sorted_firsts[at] != own_firsts[k]:
            continue
        j = order[at]
        if equal(cells[starts[k] : starts[k + 1]], former[former_starts[j] : former_starts[j + 1]]):
            ids[k], same[k], taken[j] = former_ids[j], j, True
    pairs, shared = votes(cells, starts, same, former, former_starts, taken, reach)
    for i in np.argsort(-shared, kind="mergesort"):
        k, j = pairs[i, 0], pairs[i, 1]
        if ids[k] == 0 and not taken[j]:
            ids[k], taken[j] = former_ids[j], True
    for k in range(count):
        if ids[k] == 0:
            ids[k] = next_id
            next_id += 1
    return ids, same, next_id


@njit(cache=True, nogil=True)
def keys_of_first_cells(cells, starts):
    """One number per cluster, int64: its first cell. Clusters share no cell, so each differs."""
    keys = np.empty(starts.size - 1, np.int64)
    for k in range(keys.size):
        row, column = np.int64(cells[starts[k], 0]), np.int64(cells[starts[k], 1])
        keys[k] = row * (np.int64(1) << 32) + column
    return keys


@njit(cache=True, nogil=True)
def votes(cells, starts, same, former, former_starts, taken, reach):
    """Pairs int64 [p, 2] (unmatched cluster, former one not taken) that have near cells, in order,
    and the number int64 [p] of the cluster's cells within `reach` of the former one."""
    count, before = starts.size - 1, former_starts.size - 1
    pairs, shared, found = np.empty((16, 2), np.int64), np.empty(16, np.int64), 0
    boxes = np.empty((before, 4), np.int32)
    for j in range(before):
        if not taken[j]:
            box_of(former[former_starts[j] : former_starts[j + 1]], boxes[j])
    box, around = np.empty(4, np.int32), np.empty(4, np.int32)
    for k in range(count):
        if same[k] >= 0:
            continue
        own = cells[starts[k] : starts[k + 1]]
        box_of(own, box)
        for j in range(before):
            if taken[j] or apart(box, boxes[j], reach):
                continue
            n = near_cells(own, former[former_starts[j] : former_starts[j + 1]], reach, around)
            if n == 0:
                continue
            if found == shared.size:
                pairs = np.concatenate((pairs, np.empty_like(pairs)))
                shared = np.concatenate((shared, np.empty_like(shared)))
            pairs[found, 0], pairs[found, 1], shared[found] = k, j, n
            found += 1
    return pairs[:found], shared[:found]


@njit(cache=True, nogil=True)
def near_cells(cells, others, reach, box):
    """Number of cells within `reach` of any of the others; `box` int32 [4] is scratch memory.

    The cells of a run lie close together, so boxes rule out most pairs of runs.
    """
    runs = (others.shape[0] + CHUNK - 1) // CHUNK
    boxes = np.empty((runs, 4), np.int32)
    for b in range(runs):
        box_of(others[b * CHUNK : (b + 1) * CHUNK], boxes[b])
    total = 0
    for first in range(0, cells.shape[0], CHUNK):
        part = cells[first : first + CHUNK]
        box_of(part, box)
        hit = 0  # one bit per cell
        for b in range(runs):
            if apart(box, boxes[b], reach):
                continue
            for i in range(part.shape[0]):
                if hit >> i & 1:
                    continue
                for j in range(b * CHUNK, min((b + 1) * CHUNK, others.shape[0])):
                    if (
                        abs(part[i, 0] - others[j, 0]) <= reach
                        and abs(part[i, 1] - others[j, 1]) <= reach
                    ):
                        hit |= 1 << i
                        total += 1
                        break
    return total


@njit(cache=True, nogil=True)
def box_of(cells, box):
    """Write to `box` the lowest and highest row and the lowest and highest column of some cells."""
    box[0] = box[1] = cells[0, 0]
    box[2] = box[3] = cells[0, 1]
    for i in range(1, cells.shape[0]):
        box[0], box[1] = min(box[0], cells[i, 0]), max(box[1], cells[i, 0])
        box[2], box[3] = min(box[2], cells[i, 1]), max(box[3], cells[i, 1])


@njit(cache=True, nogil=True, inline="always")
def apart(a, b, reach):
    """True if no cell of one box lies within `reach` of the other."""
    return a[1] + reach < b[0] or b[1] + reach < a[0] or a[3] + reach < b[2] or b[3] + reach < a[2]
