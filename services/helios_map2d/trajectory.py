"""The way that the robot came, thinned, as an array that published versions can share."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

MOST_POINTS = 20_000


class Trajectory:
    """Points are only appended; `points_m` is a read-only view [n, 2] that never changes."""

    def __init__(self, step_m: float, points_m: NDArray[np.float64] | None = None) -> None:
        self._step_m = step_m
        given = np.empty((0, 2)) if points_m is None else points_m[-MOST_POINTS:]
        self._n = len(given)
        self._points = np.empty((max(1024, 2 * self._n), 2))
        self._points[: self._n] = given

    def follow(self, x_m: float, y_m: float) -> None:
        """Add a place, unless the last one is near."""
        if self._n:
            last_x, last_y = self._points[self._n - 1]
            if math.hypot(x_m - last_x, y_m - last_y) < self._step_m:
                return
        if self._n == MOST_POINTS:
            kept = self._points[: self._n : 2]
            self._points = np.empty((MOST_POINTS, 2))
            self._n = len(kept)
            self._points[: self._n] = kept
        if self._n == len(self._points):
            grown = np.empty((min(MOST_POINTS, 2 * self._n), 2))
            grown[: self._n] = self._points
            self._points = grown
        self._points[self._n] = x_m, y_m
        self._n += 1

    @property
    def points_m(self) -> NDArray[np.float64]:
        view = self._points[: self._n]
        view.flags.writeable = False
        return view
