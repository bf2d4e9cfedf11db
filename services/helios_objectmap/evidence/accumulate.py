"""Bayesian kernel update of the evidence (section 3.1.3, eq. 3, with alpha_cpa of 6.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.kernels.evidence import accumulate_kernel
from helios_objectmap.store.gaussians import GaussianStore


def accumulate(
    store: GaussianStore,
    rows: NDArray[np.integer],
    kappa: NDArray[np.float32],
    columns: list[int],
    weights: NDArray[np.float32],
    alpha_cpa: float,
) -> NDArray[np.int64]:
    """Add what one view says to the evidence of the Gaussians it shows; which of `rows` took some.

    rows: [k], distinct; kappa: [k, 1 + C] summed per label, "other" first, then the context's
    classes; columns: [C] where those classes are in the store; weights: [k, C] share in [0, 1] that
    the view gives a Gaussian and class. For class c, eq. 3 is
        positive_c += weight_c * alpha_cpa * kappa_c,    asked_c += weight_c * alpha_cpa * sum kappa
    so evidence never falls, and is linear in alpha_cpa.
    """
    took = np.empty(len(rows), np.int64)
    n = accumulate_kernel(
        rows, kappa, np.array(columns, np.int64), weights, np.float32(alpha_cpa),
        store.positive, store.asked, took,
    )  # fmt: skip
    return took[:n]
