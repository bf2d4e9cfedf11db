"""How true detections are, learnt from what became of them.

A detection is as true as its thing is found again: the share of the thing's views that detect it as
the class, or 0 once it is believed no more. With a uniform Beta prior, of the detections of a class

    (1 + sum of the true ones) / (2 + number of detections)

are true, and that share of the evidence for the class counts in scores. The evidence itself stays
as it is, and so do the instances, so what is learnt never feeds on itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

BANDS_M = (1.5, 3.0)  # distances that part near, middle and far
N_BANDS = len(BANDS_M) + 1
PRIOR_TRUE, PRIOR_ALL = 1.0, 2.0

Bands = NDArray[np.float64]  # [N_BANDS] numbers of detections, or shares of them


@dataclass
class Ended:
    """Detections of things of a class that are instances no more."""

    true: Bands = field(default_factory=lambda: np.zeros(N_BANDS))
    all: Bands = field(default_factory=lambda: np.zeros(N_BANDS))

    def add(self, detections: Bands, share_true: float) -> None:
        """The detections of one thing."""
        self.true += share_true * detections
        self.all += detections


def bands(depth_m: NDArray[np.floating]) -> NDArray[np.intp]:
    """Number of the band of distances that each depth [k] is in."""
    return np.searchsorted(np.array(BANDS_M), depth_m, side="right")


def true_share(things: Iterable[tuple[Bands, float]], ended: Ended, by_distance: bool) -> Bands:
    """Share of the detections of a class that is true, per band or the same for all.

    things: detections and detection rate of each instance of the class.
    """
    true, everything = ended.true.copy(), ended.all.copy()
    for detections, rate in things:
        true += rate * detections
        everything += detections
    if not by_distance:
        true, everything = (np.full(N_BANDS, a.sum()) for a in (true, everything))
    return (PRIOR_TRUE + true) / (PRIOR_ALL + everything)


def mean_share(share: Bands, detections: Bands) -> float:
    """Mean of a share over the detections of one thing; over the bands where it has none."""
    weights = detections if detections.any() else np.ones(N_BANDS)
    return float(np.average(share, weights=weights))
