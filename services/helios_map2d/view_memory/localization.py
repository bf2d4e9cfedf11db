"""Where in a view a thing is likely to be, from how well every view of that ground fits.

One view tells a direction and no distance. But ground that fitting views have in common, and that
others did not see, is more likely than the rest. So each cell gets the mean score of the views that
saw it, by their confidence there, as if a few views with the usual score had seen it too: ground
that one view alone saw cannot beat what several agree on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from helios_map2d.grid import EMPTY, Box, GridSpec
from helios_map2d.layers.value_layers import Cone, ValueRules, spread_over

CELL_M = 0.10
MOST_CELLS = 4_000_000  # of larger ground the cells are larger
DOUBT = 2.0  # so many views, with the usual score, count everywhere
NEAR_BEST = 0.99  # the place is the middle of the cells that are nearly as good as the best


class Localization:
    """Likely places of one thing; `fit` float64 [rows, columns] over all ground that was seen."""

    def __init__(self, seen: Sequence[tuple[Cone, float]]) -> None:
        """seen: what each view covered, and how well it fits (0 to 1)."""
        box = _around(seen, CELL_M)
        cell_m = CELL_M * math.ceil(max(1.0, math.sqrt(box.rows * box.columns / MOST_CELLS)))
        self._grid = GridSpec.over(_around(seen, cell_m), cell_m)
        usual = float(np.median([score for _, score in seen])) if seen else 0.0
        total = np.full(self._grid.shape, DOUBT)
        self.fit = np.full(self._grid.shape, DOUBT * usual)
        for cone, score in seen:
            at, confidence = self._spread(cone)
            total[at] += confidence
            self.fit[at] += score * confidence
        self.fit /= total

    def within(self, cone: Cone) -> tuple[float, float]:
        """World x, y (m) of the likeliest place that a view covered; where its camera stood when
        it measured nothing."""
        at, confidence = self._spread(cone)
        fit = np.where(confidence > 0, self.fit[at], -1.0)
        if not fit.size or fit.max() < 0:
            return cone.x_m, cone.y_m
        row, column = np.argwhere(fit >= NEAR_BEST * fit.max()).mean(axis=0)
        x_m, y_m = self._grid.centre_of(at[0].start, at[1].start)
        return x_m + float(column) * self._grid.cell_m, y_m + float(row) * self._grid.cell_m

    def _spread(self, cone: Cone) -> tuple[tuple[slice, slice], NDArray[np.float32]]:
        """The confidence of a view and the part of the grid that it is over."""
        cell_m = self._grid.cell_m
        box = cone.box(cell_m)
        confidence, _ = spread_over(box, cone, cell_m, ValueRules.least_confidence)
        return self._grid.to_local(box).slices, confidence


def _around(seen: Sequence[tuple[Cone, float]], cell_m: float) -> Box:
    out = EMPTY
    for cone, _ in seen:
        out = out.union(cone.box(cell_m))
    return out
