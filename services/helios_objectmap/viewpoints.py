"""Views, not frames: which evidence a frame may give.

A camera that rests on a false detection would outvote every other view. Viewpoints are poses that
differ from each other by a set distance or a set turn; a frame belongs to the nearest one it does
not differ from, or becomes a new one. What a viewpoint shows is the same each time, so it counts
once for each Gaussian and class: a Gaussian takes evidence for a class from a viewpoint only if it
was made after that viewpoint last counted for that class.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NEVER = -1


class Viewpoints:
    """Poses from which evidence was taken, and the update at which each last counted."""

    def __init__(self, moved_m: float, turned_rad: float) -> None:
        self._moved_m = moved_m
        self._cos_turned = float(np.cos(turned_rad))
        self._n = 0
        self._positions = np.empty((16, 3))
        self._rotations = np.empty((16, 3, 3))
        self._last: dict[str, NDArray[np.int64]] = {}

    def __len__(self) -> int:
        return self._n

    def match(self, T_world_cam: NDArray[np.float64]) -> int:
        """Number of the viewpoint a pose belongs to; a pose that differs from all is a new one."""
        position, rotation = T_world_cam[:3, 3], T_world_cam[:3, :3]
        known_positions = self._positions[: self._n]
        distance = np.linalg.norm(known_positions - position, axis=1)
        near = np.flatnonzero(distance < self._moved_m)
        if len(near):
            # cos of the angle between two rotations: (trace(A^T B) - 1) / 2
            cos = (np.einsum("nij,ij->n", self._rotations[near], rotation) - 1) / 2
            near = near[cos > self._cos_turned]
        if len(near):
            return int(near[np.argmin(distance[near])])
        if self._n == len(self._positions):
            self._positions = np.concatenate([self._positions, np.empty_like(self._positions)])
            self._rotations = np.concatenate([self._rotations, np.empty_like(self._rotations)])
        self._positions[self._n] = position
        self._rotations[self._n] = rotation
        self._n += 1
        return self._n - 1

    def counts(
        self, viewpoint: int, class_names: list[str], born: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Whether Gaussians born [n] take evidence from this viewpoint, [n, classes]."""
        last = np.array([self._last_of(name)[viewpoint] for name in class_names], np.int64)
        return born[:, None] > last[None, :]

    def mark(self, viewpoint: int, class_names: list[str], update: int) -> None:
        """Note that the viewpoint counted for these classes at this update."""
        for name in class_names:
            self._last_of(name)[viewpoint] = update

    def _last_of(self, class_name: str) -> NDArray[np.int64]:
        last = self._last.get(class_name, np.empty(0, np.int64))
        if len(last) < self._n:
            grown = np.full(len(self._positions), NEVER, np.int64)
            grown[: len(last)] = last
            last = self._last[class_name] = grown
        return last
