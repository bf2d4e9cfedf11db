"""Objects as landmarks: agreement of the classes that two maps believe in at one place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from helios_map2d.relocalisation.poses import Transform2

NEAR_M = 0.4  # horizontal distance of two centres that may be the same object
HEIGHT_M = 0.4  # difference of their heights
SIGMA_M = 0.2
WORTH_M = 1.0  # surface that two certain objects at one place are worth


@dataclass(frozen=True)
class Landmark:
    """Believed object of a map."""

    center_m: tuple[float, float, float]  # in the frame of its map
    probabilities: Mapping[str, float]  # of each class; the rest is "other"


def landmark_score_m(
    stored: Sequence[Landmark], present: Sequence[Landmark], T_stored_present: Transform2
) -> float:
    """Evidence of objects for a transform, in metres of agreeing surface; never below 0.

    Each stored object counts once, for the present one that agrees best. An object that is not
    where it was counts neither for nor against, because people move objects.
    """
    if not stored or not present:
        return 0.0
    theirs, ours = (np.array([one.center_m for one in side]) for side in (stored, present))
    moved = T_stored_present.of(ours[:, :2])
    away = np.hypot(*(moved[:, None] - theirs[None, :, :2]).transpose(2, 0, 1))
    level = np.abs(ours[:, None, 2] - theirs[None, :, 2]) < HEIGHT_M
    score = np.zeros_like(away)
    for i, j in zip(*np.nonzero((away < NEAR_M) & level), strict=True):
        same = sum(
            p * stored[j].probabilities.get(name, 0.0)
            for name, p in present[i].probabilities.items()
        )
        score[i, j] = WORTH_M * same * np.exp(-0.5 * (away[i, j] / SIGMA_M) ** 2)
    total = 0.0
    while score.max() > 0:  # pairs, best first
        i, j = np.unravel_index(int(np.argmax(score)), score.shape)
        total += float(score[i, j])
        score[i, :], score[:, j] = 0.0, 0.0
    return total
