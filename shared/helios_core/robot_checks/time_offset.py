"""Time between a pose and the image that it comes with, from images taken while turning.

An image that is `offset_s` older than its pose shows the heading that the poses had that much
earlier. The fit finds the offset at which the poses' headings match the headings of the images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SEARCH_S = 0.3  # offsets that are searched, either way
STEP_S = 0.005
SCALES = (0.9, 1.1)  # of the poses' turns that are allowed for
LEAST_IMAGES = 4  # of one turn
LEAST_RATE_RAD_S = 0.15  # of the fastest part of a turn


@dataclass(frozen=True)
class WatchedTurn:
    """Headings during one turn, relative to its start."""

    stamps_s: NDArray[np.float64]  # [n]
    claimed_rad: NDArray[np.float64]  # [n] of the poses
    seen_rad: NDArray[np.float64]  # [n] of the images

    @property
    def usable(self) -> bool:
        """True if the turn is fast enough and has enough images."""
        if len(self.stamps_s) < LEAST_IMAGES:
            return False
        rate = np.abs(np.diff(self.claimed_rad) / np.maximum(np.diff(self.stamps_s), 1e-6))
        return bool(rate.max() >= LEAST_RATE_RAD_S)


def time_offset(turns: Sequence[WatchedTurn]) -> tuple[float, float] | None:
    """Offset (s; positive: the images are older than their poses) and its standard error; None:
    no turn is usable, or the offset is beyond `SEARCH_S`."""
    turns = [turn for turn in turns if turn.usable]
    if not turns:
        return None
    offsets = np.arange(-SEARCH_S, SEARCH_S + STEP_S / 2, STEP_S)
    costs = np.array([np.mean(_residuals(turns, d) ** 2) for d in offsets])
    k = int(costs.argmin())
    if not 0 < k < len(offsets) - 1:
        return None
    bend = costs[k - 1] - 2 * costs[k] + costs[k + 1]
    best = offsets[k] + (0.5 * STEP_S * (costs[k - 1] - costs[k + 1]) / bend if bend > 0 else 0.0)
    slope = (_residuals(turns, best + 0.01) - _residuals(turns, best - 0.01)) / 0.02
    residual = _residuals(turns, best)
    spread = max(float(residual.std()), 1e-3)
    error = spread / max(float(np.sqrt((slope**2).sum())), 1e-9)
    return float(best), float(error)


def _residuals(turns: Sequence[WatchedTurn], offset_s: float) -> NDArray[np.float64]:
    """Claimed headings `offset_s` earlier, less those of the images, all turns [n].

    The claimed headings are scaled to fit, because poses may turn a little too far.
    """
    earlier = [np.interp(t.stamps_s - offset_s, t.stamps_s, t.claimed_rad) for t in turns]
    claimed, seen = np.concatenate(earlier), np.concatenate([t.seen_rad for t in turns])
    square = float(claimed @ claimed)
    scale = float(np.clip(claimed @ seen / square, *SCALES)) if square > 0 else 1.0
    return scale * claimed - seen
