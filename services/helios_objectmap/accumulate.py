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
    weights: NDArray[np.float32],
    alpha_cpa: float,
) -> None:
    """Add what one view says to the evidence of the Gaussians it shows.

    rows: [k]; kappa: [k, 1 + C] summed per label, "other" first, then the context's classes;
    columns: [C] where those classes are in the store; weights: [k, C] share in [0, 1] that the view
    gives a Gaussian and class. Evidence never falls, and is linear in alpha_cpa.
    """
    total = alpha_cpa * kappa.sum(axis=1)
    for j, column in enumerate(columns):
        store.positive[rows, column] += weights[:, j] * alpha_cpa * kappa[:, 1 + j]  # eq. 3
        store.asked[rows, column] += weights[:, j] * total
