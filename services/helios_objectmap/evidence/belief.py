"""What each Gaussian is believed to be: its most likely class."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.kernels.evidence import believe_kernel
from helios_objectmap.store.gaussians import OTHER

# Equal beliefs must stay equal in float32, so that ties are always broken the same way.
TIE = 1e-5
NAMED_FROM = 0.5


def believe(
    positive: NDArray[np.float32],
    asked: NDArray[np.float32],
    rows: NDArray[np.integer],
    context_columns: list[int],
    prior: float,
    n_classes: int,
    named_from: float = NAMED_FROM,
) -> NDArray[np.int16]:
    """Column of the most likely class of each of the rows [k], or OTHER; [k].

    positive, asked: [n, classes in the store]; n_classes: classes of the prior with "other". The
    classes of the present context compete with each other, the first of equal ones wins, and with
    "other", which is what the views that asked for a class gave to none of them: the class must
    have more than the share `named_from` of what speaks for either. What the context has no name
    for keeps the name of an earlier context while its probability is above `named_from`.
    """
    parked = [c for c in range(positive.shape[1]) if c not in context_columns]
    believed = np.empty(len(rows), np.int16)
    believe_kernel(
        positive, asked, rows, np.array(context_columns, np.int64), np.array(parked, np.int64),
        prior, prior * n_classes, named_from, named_from / (1 - named_from), TIE, OTHER, believed,
    )  # fmt: skip
    return believed
