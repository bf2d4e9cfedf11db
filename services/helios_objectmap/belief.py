"""What each Gaussian is believed to be: its most likely class."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.dirichlet import marginal
from helios_objectmap.gaussians import OTHER

# Equal beliefs must stay equal in float32, so that ties are always broken the same way.
_TIE = 1e-5
MORE_LIKELY_THAN_NOT = 0.5


def believe(
    positive: NDArray[np.float32],
    asked: NDArray[np.float32],
    context_columns: list[int],
    prior: float,
) -> NDArray[np.int16]:
    """Column of the most likely class of each Gaussian, or OTHER; [n].

    positive, asked: [n, classes in the store]. The classes of the present context compete with
    each other and with "other"; of equal ones "other" wins, then the first class. What the context
    has no name for keeps the name of an earlier context while that is more likely than not.
    """
    n, n_columns = positive.shape
    believed = np.full(n, OTHER, np.int16)
    mean, _ = marginal(positive, asked, prior, len(context_columns) + 1)
    parked = [c for c in range(n_columns) if c not in context_columns]
    if parked:
        best = np.argmax(mean[:, parked], axis=1)
        likely = mean[np.arange(n), np.array(parked)[best]] > MORE_LIKELY_THAN_NOT + _TIE
        believed[likely] = np.array(parked, np.int16)[best[likely]]
    if context_columns:
        present = mean[:, context_columns]
        best = np.argmax(present - np.arange(len(context_columns)) * _TIE * 0.01, axis=1)
        column = np.array(context_columns, np.int16)[best]
        rows = np.arange(n)
        own, everything = positive[rows, column], asked[rows, column]
        # "Other" is what the views that asked for the class gave to none of the present classes.
        other = np.maximum(everything - positive[:, context_columns].sum(axis=1), 0)
        named = own > other + _TIE * (1 + everything)
        believed[named] = column[named]
    return believed
