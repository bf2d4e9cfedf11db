"""Numba kernels that tell which frontier is which: the same cells as before, or cells near them.

Reached through `frontiers.py`; a readable twin stands in its test.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from helios_map2d.kernels.frontier_cells import equal

CHUNK = 16  # cells that are compared by the box around them first


@njit(cache=True, nogil=True)
def recognise(cells, starts, former, former_starts, former_ids, reach, next_id):
    """The number of each cluster: that of a former one, or a new one from `next_id` on.

    The clusters are cells int32 [m, 2] with `starts` int64 [clusters + 1]; so are the former ones,
    whose numbers are `former_ids` int64. One with the very cells of a former has its number; of
    the others, those with most cells within `reach` cells (a square) of a former. Returns the
    numbers int64 [clusters], the places of the former with the very same cells, -1 for none, int64
    [clusters], and the next number.
    """
    count, before = starts.size - 1, former_starts.size - 1
    ids, same, taken = np.zeros(count, np.int64), np.full(count, -1), np.zeros(before, np.bool_)
    for k in range(count):
        for j in range(before):
            if not taken[j] and equal(cells[starts[k] : starts[k + 1]],
                                      former[former_starts[j] : former_starts[j + 1]]):  # fmt: skip
                ids[k], same[k], taken[j] = former_ids[j], j, True
                break
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
def votes(cells, starts, same, former, former_starts, taken, reach):
    """How many cells of each cluster that is new lie within `reach` of each former that is not
    taken: the pairs int64 [p, 2] of which any do, in order, and int64 [p] how many."""
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
    """How many of the cells lie within `reach` of any of the others; `box` int32 [4] is of use
    inside. Runs of cells lie close together, so most pairs of them are told apart by their boxes.
    """
    runs = (others.shape[0] + CHUNK - 1) // CHUNK
    boxes = np.empty((runs, 4), np.int32)
    for b in range(runs):
        box_of(others[b * CHUNK : (b + 1) * CHUNK], boxes[b])
    total = 0
    for first in range(0, cells.shape[0], CHUNK):
        part = cells[first : first + CHUNK]
        box_of(part, box)
        hit = 0  # a bit for each
        for b in range(runs):
            if apart(box, boxes[b], reach):
                continue
            for i in range(part.shape[0]):
                if hit >> i & 1:
                    continue
                for j in range(b * CHUNK, min((b + 1) * CHUNK, others.shape[0])):
                    if (abs(part[i, 0] - others[j, 0]) <= reach
                            and abs(part[i, 1] - others[j, 1]) <= reach):  # fmt: skip
                        hit |= 1 << i
                        total += 1
                        break
    return total


@njit(cache=True, nogil=True)
def box_of(cells, box):
    """The box around some cells: lowest and highest row, lowest and highest column."""
    box[0] = box[1] = cells[0, 0]
    box[2] = box[3] = cells[0, 1]
    for i in range(1, cells.shape[0]):
        box[0], box[1] = min(box[0], cells[i, 0]), max(box[1], cells[i, 0])
        box[2], box[3] = min(box[2], cells[i, 1]), max(box[3], cells[i, 1])


@njit(cache=True, nogil=True, inline="always")
def apart(a, b, reach):
    """Whether no cell of a box lies within `reach` of the other."""
    return (a[1] + reach < b[0] or b[1] + reach < a[0]
            or a[3] + reach < b[2] or b[3] + reach < a[2])  # fmt: skip
