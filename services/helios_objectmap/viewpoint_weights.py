"""Weights of views: share of its evidence that a frame gives, by distance from earlier views.

A camera at rest on a false detection would outvote every other view. So the weight of a view is its
difference from the views that have counted before: 0 at such a view, 1 from a set distance or turn
away, and in proportion between. Along a path the weights add up to its length over that distance,
so a camera at 5 Hz and one at 30 Hz give the same evidence, as long as the steps of the slower one
are not longer than that distance, where the weight saturates at 1.

A viewpoint always shows the same, so it counts once for each Gaussian and class: only viewpoints
that counted for the class since the Gaussian was created reduce the weight of a view.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FIRST_UPDATE = 0  # number of the first update of a map
NEVER = -1  # in place of an update or a viewpoint
# A view counts in full from this distance or turn: just below the smallest steps of the paper.
MOVED_M, TURNED_RAD = 0.08, math.radians(4)
# Poses closer than this share of the set distance or turn are the same: jitter adds nothing.
SAME = 0.25
MOST = 16_384  # at least 300 m of path; the oldest viewpoints are dropped, and may count again


@dataclass(frozen=True)
class ViewpointMatch:
    """Pose of a view relative to the viewpoints."""

    viewpoint: int  # number of the viewpoint that the pose belongs to
    near: NDArray[np.intp]  # [k] viewpoints at a difference below 1
    difference: NDArray[np.float64]  # [k] difference from each, in shares of the set limits


class Viewpoints:
    """Poses that gave evidence, and the last update at which each counted, per class."""

    def __init__(
        self, moved_m: float = MOVED_M, turned_rad: float = TURNED_RAD, all_in_full: bool = False
    ) -> None:
        """all_in_full: every view has weight 1, as in the paper."""
        self._all_in_full = all_in_full
        self._moved_m = moved_m
        self._turned_rad = turned_rad
        self._made = 0  # viewpoints so far, the dropped ones included
        self._positions = np.empty((16, 3))
        self._rotations = np.empty((16, 3, 3))
        self._last: dict[str, NDArray[np.int64]] = {}

    def __len__(self) -> int:
        return min(self._made, MOST)

    def arrays(self) -> dict[str, NDArray]:
        """Copies of all data."""
        n = len(self)
        last = {f"last.{name}": self._last_of(name)[:n].copy() for name in self._last}
        return last | {
            "positions": self._positions[:n].copy(),
            "rotations": self._rotations[:n].copy(),
            "made": np.array(self._made),
        }

    def fill(self, arrays: dict[str, NDArray]) -> None:
        """Load the data of `arrays()`. Raises ValueError if it is inconsistent."""
        self._made = int(arrays["made"])
        n = len(self)
        size = 16
        while size < n:
            size *= 2
        self._positions, self._rotations = np.empty((size, 3)), np.empty((size, 3, 3))
        self._positions[:n] = arrays["positions"]
        self._rotations[:n] = arrays["rotations"]
        if n < 0 or not np.isfinite([*self._positions[:n].flat, *self._rotations[:n].flat]).all():
            raise ValueError("a viewpoint is not finite")
        for name, last in arrays.items():
            if name.startswith("last."):
                kept = self._last[name.removeprefix("last.")] = np.full(size, NEVER, np.int64)
                kept[:n] = last

    def forget(self, class_name: str) -> None:
        """Drop the data of a class."""
        self._last.pop(class_name, None)

    def locate(self, T_world_cam: NDArray[np.float64]) -> ViewpointMatch:
        """Place of a pose among the viewpoints. One that differs from all becomes a viewpoint."""
        difference = self._differences(T_world_cam)
        nearest = int(np.argmin(difference)) if len(difference) else NEVER
        near = np.flatnonzero(difference < 1)
        if nearest == NEVER or difference[nearest] >= SAME:
            nearest = self._new(T_world_cam)
            near = near[near != nearest]  # if it reuses the number of a dropped one
        return ViewpointMatch(nearest, near, difference[near])

    def weights(
        self, look: ViewpointMatch, class_names: list[str], born: NDArray[np.int64]
    ) -> NDArray[np.float32]:
        """Weight [n, classes] in [0, 1] of a view for Gaussians that update born [n] created."""
        out = np.ones((len(born), len(class_names)), np.float32)
        if self._all_in_full:
            return out
        known: dict[bytes, int] = {}  # classes searched for in the same views share their weights
        for j, name in enumerate(class_names):
            last = self._last_of(name)[look.near]
            same = known.setdefault(last.tobytes(), j)
            if same != j:
                out[:, j] = out[:, same]
                continue
            order = np.argsort(last, kind="stable")
            # Smallest difference from viewpoints that counted at an update or later, per update.
            least = np.minimum.accumulate(look.difference[order][::-1])[::-1]
            share = np.append(np.where(least < SAME, 0.0, least), 1.0)
            out[:, j] = share[np.searchsorted(last[order], born)]
        return out

    def weights_of_view(self, look: ViewpointMatch, class_names: list[str]) -> NDArray[np.float32]:
        """Weight [classes] in [0, 1] of a view beside all earlier views that counted for the class.

        It is 1 for a class that no search named before.
        """
        return self.weights(look, class_names, np.array([FIRST_UPDATE]))[0]

    def mark(self, look: ViewpointMatch, class_names: list[str], update: int) -> None:
        """Note that a view counted for these classes at this update."""
        for name in class_names:
            self._last_of(name)[look.viewpoint] = update

    def difference_from(
        self, look: ViewpointMatch, viewpoints: NDArray[np.integer]
    ) -> NDArray[np.float64]:
        """Difference [n] in [0, 1] of a view from some viewpoints [n]; 1 for NEVER."""
        known = np.ones(len(self) + 1)  # index -1 (NEVER) is the last element
        known[look.near] = look.difference
        known[look.viewpoint] = 0.0
        return np.minimum(known[viewpoints], 1.0)

    def _differences(self, T_world_cam: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share moved plus share turned [viewpoints], like a robot that first moves, then turns."""
        n = len(self)
        position, rotation = T_world_cam[:3, 3], T_world_cam[:3, :3]
        out = np.linalg.norm(self._positions[:n] - position, axis=1) / self._moved_m
        near = np.flatnonzero(out < 1)
        # Angle between two rotations from their Frobenius distance: |A - B|^2 = 8 sin^2(angle / 2).
        chord = np.linalg.norm(self._rotations[near] - rotation, axis=(1, 2))
        turned = 2 * np.arcsin(np.minimum(chord / np.sqrt(8), 1))
        out[near] += turned / self._turned_rad
        return out

    def _new(self, T_world_cam: NDArray[np.float64]) -> int:
        number = self._made % MOST
        if number >= len(self._positions):
            self._positions = np.concatenate([self._positions, np.empty_like(self._positions)])
            self._rotations = np.concatenate([self._rotations, np.empty_like(self._rotations)])
        self._positions[number] = T_world_cam[:3, 3]
        self._rotations[number] = T_world_cam[:3, :3]
        for last in self._last.values():
            last[number : number + 1] = NEVER
        self._made += 1
        return number

    def _last_of(self, class_name: str) -> NDArray[np.int64]:
        last = self._last.get(class_name, np.empty(0, np.int64))
        if len(last) < len(self):
            grown = np.full(len(self._positions), NEVER, np.int64)
            grown[: len(last)] = last
            last = self._last[class_name] = grown
        return last
