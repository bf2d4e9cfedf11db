"""Side and view terms of the persistent draws (`view_noise.py`) without sectors and bands.

Each term is a field of random numbers over the viewing angle, and for the view also over the
logarithm of the distance. Knots with independent standard normal numbers lie at equal steps.
Between two knots the term is their weighted sum. The squared weights add up to 1, so the term is
standard normal everywhere. Each object and purpose shifts its knots by a hashed phase, so no
direction of the world is special. Everything is hashed, and the same on any machine.

    side: 4 knots, 90 degrees apart. Mean correlation of two views 30 degrees apart: 0.88; 60: 0.61;
          90: 0.32; 120: 0.11; 180: 0.
    view: 20 knots, 18 degrees apart, times knots 0.22 apart in log distance (a factor of 1.25).
          Mean correlation at 10 degrees: 0.70; 18: 0.32; 36 or more: 0. At a distance ratio of 1.1:
          0.80; 1.25: 0.31; 1.55 or more: 0.

The steps of the view are those at which the correlation, summed over all angles and over all
distances, is that of the sectors of 30 degrees and of the mean distance band of `ovmm-v1`.
Visible pixels do not enter.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_detector.simulation.view_noise import Rows, Term, keys_of, mixed, normals

SIDE_KNOTS = 4
VIEW_KNOTS = 20
LOG_DISTANCE_STEP = 0.22
NEAREST_M = 0.05  # nearer cameras count as at this distance

_PHASES = keys_of(("phases",))
_EVEN = math.pi / 2 - 1  # makes the weights turn evenly from one knot to the next, within 1 %


@dataclass(frozen=True)
class SmoothViews:
    """The views of n objects, by continuous viewing angle and distance."""

    keys: NDArray[np.uint64]  # [n] hash of the seed and the object
    angles_rad: NDArray[np.float64]  # [n] of the camera as seen from the object, world, 0 to 2π
    distances_m: NDArray[np.float64]  # [n]

    def __len__(self) -> int:
        return len(self.keys)

    def part(self, rows: Rows) -> SmoothViews:
        """The views of these objects only."""
        return SmoothViews(self.keys[rows], self.angles_rad[rows], self.distances_m[rows])

    def side_terms(self, hashes: NDArray[np.uint64]) -> Iterator[Term]:
        """Two knots on the circle; hashes: [n, p]."""
        for knot, weight in _knots(self._turns(SIDE_KNOTS) + _phases(hashes)[0]):
            yield weight, normals(mixed(hashes, knot % np.uint64(SIDE_KNOTS)))

    def view_terms(self, hashes: NDArray[np.uint64]) -> Iterator[Term]:
        """Two knots on the circle times two in log distance; hashes: [n, p]."""
        steps = np.log(np.maximum(self.distances_m, NEAREST_M))[:, None] / LOG_DISTANCE_STEP
        of_angle, of_distance = _phases(hashes)
        far = _knots(steps + of_distance)
        for knot, weight in _knots(self._turns(VIEW_KNOTS) + of_angle):
            here = mixed(hashes, knot % np.uint64(VIEW_KNOTS))
            for far_knot, far_weight in far:
                yield weight * far_weight, normals(mixed(here, far_knot))

    def _turns(self, knots: int) -> NDArray[np.float64]:
        return self.angles_rad[:, None] * (knots / math.tau)


def _phases(hashes: NDArray[np.uint64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two independent shifts of the knots, in steps of 0 to 1, each [n, p]."""
    drawn = mixed(hashes, _PHASES)
    high, low = drawn >> np.uint64(32), drawn & np.uint64(0xFFFFFFFF)
    return high.astype(np.float64) / 2**32, low.astype(np.float64) / 2**32


def _knots(at: NDArray[np.float64]) -> list[tuple[NDArray[np.uint64], NDArray[np.float64]]]:
    """The two knots around each place, with their weights; all [n, p]. A negative knot wraps."""
    low = np.floor(at)
    after = at - low
    before = 1.0 - after
    a, b = before * (1.0 + _EVEN * after), after * (1.0 + _EVEN * before)
    size = np.sqrt(a * a + b * b)
    knot = low.astype(np.int64).view(np.uint64)
    return [(knot, a / size), (knot + np.uint64(1), b / size)]
