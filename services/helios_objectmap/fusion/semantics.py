"""Dirichlet semantics of a Gaussian (section 3.1.3, eq. 2-5).

theta ~ Dir(concentration), density prod theta_c^(concentration_c - 1) / B(concentration)  (eq. 2).
Evidence is kept per class name: `class_evidence` is the evidence for the class, and
`total_evidence` is all evidence of the views that searched for the class. The marginal of a
Dirichlet is a Beta distribution, so within one search context this gives exactly eq. 4. Across
contexts, a class keeps its evidence, and a new class starts from the prior.

The prior decides how many views a belief takes. With three classes and alpha_cpa = 3, Psi passes
0.5 after this many views with weight 1. The first number is for an object that is detected in each
view, the second for one that is detected in 65 % of them:

    prior 0.3: 1, 5      prior 1 (default): 2, 8      prior 3: 4, 15      prior 10: 10, 36

The paper's distribution always has four classes. A search for fewer keeps the prior of four
(setting `prior_classes`): the unlisted classes have their prior and no evidence. A Dirichlet
distribution stays one if classes are merged by adding their concentrations. The mean and variance
of a listed class are then the same, so `marginal` needs only the number of classes. The entropy is
not the same, so `entropy` needs every class on its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import digamma, gammaln

from helios_objectmap.gaussians import OTHER, GaussianStore

Floats = NDArray[np.floating]
# Margin for float32 rounding, so that equal beliefs are always resolved the same way.
TIE = 1e-5
NAMED_FROM = 0.5


def expectation(concentration: Floats) -> Floats:
    """Mean E[theta^c], [..., C]. concentration: [..., C]."""
    return concentration / concentration.sum(axis=-1, keepdims=True)  # eq. 4


def variance(concentration: Floats) -> Floats:
    """Variance Var[theta^c], [..., C]. concentration: [..., C]."""
    mean = expectation(concentration)
    return mean * (1 - mean) / (1 + concentration.sum(axis=-1, keepdims=True))  # eq. 4


def entropy(concentration: Floats) -> Floats:
    """Differential entropy in nats, [...]. concentration: [..., C]."""
    gamma = concentration.astype(np.float64)
    total = gamma.sum(axis=-1)
    log_b = gammaln(gamma).sum(axis=-1) - gammaln(total)
    return (
        log_b
        + (total - gamma.shape[-1]) * digamma(total)
        - ((gamma - 1) * digamma(gamma)).sum(axis=-1)
    )  # eq. 5


def marginal(
    positive: Floats, total_evidence: Floats, prior: float, n_classes: int
) -> tuple[Floats, Floats]:
    """Mean and standard deviation of theta^c from the evidence for c (eq. 4), same shape.

    positive: evidence for c; total_evidence: all evidence of the views that searched for c. prior:
    concentration of each class before any view. n_classes: number of classes with "other".
    """
    total = total_evidence + prior * n_classes
    mean = (positive + prior) / total
    return mean, np.sqrt(mean * (1 - mean) / (1 + total))  # eq. 4


def concentration_of(
    positive: Floats, total_evidence: Floats, prior: float, n_classes: int = 0
) -> Floats:
    """Concentration [n, max(1 + C, n_classes)] of eq. 2: "other", the listed classes, the others.

    positive: [n, C] evidence for each listed class; total_evidence: [n] all evidence of the views
    that searched for the wanted class. "other" gets the evidence that is for no listed class.
    n_classes: number of classes with "other"; those that are not listed have only their prior.
    """
    other = np.maximum(total_evidence - positive.sum(axis=-1), 0)
    concentration = np.concatenate([other[..., None], positive], axis=-1) + prior
    n_unlisted = max(n_classes - concentration.shape[-1], 0)
    unlisted = np.full((*concentration.shape[:-1], n_unlisted), prior, concentration.dtype)
    return np.concatenate([concentration, unlisted], axis=-1)


def merged_into_other(concentration: Floats, n_listed: int) -> Floats:
    """Concentration [..., 1 + n_listed] in which "other" includes the classes that are not listed.

    concentration: [..., C], of `concentration_of`. The listed classes keep their mean and variance.
    """
    listed = concentration[..., : 1 + n_listed].copy()
    listed[..., 0] += concentration[..., 1 + n_listed :].sum(axis=-1)
    return listed


def accumulate(
    store: GaussianStore,
    rows: NDArray[np.integer],
    kappa: NDArray[np.float32],
    columns: list[int],
    weights: NDArray[np.float32],
    alpha_cpa: float,
) -> NDArray[np.int64]:
    """Add the evidence of one view to its Gaussians. Returns the indices into `rows` that changed.

    rows: [k], distinct; kappa: [k, 1 + C] summed per label, "other" first, then the context's
    classes; columns: [C] store columns of those classes; weights: [k, C] share in [0, 1] that the
    view gives a Gaussian and class. For class c, eq. 3 with the factor α_cpa (section 6.1) and the
    view's weight, which is not the paper's, is
        positive_c += weight_c * alpha_cpa * kappa_c,    total_c += weight_c * alpha_cpa * sum kappa
    so evidence never falls, and is linear in alpha_cpa.
    """
    took = np.empty(len(rows), np.int64)
    n = accumulate_kernel(
        rows,
        kappa,
        np.array(columns, np.int64),
        weights,
        np.float32(alpha_cpa),
        store.class_evidence,
        store.total_evidence,
        took,
    )
    return took[:n]


def most_likely_columns(
    positive: NDArray[np.float32],
    total_evidence: NDArray[np.float32],
    rows: NDArray[np.integer],
    context_columns: list[int],
    prior: float,
    n_classes: int,
    named_from: float = NAMED_FROM,
    core_from: float = 0.0,
) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
    """Column [k] of the most likely class of each of the rows [k], or OTHER, and its core flag [k].

    positive, total_evidence: [n, classes in the store]; n_classes: classes of the prior with
    "other". The classes of the current context compete with each other, where the first of equal
    ones wins, and with "other", the evidence that the views of a class gave to no class. The
    winner's evidence must exceed the share `named_from` of the sum of its evidence and that of
    "other". If no class of the context wins, the most likely of those classes of earlier contexts
    wins whose evidence exceeds the share `named_from` of all evidence of their views. The flag says
    whether the winner exceeds `core_from` in the same way.
    """
    present = np.array(context_columns, np.int64)
    earlier = np.setdiff1d(np.arange(positive.shape[1]), present)
    believed, in_core = np.empty(len(rows), np.int16), np.empty(len(rows), np.bool_)
    believe_kernel(
        positive, total_evidence, rows, present, earlier, prior, prior * n_classes, named_from,
        max(core_from, named_from), TIE, OTHER, believed, in_core,
    )  # fmt: skip
    return believed, in_core


@dataclass(frozen=True)
class Score:
    """Class score S, uncertainty U and the uncertainty-weighted score Psi of one instance."""

    class_score: float
    uncertainty: float
    psi: float


def score(mean: NDArray[np.floating], deviation: NDArray[np.floating], alpha_cs: float) -> Score:
    """Score of an instance. mean, deviation: [n] E and sqrt(Var) of theta^c of its Gaussians."""
    class_score = float(mean.mean(dtype=np.float64))
    uncertainty = float(deviation.mean(dtype=np.float64))
    return score_from(class_score, uncertainty, alpha_cs)


def score_from(class_score: float, uncertainty: float, alpha_cs: float) -> Score:
    """Score of an instance from its class score and uncertainty."""
    return Score(class_score, uncertainty, class_score - alpha_cs * uncertainty)  # eq. 7


@njit(cache=True, nogil=True, error_model="numpy")
def accumulate_kernel(rows, kappa, columns, weights, alpha_cpa, positive, total_evidence, took):
    """Add evidence (eq. 3) to positive and total_evidence [., columns].

    Lists in took [k] the indices into `rows` that received evidence, and returns their number.
    """
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
                total_evidence[row, columns[j]] += share * total
                some = True
        took[n] = k
        n += some
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def believe_kernel(
    positive,
    total_evidence,
    rows,
    present,
    earlier,
    prior,
    prior_total,
    named_from,
    core_from,
    tie,
    other,
    believed,
    in_core,
):
    """Fill believed [k] and in_core [k] for rows [k].

    present, earlier: store columns of the classes of the current context, and of all others.
    """
    # Evidence that a class needs for each unit of evidence for "other".
    per_other, core_per_other = named_from / (1 - named_from), core_from / (1 - core_from)
    for k in range(rows.size):
        row = rows[k]
        believed[k], in_core[k] = other, True
        best, highest = 0, -1.0
        for column in earlier:
            own, everything = positive[row, column], total_evidence[row, column]
            for_other, margin = max(everything - own, 0.0), tie * (1 + everything)
            mean = (own + prior) / (everything + prior_total)
            if own > per_other * for_other + margin and mean > highest:
                believed[k], highest = column, mean
                in_core[k] = own > core_per_other * for_other + margin
        highest, for_present = -1.0, 0.0
        for j in range(present.size):
            column = present[j]
            for_present += positive[row, column]
            mean = (positive[row, column] + prior) / (total_evidence[row, column] + prior_total)
            if mean - j * tie * 0.01 > highest:
                best, highest = column, mean - j * tie * 0.01
        if present.size:
            everything = total_evidence[row, best]
            for_other, margin = max(everything - for_present, 0.0), tie * (1 + everything)
            if positive[row, best] > per_other * for_other + margin:
                believed[k] = best
                in_core[k] = positive[row, best] > core_per_other * for_other + margin
