"""Scores of an instance for a class (section 3.1.3, eq. 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Score:
    """Class score S, uncertainty U and the uncertainty-weighted score Psi of one instance."""

    class_score: float
    uncertainty: float
    psi: float


def score(mean: NDArray[np.floating], deviation: NDArray[np.floating], alpha_cs: float) -> Score:
    """Score an instance. mean, deviation: [n] E and sqrt(Var) of theta^c of its Gaussians."""
    class_score = float(mean.mean(dtype=np.float64))
    uncertainty = float(deviation.mean(dtype=np.float64))
    return weighed(class_score, uncertainty, alpha_cs)


def weighed(class_score: float, uncertainty: float, alpha_cs: float) -> Score:
    """The score of an instance whose class score and uncertainty are known."""
    return Score(class_score, uncertainty, class_score - alpha_cs * uncertainty)  # eq. 7
