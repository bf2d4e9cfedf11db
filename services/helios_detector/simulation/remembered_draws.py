"""Persistent draws of the same purposes frame after frame, without computing all of them again.

A draw is the sum of terms that the view fixes and of one term of the frame (`view_noise.py`). The
fixed sum is remembered by object and view. The frame's term is computed only where it can move the
draw below the limit that counts. The numbers are those of `normal_draws`, bit for bit.
"""

from __future__ import annotations

import math
import threading
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from helios_detector.simulation.view_noise import (
    SectorViews,
    Shares,
    Views,
    frame_normals,
    mixed,
    normal_draws,
)

# Least value of a normal number: of the smallest uniform number, 2**-33.
LEAST_NORMAL = -math.sqrt(-2 * math.log(2.0**-33)) * 1.001
_FIRST_ROWS, _MOST_ROWS = 256, 4096

Index = NDArray[np.int64]
View = tuple[int, int, int]  # key of the object, sector and cell


class RememberedDraws:
    """Draws of p purposes for any views. Calls may come from several threads at once."""

    def __init__(self, purposes: NDArray[np.uint64], shares: Shares) -> None:
        self.purposes, self._shares = purposes, shares
        self._fixed_shares = replace(shares, frame=0.0)
        self._lock = threading.Lock()
        self._rows: dict[View, int] = {}
        self._fixed = np.empty((0, len(purposes)))

    def below(
        self, views: Views, limits: NDArray[np.float64], stamp_ns: int
    ) -> tuple[Index, Index, NDArray[np.float64]]:
        """(rows, columns, draws) of the draws below limits [n, p], column by column."""
        fixed = self._fixed_sums(views)
        scale = math.sqrt(self._shares.frame)
        columns, rows = np.nonzero((fixed < limits - LEAST_NORMAL * scale).T)
        z = fixed[rows, columns]
        if self._shares.frame > 0:
            base = mixed(views.keys[rows], self.purposes[columns])
            z += scale * frame_normals(base, stamp_ns)
        below = z < limits[rows, columns]
        return rows[below], columns[below], z[below]

    def _fixed_sums(self, views: Views) -> NDArray[np.float64]:
        """The terms [n, p] that the views fix."""
        if not isinstance(views, SectorViews):  # continuous views do not repeat
            return normal_draws(views, self.purposes, self._fixed_shares, 0)
        keys = list(
            zip(views.keys.tolist(), views.sectors.tolist(), views.cells.tolist(), strict=True)
        )
        with self._lock:
            new = {key: n for n, key in enumerate(keys) if key not in self._rows}
            if len(self._rows) + len(new) > _MOST_ROWS:
                self._rows, self._fixed = {}, self._fixed[:0]
                new = {key: n for n, key in enumerate(keys)}
            if new:
                self._remember(new, views)
            return self._fixed[[self._rows[key] for key in keys]]

    def _remember(self, new: dict[View, int], views: SectorViews) -> None:
        """Compute the rows of views that are new; new: view -> its place in `views`."""
        own = views.part(np.fromiter(new.values(), np.int64))
        known = len(self._rows)
        if known + len(new) > len(self._fixed):
            more = max(len(new), len(self._fixed), _FIRST_ROWS)
            self._fixed = np.concatenate([self._fixed, np.empty((more, len(self.purposes)))])
        self._fixed[known : known + len(new)] = normal_draws(
            own, self.purposes, self._fixed_shares, 0
        )
        self._rows |= {key: known + k for k, key in enumerate(new)}
