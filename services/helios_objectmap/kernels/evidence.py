"""Evidence of a view for thousands of Gaussians at once: taken, believed and counted in one pass
each. What they compute stands in `accumulate.py`, `belief.py` and `registry.py`."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def accumulate_kernel(rows, kappa, columns, weights, alpha_cpa, positive, asked, took):
    """Add evidence (eq. 3) to positive and asked [., columns]; lists in took [k] which of the rows
    took some, and returns how many."""
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
def tell_kernel(
    rows,
    kappa,
    columns,
    weights,
    sectors,
    unit,
    most,
    whole_kappa,
    full,
    alpha_side,
    votes,
    positive,
    asked,
    took,
):
    """By sides, in place of eq. 3: add votes from sectors [k] to votes [., columns, sectors, (own,
    all)]: `unit` is one vote, `full` a side that counts in full, `most` the limit of a side. Adds
    what they change to positive and asked [., columns]; lists in took [k] which of the rows took
    some, and returns how many."""
    n = 0
    for k in range(rows.size):
        total = 0.0
        for c in range(kappa.shape[1]):
            total += kappa[k, c]
        row, side, some = rows[k], sectors[k], False
        scale = unit / max(total, whole_kappa)
        for j in range(columns.size):
            more = int(weights[k, j] * total * scale + 0.5)
            if more > 0:
                column = columns[j]
                own, all_told = int(votes[row, column, side, 0]), int(votes[row, column, side, 1])
                own_before = own / max(all_told, full)
                asked_before = all_told / max(all_told, full)
                if all_told + more > most:
                    own, all_told = own // 2, all_told // 2
                own += min(int(weights[k, j] * kappa[k, 1 + j] * scale + 0.5), more)
                all_told += more
                votes[row, column, side, 0], votes[row, column, side, 1] = own, all_told
                positive[row, column] += alpha_side * (own / max(all_told, full) - own_before)
                asked[row, column] += alpha_side * (all_told / max(all_told, full) - asked_before)
                some = True
        took[n] = k
        n += some
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def believe_kernel(
    positive,
    asked,
    rows,
    present,
    parked,
    prior,
    prior_total,
    likely,
    per_other,
    tie,
    other,
    believed,
):
    """Fill believed [k] for rows [k]; present, parked: columns of the store; per_other: how much
    must speak for a class, for each that speaks for "other"."""
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
            unnamed = per_other * max(everything - spoken, 0.0)
            if positive[row, best] > unnamed + tie * (1 + everything):
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
