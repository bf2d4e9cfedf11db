"""What goes first when there are too many Gaussians.

Those that are believed to be nothing that was asked for, of these the ones unseen the longest; then
all others, again the ones unseen the longest. A tenth more than needed goes, so that it is rare.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.store.gaussians import OTHER

KEPT = 0.9


def surplus(believed: NDArray[np.int16], seen: NDArray[np.int64], most: int) -> NDArray[np.intp]:
    """Rows to remove, so that at most KEPT * most are left; none while there are at most `most`.

    believed: [n] column of the class, or OTHER; seen: [n] number of the last update that saw it.
    """
    if len(believed) <= most:
        return np.empty(0, np.intp)
    order = np.lexsort((seen, believed != OTHER))
    return order[: len(believed) - int(KEPT * most)]
