"""Detector precision, learnt from the views of the detected objects.

The truth of a detection is the share of the views of its object that detect the same class, or 0
once the instance is gone. With a uniform Beta prior, of the detections of a class

    (1 + sum of the true ones) / (2 + number of detections)

are true, and this share of the evidence for the class counts in scores. The evidence and the
instances stay as they are, so the learnt share never feeds back into itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

BANDS_M = (1.5, 3.0)  # limits between near, middle and far
N_BANDS = len(BANDS_M) + 1
PRIOR_TRUE, PRIOR_ALL = 1.0, 2.0

Bands = NDArray[np.float64]  # [N_BANDS] numbers of detections, or shares of them


@dataclass
class FormerDetections:
    """Detections of former instances of a class."""

    true: Bands = field(default_factory=lambda: np.zeros(N_BANDS))
    all: Bands = field(default_factory=lambda: np.zeros(N_BANDS))

    def add(self, detections: Bands, share_true: float) -> None:
        """Add the detections of one former instance."""
        self.true += share_true * detections
        self.all += detections


def bands(depth_m: NDArray[np.floating]) -> NDArray[np.intp]:
    """Distance band of each depth [k]."""
    return np.searchsorted(np.array(BANDS_M), depth_m, side="right")


def true_share(
    things: Iterable[tuple[Bands, float]], ended: FormerDetections, by_distance: bool
) -> Bands:
    """Share of true detections of a class, per band, or one value for all bands.

    things: detections and detection rate of each instance.
    """
    true, everything = ended.true.copy(), ended.all.copy()
    for detections, rate in things:
        true += rate * detections
        everything += detections
    if not by_distance:
        true, everything = (np.full(N_BANDS, a.sum()) for a in (true, everything))
    return (PRIOR_TRUE + true) / (PRIOR_ALL + everything)


def mean_share(share: Bands, detections: Bands) -> float:
    """Mean of a share over the detections of one instance; over the bands if it has none."""
    weights = detections if detections.any() else np.ones(N_BANDS)
    return float(np.average(share, weights=weights))
