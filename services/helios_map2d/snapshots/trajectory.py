"""Trajectory of the robot, thinned, as an array that published versions can share."""

from __future__ import annotations

import itertools
import math

import numpy as np
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

MOST_POINTS = 20_000


class Trajectory:
    """Positions of the robot. Points are only appended; `points_m` is an unchanging read-only view
    [n, 2].

    `starts` are the indices of points that begin a separate piece: the map has no
    frames of the path to them, so no line leads there. Raises InvalidInput for invalid starts.
    """

    def __init__(
        self,
        step_m: float,
        points_m: NDArray[np.float64] | None = None,
        starts: tuple[int, ...] = (),
    ) -> None:
        self._step_m = step_m
        given = np.empty((0, 2)) if points_m is None else points_m
        if any(b <= a for a, b in itertools.pairwise((0, *starts, len(given)))) and starts:
            raise InvalidInput(f"the pieces of a way of {len(given)} points begin at {starts}")
        left_out = max(0, len(given) - MOST_POINTS)
        self.starts = tuple(start - left_out for start in starts if start > left_out)
        self._parted = False
        self._n = len(given) - left_out
        self._points = np.empty((max(1024, 2 * self._n), 2))
        self._points[: self._n] = given[left_out:]

    def part(self) -> None:
        """Begin a separate piece with the next point."""
        self._parted = True

    def follow(self, x_m: float, y_m: float) -> None:
        """Append a point, unless the last one is near."""
        if self._n and not self._parted:
            last_x, last_y = self._points[self._n - 1]
            if math.hypot(x_m - last_x, y_m - last_y) < self._step_m:
                return
        if self._n == MOST_POINTS:
            self._thin()
        if self._n == len(self._points):
            grown = np.empty((min(MOST_POINTS, 2 * self._n), 2))
            grown[: self._n] = self._points
            self._points = grown
        if self._parted and self._n:
            self.starts = (*self.starts, self._n)
        self._parted = False
        self._points[self._n] = x_m, y_m
        self._n += 1

    def _thin(self) -> None:
        """Keep every second point."""
        kept = self._points[: self._n : 2]
        self._points = np.empty((MOST_POINTS, 2))
        self._n = len(kept)
        self._points[: self._n] = kept
        starts = sorted({(start + 1) // 2 for start in self.starts})
        if starts and starts[-1] == self._n:  # the only point of the last piece was dropped
            self._parted = starts.pop() > 0
        self.starts = tuple(starts)

    @property
    def points_m(self) -> NDArray[np.float64]:
        view = self._points[: self._n]
        view.flags.writeable = False
        return view
