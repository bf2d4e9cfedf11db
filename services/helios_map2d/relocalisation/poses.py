"""Rigid transforms of the ground plane."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from helios_core.geometry import wrap_angle
from numpy.typing import NDArray

Points = NDArray[np.float64]  # [n, 2] m


@dataclass(frozen=True)
class Transform2:
    """Transform `T_a_b` of points of frame b to frame a: a turn by `yaw_rad`, then a shift (m)."""

    x_m: float
    y_m: float
    yaw_rad: float

    def __matmul__(self, other: Transform2) -> Transform2:
        """T_a_c of T_a_b and T_b_c."""
        x, y = self.of(np.array([[other.x_m, other.y_m]]))[0]
        return Transform2(float(x), float(y), wrap_angle(self.yaw_rad + other.yaw_rad))

    @property
    def inverse(self) -> Transform2:
        """T_b_a"""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x, y = -(c * self.x_m + s * self.y_m), s * self.x_m - c * self.y_m
        return Transform2(x, y, -self.yaw_rad)

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Rotation [2, 2]."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.array([[c, -s], [s, c]])

    def of(self, points_m: Points) -> Points:
        """Points [n, 2] of frame b in frame a."""
        return points_m @ self.rotation.T + (self.x_m, self.y_m)

    def difference(self, other: Transform2, around_m: Points) -> tuple[float, float]:
        """Distance (m) between the two images of a point [2] of frame b, and angle (rad) between
        the two turns."""
        a, b = self.of(around_m[None])[0], other.of(around_m[None])[0]
        return float(np.hypot(*(a - b))), abs(wrap_angle(self.yaw_rad - other.yaw_rad))
