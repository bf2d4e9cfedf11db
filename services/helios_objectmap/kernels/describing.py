"""What is said of an instance of many Gaussians: sums of beliefs, quantiles without sorting."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_BINS = 2048


@njit(cache=True, nogil=True, error_model="numpy")
def beliefs_kernel(
    rows, positive, asked, columns, own, prior, prior_total, trust, means, deviations, mine
):
    """Sums over rows [n] of the mean and the standard deviation of theta (eq. 4) of each of the
    columns [C], into means and deviations [C]; the mean of column columns[own] into mine [n].

    Of the evidence for that column, the sums count the share `trust`, and `mine` counts all.
    """
    for k in range(rows.size):
        for j in range(columns.size):
            row, column = rows[k], columns[j]
            total = asked[row, column] + prior_total
            mean = (positive[row, column] + prior) / total
            if j == own:
                mine[k] = mean
                mean = (trust * positive[row, column] + prior) / total
            means[j] += mean
            deviations[j] += math.sqrt(max(mean * (1 - mean), 0.0) / (1 + total))


@njit(cache=True, nogil=True)
def gather_kernel(rows, points, mine, least, xyz):
    """The points [., 3] of rows [n] with mine [n] above `least`, axis by axis into xyz [3, n];
    returns how many."""
    n = 0
    for k in range(rows.size):
        if mine[k] > least:
            for axis in range(3):
                xyz[axis, n] = points[rows[k], axis]
            n += 1
    return n


@njit(cache=True, nogil=True)
def inside_kernel(xyz, points, low, high, xy):
    """Of the first points of xyz [3, .], those within low and high [3]: their x and y into
    xy [points, 2]; returns how many, and the largest z."""
    n, top = 0, -np.inf
    for i in range(points):
        x, y, z = xyz[0, i], xyz[1, i], xyz[2, i]
        if low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]:
            xy[n, 0] = x
            xy[n, 1] = y
            n += 1
            top = max(top, np.float64(z))
    return n, top


@njit(cache=True, nogil=True)
def outer_kernel(xy, outer):
    """Copy to outer [n, 2] the points of xy [n, 2] that are not well inside of the octagon of the
    extreme ones: no other can be a corner of the hull. Returns how many."""
    corner = np.zeros(8, np.int64)  # counter-clockwise: the most along x, x + y, y, y - x, ...
    reach = np.full(8, -np.inf)
    along = np.empty(8)
    for i in range(xy.shape[0]):
        x, y = np.float64(xy[i, 0]), np.float64(xy[i, 1])
        along[0], along[1], along[2], along[3] = x, x + y, y, y - x
        for d in range(4):
            along[4 + d] = -along[d]
        for d in range(8):
            if along[d] > reach[d]:
                reach[d], corner[d] = along[d], i
    n = 0
    for i in range(xy.shape[0]):
        inside, some = True, False
        for d in range(8):
            a, b = corner[d], corner[(d + 1) % 8]
            edge_x, edge_y = np.float64(xy[b, 0]) - xy[a, 0], np.float64(xy[b, 1]) - xy[a, 1]
            if edge_x != 0 or edge_y != 0:
                some = True
                to_x, to_y = np.float64(xy[i, 0]) - xy[a, 0], np.float64(xy[i, 1]) - xy[a, 1]
                if edge_x * to_y - edge_y * to_x <= 1e-9:
                    inside = False
                    break
        if not (inside and some):
            outer[n] = xy[i]
            n += 1
    return n


@njit(cache=True, nogil=True)
def ranked_kernel(values, ranks, out):
    """The values [n] that stand at some ranks when sorted: counted into bins, and only the bins of
    the ranks sorted."""
    low, high = values[0], values[0]
    for i in range(values.size):
        low, high = min(low, values[i]), max(high, values[i])
    scale = np.float64(_BINS) / max(np.float64(high) - np.float64(low), 1e-30)
    bins = np.empty(values.size, np.int16)
    counts = np.zeros(_BINS, np.int64)
    for i in range(values.size):
        bins[i] = min(np.int64((np.float64(values[i]) - low) * scale), _BINS - 1)
        counts[bins[i]] += 1
    known, sorted_bin, before = -1, values[:0].copy(), 0
    for r in range(ranks.size):
        wanted, b, below = ranks[r], 0, 0
        while below + counts[b] <= wanted:
            below += counts[b]
            b += 1
        if b != known:
            known, before = b, below
            sorted_bin = np.empty(counts[b], values.dtype)
            n = 0
            for i in range(values.size):
                if bins[i] == b:
                    sorted_bin[n] = values[i]
                    n += 1
            sorted_bin.sort()
        out[r] = sorted_bin[wanted - before]
