"""Simulated odometry whose errors accumulate as a random walk.

The true motion of an action is measured with errors in the base frame: errors in position and
heading grow with the square root of the distance, and errors in heading also with the square root
of the turn angle. Errors are never corrected.
"""

from __future__ import annotations

import math

import numpy as np
from helios_core.geometry import Matrix, invert, se2_to_se3, wrap_angle

from helios_sim.sensor_noise import SensorErrorModel

Pose = tuple[float, float, float]  # x, y, yaw; yaw is not wrapped


class DriftingOdometry:
    """Pose estimate of a base with drift. The same seed and motions give the same errors."""

    def __init__(
        self, sensor: SensorErrorModel, seed: int, start: Pose, reported: Pose | None = None
    ) -> None:
        """start: true pose at the start; reported: pose that the robot reports there, if it
        differs."""
        self._sensor = sensor
        self._rng = np.random.default_rng([seed, 0xD41F7])
        self._true = start
        self.estimated_pose = start if reported is None else reported
        self.is_exact = not sensor.drifts and reported is None

    def follow(self, true: Pose) -> None:
        """Measure the motion since the last call."""
        if self.is_exact:
            self._true = self.estimated_pose = true
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
        x, y, yaw = self.estimated_pose
        c, s = math.cos(yaw), math.sin(yaw)
        self.estimated_pose = (x + c * ahead - s * left, y + s * ahead + c * left, yaw + turned)
        self._true = true

    @property
    def T_estimated_true(self) -> Matrix:
        """Transform [4, 4] from the true world frame to the robot's estimated world frame."""
        if self.estimated_pose == self._true:
            return np.eye(4)
        return se2_to_se3(*self.estimated_pose) @ invert(se2_to_se3(*self._true))

    def true_point_m(self, believed_m: tuple[float, float, float]) -> tuple[float, float, float]:
        """True world position of a point given in the robot's estimated world frame."""
        T_true_believed = invert(self.T_estimated_true)
        x, y, z = T_true_believed[:3, :3] @ believed_m + T_true_believed[:3, 3]
        return float(x), float(y), float(z)


def moved(before: Pose, after: Pose) -> tuple[float, float]:
    """Distance (m) and heading change (rad) between two poses."""
    way = math.hypot(after[0] - before[0], after[1] - before[1])
    return way, wrap_angle(after[2] - before[2])
