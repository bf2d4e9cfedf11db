"""Bayesian kernel update of the evidence (section 3.1.3, eq. 3, with alpha_cpa of 6.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.gaussians import GaussianStore


def accumulate(
    store: GaussianStore,
    rows: NDArray[np.integer],
    kappa: NDArray[np.float32],
    columns: list[int],
    counts: NDArray[np.bool_],
    alpha_cpa: float,
) -> None:
    """Add what one view says to the evidence of the Gaussians it shows.

    rows: [k]; kappa: [k, 1 + C] summed per label, "other" first, then the context's classes;
    columns: [C] where those classes are in the store; counts: [k, C] whether the view counts for
    a Gaussian and class. Evidence never falls, and is linear in alpha_cpa.
    """
    total = alpha_cpa * kappa.sum(axis=1)
    for j, column in enumerate(columns):
        counted = counts[:, j]
        store.positive[rows, column] += np.where(counted, alpha_cpa * kappa[:, 1 + j], 0)  # eq. 3
        store.asked[rows, column] += np.where(counted, total, 0)
