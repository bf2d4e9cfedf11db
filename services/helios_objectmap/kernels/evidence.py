"""Evidence of a view for thousands of Gaussians at once: taken, believed and counted in one pass
each. What they compute stands in `accumulate.py`, `belief.py` and `registry.py`."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def accumulate_kernel(rows, kappa, columns, weights, alpha_cpa, positive, asked, took):
    """Add evidence to positive and asked [., columns]; lists in took [k] which of the rows took
    some, and returns how many."""
    n = 0
    for k in range(rows.size):
        total = np.float32(0)
        for c in range(kappa.shape[1]):
            total += kappa[k, c]
        row, some = rows[k], False
        for j in range(columns.size):
            share = weights[k, j] * alpha_cpa
            if share * total > 0:
                positive[row, columns[j]] += share * kappa[k, 1 + j]
                asked[row, columns[j]] += share * total
                some = True
        took[n] = k
        n += some
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def believe_kernel(
    positive, asked, rows, present, parked, prior, prior_total, likely, tie, other, believed
):
    """Fill believed [k] for rows [k]; present, parked: columns of the store."""
    for k in range(rows.size):
        row = rows[k]
        believed[k] = other
        best, highest = 0, -1.0
        for column in parked:
            mean = (positive[row, column] + prior) / (asked[row, column] + prior_total)
            if mean > highest:
                best, highest = column, mean
        if highest > likely + tie:
            believed[k] = best
        highest, spoken = -1.0, 0.0
        for j in range(present.size):
            column = present[j]
            spoken += positive[row, column]
            mean = (positive[row, column] + prior) / (asked[row, column] + prior_total)
            if mean - j * tie * 0.01 > highest:
                best, highest = column, mean - j * tie * 0.01
        if present.size:
            everything = asked[row, best]
            if positive[row, best] > max(everything - spoken, 0.0) + tie * (1 + everything):
                believed[k] = best


@njit(cache=True, nogil=True)
def views_kernel(of_row, kappa, weights, depth_m, seen, weighed, far_m):
    """Add kappa [k, 1 + C] to seen [labels, 1 + C]; weights [k, C] and depth_m [k], both times the
    sum of kappa, to weighed [labels, C] and far_m [labels]; of_row: [k] which of the labels."""
    for k in range(of_row.size):
        label, total = of_row[k], 0.0
        for c in range(kappa.shape[1]):
            seen[label, c] += kappa[k, c]
            total += kappa[k, c]
        for j in range(weights.shape[1]):
            weighed[label, j] += weights[k, j] * total
        far_m[label] += depth_m[k] * total
