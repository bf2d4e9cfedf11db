"""Localization of an object within stored views, from the scores of all views of the same ground.

A single view gives a direction but no distance. Ground that high-scoring views share, and that
others did not see, is more likely to hold the object. So each cell gets the mean score of the views
that saw it, weighted by their confidence there, plus VIRTUAL_VIEWS virtual views with the median
score: ground that only one view saw cannot beat ground on which several agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from helios_map2d.grid import EMPTY, Box, GridSpec
from helios_map2d.layers.value_layers import Cone, ValueRules, spread_over

CELL_M = 0.10
MOST_CELLS = 4_000_000  # larger ground gets larger cells
VIRTUAL_VIEWS = 2.0  # number of virtual views with the median score in every cell
NEAR_BEST = 0.99  # the place is the mean of the cells within this share of the best


class Localization:
    """Likely places of one object; `fit` float64 [rows, columns]: score of all seen ground."""

    def __init__(self, seen: Sequence[tuple[Cone, float]]) -> None:
        """seen: cone and score (0 to 1) of each view."""
        box = _around(seen, CELL_M)
        cell_m = CELL_M * math.ceil(max(1.0, math.sqrt(box.rows * box.columns / MOST_CELLS)))
        self._grid = GridSpec.over(_around(seen, cell_m), cell_m)
        usual = float(np.median([score for _, score in seen])) if seen else 0.0
        total = np.full(self._grid.shape, VIRTUAL_VIEWS)
        self.fit = np.full(self._grid.shape, VIRTUAL_VIEWS * usual)
        for cone, score in seen:
            at, confidence = self._spread(cone)
            total[at] += confidence
            self.fit[at] += score * confidence
        self.fit /= total

    def within(self, cone: Cone) -> tuple[float, float]:
        """World x, y (m) of the most likely place within a view; its camera position if the view
        measured nothing."""
        at, confidence = self._spread(cone)
        fit = np.where(confidence > 0, self.fit[at], -1.0)
        if not fit.size or fit.max() < 0:
            return cone.x_m, cone.y_m
        row, column = np.argwhere(fit >= NEAR_BEST * fit.max()).mean(axis=0)
        x_m, y_m = self._grid.centre_of(at[0].start, at[1].start)
        return x_m + float(column) * self._grid.cell_m, y_m + float(row) * self._grid.cell_m

    def _spread(self, cone: Cone) -> tuple[tuple[slice, slice], NDArray[np.float32]]:
        """Confidence of a view, and the part of the grid that it covers."""
        cell_m = self._grid.cell_m
        box = cone.box(cell_m)
        confidence, _ = spread_over(box, cone, cell_m, ValueRules.least_confidence)
        return self._grid.to_local(box).slices, confidence


def _around(seen: Sequence[tuple[Cone, float]], cell_m: float) -> Box:
    out = EMPTY
    for cone, _ in seen:
        out = out.union(cone.box(cell_m))
    return out
