"""Where a robot believes that it is: odometry that adds up errors, as a random walk.

An action's true motion is measured with an error in the frame of the base: of position and heading
by the square root of the way, and of heading by the square root of the turn. Errors stay.
"""

from __future__ import annotations

import math

import numpy as np
from helios_core.geometry import Matrix, invert, se2_to_se3, wrap_angle

from helios_sim.sensor_noise import SensorRealism

Pose = tuple[float, float, float]  # x, y, yaw; yaw is not wrapped


class Drift:
    """Follows the true pose of a base. The same seed and motions give the same errors."""

    def __init__(self, sensor: SensorRealism, seed: int, start: Pose) -> None:
        self._sensor = sensor
        self._rng = np.random.default_rng([seed, 0xD41F7])
        self._true = self.believed = start

    def follow(self, true: Pose) -> None:
        """Measure the motion since the last call."""
        if not self._sensor.drifts:
            self._true = self.believed = true
            return
        x, y, yaw = self._true
        dx, dy, turned = true[0] - x, true[1] - y, true[2] - yaw
        c, s = math.cos(yaw), math.sin(yaw)
        way = math.hypot(dx, dy)
        errors = self._rng.standard_normal(4)
        drift_m = self._sensor.drift_m * math.sqrt(way)
        ahead = c * dx + s * dy + drift_m * errors[0]
        left = c * dy - s * dx + drift_m * errors[1]
        turned += self._sensor.drift_rad * math.sqrt(way) * errors[2]
        turned += self._sensor.turn_drift_rad * math.sqrt(abs(true[2] - yaw)) * errors[3]
        x, y, yaw = self.believed
        c, s = math.cos(yaw), math.sin(yaw)
        self.believed = (x + c * ahead - s * left, y + s * ahead + c * left, yaw + turned)
        self._true = true

    @property
    def T_believed_true(self) -> Matrix:
        """Takes points of the true world to where the robot believes them [4, 4]."""
        if self.believed == self._true:
            return np.eye(4)
        return se2_to_se3(*self.believed) @ invert(se2_to_se3(*self._true))

    def true_point_m(self, believed_m: tuple[float, float, float]) -> tuple[float, float, float]:
        """Where a point truly is that the robot names in its own frame."""
        T_true_believed = invert(self.T_believed_true)
        x, y, z = T_true_believed[:3, :3] @ believed_m + T_true_believed[:3, 3]
        return float(x), float(y), float(z)


def moved(before: Pose, after: Pose) -> tuple[float, float]:
    """Metres and radians between two poses."""
    way = math.hypot(after[0] - before[0], after[1] - before[1])
    return way, wrap_angle(after[2] - before[2])
