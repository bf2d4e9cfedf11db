"""The fake Spot's body: its links as frames, joints and capsules."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.fake_spot.scene import Capsule, Shape

Array = NDArray[np.float64]
SHOULDER = np.array([0.292, 0.0, 0.188])  # on the body
UPPER, FORE, HAND = 0.3385, 0.41, 0.19557
STANDING_M, SITTING_M = 0.52, 0.18
YELLOW = (240, 190, 30)


def pose(xyz: tuple[float, float, float], R: Array | None = None) -> Array:
    """A transform [4, 4]."""
    out = np.eye(4)
    out[:3, 3] = xyz
    if R is not None:
        out[:3, :3] = R
    return out


def yawed(yaw: float) -> Array:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


STOWED = pose((0.45, 0.0, 0.25))


def looking_at(eye: Array, point: Array) -> Array:
    """Rotation [3, 3] of a level hand at `eye` whose x axis points at `point`."""
    x = (point - eye) / max(float(np.linalg.norm(point - eye)), 1e-9)
    y = np.cross([0.0, 0.0, 1.0], x)
    y /= max(float(np.linalg.norm(y)), 1e-9)
    return np.stack([x, y, np.cross(x, y)], -1)


@dataclass(frozen=True)
class Arm:
    """Joints that place the wrist for the hand's pose; the elbow points up."""

    T_body_hand: Array

    @property
    def wrist(self) -> Array:
        return self.T_body_hand[:3, 3] - HAND * self.T_body_hand[:3, 0]

    @property
    def joints(self) -> dict[str, float]:
        d = self.wrist - SHOULDER
        yaw = math.atan2(d[1], d[0]) if math.hypot(d[0], d[1]) > 1e-6 else 0.0
        ahead, up = math.hypot(d[0], d[1]), float(d[2])
        far = min(max(math.hypot(ahead, up), 1e-6), UPPER + FORE - 1e-6)
        cos = (UPPER**2 + far**2 - FORE**2) / (2 * UPPER * far)
        lift = math.atan2(up, ahead) + math.acos(min(1.0, max(-1.0, cos)))
        return {"arm0.sh0": yaw, "arm0.sh1": -lift}

    @property
    def elbow(self) -> Array:
        yaw, pitch = self.joints["arm0.sh0"], self.joints["arm0.sh1"]
        c = math.cos(pitch)
        return SHOULDER + UPPER * np.array([math.cos(yaw) * c, math.sin(yaw) * c, -math.sin(pitch)])

    @property
    def reachable(self) -> bool:
        return bool(np.linalg.norm(self.wrist - SHOULDER) <= UPPER + FORE)

    def shapes(self, T_world_body: Array) -> dict[str, Shape]:
        """Upper arm and forearm in the world, for the body's cameras."""

        def world(p: Array) -> tuple[float, float, float]:
            x, y, z = (T_world_body @ [*p, 1.0])[:3]
            return float(x), float(y), float(z)

        a, b, c = world(SHOULDER), world(self.elbow), world(self.wrist)
        return {
            "robot upper arm": Capsule(a, b, 0.055, YELLOW),
            "robot forearm": Capsule(b, c, 0.055, YELLOW),
        }
