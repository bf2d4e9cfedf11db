"""Dirichlet semantics of a Gaussian (section 3.1.3, eq. 2-5).

theta ~ Dir(concentration), density prod theta_c^(concentration_c - 1) / B(concentration)  (eq. 2).
Evidence is kept per class name: `positive`, what spoke for the class, and `asked`, all evidence of
the views in which the class was asked for. The marginal of a Dirichlet is a Beta distribution, so
within one search context this gives exactly eq. 4; between contexts a class that was asked for
before keeps what is known of it, and a new class starts from the prior.

The prior decides how many views a belief takes. With three classes and alpha_cpa = 3, Psi passes
0.5 after this many full views of a thing that is detected always, or in 65 % of its views:

    prior 0.3: 1, 5      prior 1 (default): 2, 8      prior 3: 4, 15      prior 10: 10, 36

Classes of a Dirichlet distribution may be counted as one, their concentrations added. So a search
for few classes may have the prior of one for more, whose other classes are part of "other": it then
believes what that one would, had it never seen them (setting `prior_classes`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, gammaln

Floats = NDArray[np.floating]


def expectation(concentration: Floats) -> Floats:
    """E[theta^c], [..., C]. concentration: [..., C]."""
    return concentration / concentration.sum(axis=-1, keepdims=True)  # eq. 4


def variance(concentration: Floats) -> Floats:
    """Var[theta^c], [..., C]. concentration: [..., C]."""
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
    positive: Floats, asked: Floats, prior: float, n_classes: int
) -> tuple[Floats, Floats]:
    """Mean and standard deviation of theta^c from the evidence for c (eq. 4), same shape.

    positive, asked: evidence for c, and all evidence of the views that asked for c.
    prior: concentration of each class before any view. n_classes: classes with "other".
    """
    total = asked + prior * n_classes
    mean = (positive + prior) / total
    return mean, np.sqrt(mean * (1 - mean) / (1 + total))  # eq. 4


def concentration_of(positive: Floats, asked: Floats, prior: float, n_classes: int = 0) -> Floats:
    """Concentration [n, 1 + C], "other" first. positive: [n, C]; asked: [n], for the class wanted.

    What the views that asked for the wanted class did not give to any class is "other", and so is
    the prior of the n_classes, as far as they are more than these.
    """
    other = np.maximum(asked - positive.sum(axis=-1), 0)
    concentration = np.concatenate([other[..., None], positive], axis=-1) + prior
    concentration[..., 0] += prior * max(n_classes - concentration.shape[-1], 0)
    return concentration
