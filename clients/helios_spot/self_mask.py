"""Mask of the pixels that show the robot, so that arm and body do not become obstacles on the map.

A few capsules in the body frame model the robot. The depth of a pixel whose ray meets one is set to
0, which every map treats as "not seen".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from helios_core.geometry import Matrix, Pinhole
from numpy.typing import NDArray

SHOULDER_BODY_M = (0.292, 0.0, 0.188)  # from Boston Dynamics' model of the robot
UPPER_ARM_M = 0.3385
ARM_RADIUS_M, HAND_RADIUS_M, BODY_RADIUS_M, HELD_RADIUS_M = 0.08, 0.10, 0.13, 0.12
FINGERS_M = 0.12  # ahead of the hand's frame
BODY_HALF_M = 0.40
BODY_SIDES_M = (-0.13, 0.0, 0.13)
STRIDE = 4  # rays are cast for every fourth pixel

Point = NDArray[np.float64]


@dataclass(frozen=True)
class Capsule:
    """All points within a radius of a line segment; body frame, metres."""

    a_m: Point
    b_m: Point
    radius_m: float


def robot_capsules(
    joints_rad: Mapping[str, float],
    T_body_wrist: Matrix | None,
    T_body_hand: Matrix | None,
    holding: bool,
) -> list[Capsule]:
    """Capsules of the body and the arm, if any. joints_rad: arm joints, named like `arm0.sh0`."""
    out = [
        Capsule(np.array([-BODY_HALF_M, y, 0.0]), np.array([BODY_HALF_M, y, 0.0]), BODY_RADIUS_M)
        for y in BODY_SIDES_M
    ]
    if T_body_wrist is None or T_body_hand is None:
        return out
    shoulder = np.array(SHOULDER_BODY_M)
    yaw, pitch = joints_rad.get("arm0.sh0"), joints_rad.get("arm0.sh1")
    wrist, hand = T_body_wrist[:3, 3], T_body_hand[:3, 3]
    if yaw is None or pitch is None:
        out.append(Capsule(shoulder, wrist, ARM_RADIUS_M))
    else:
        along = np.array(
            [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)]
        )
        elbow = shoulder + UPPER_ARM_M * along
        out += [Capsule(shoulder, elbow, ARM_RADIUS_M), Capsule(elbow, wrist, ARM_RADIUS_M)]
    tip = hand + FINGERS_M * T_body_hand[:3, 0]
    out.append(Capsule(wrist, tip, HAND_RADIUS_M))
    if holding:
        out.append(Capsule(tip, tip + HELD_RADIUS_M * T_body_hand[:3, 0], HELD_RADIUS_M))
    return out


def robot_pixels(capsules: list[Capsule], T_body_cam: Matrix, camera: Pinhole) -> NDArray[np.bool_]:
    """Mask [h, w] of the pixels whose ray meets one of the capsules, and their neighbours.

    A capsule that contains the camera itself is ignored.
    """
    rows = np.arange(0, camera.height, STRIDE)
    columns = np.arange(0, camera.width, STRIDE)
    u, v = np.meshgrid(columns, rows)
    rays = np.stack(
        [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1
    )
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ T_body_cam[:3, :3].T
    eye = T_body_cam[:3, 3]
    hit = np.zeros(u.shape, np.bool_)
    for capsule in capsules:
        if _distance_m(eye, capsule) > capsule.radius_m:
            hit |= _nearest_m(eye, rays, capsule) <= capsule.radius_m
    # Dilation by one ray covers parts of the robot between the sampled rays.
    wide = cv2.dilate(hit.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    fine = np.repeat(np.repeat(wide, STRIDE, 0), STRIDE, 1)
    return fine[: camera.height, : camera.width]


def _distance_m(point: Point, capsule: Capsule) -> float:
    along = capsule.b_m - capsule.a_m
    t = float(np.clip((point - capsule.a_m) @ along / max(float(along @ along), 1e-12), 0, 1))
    return float(np.linalg.norm(point - capsule.a_m - t * along))


def _nearest_m(eye: Point, rays: NDArray[np.float64], capsule: Capsule) -> NDArray[np.float64]:
    """Distance [h, w] between rays (unit vectors [h, w, 3]) from `eye` and the capsule's line."""
    along = capsule.b_m - capsule.a_m
    offset = eye - capsule.a_m
    a, b, c = float(along @ along), rays @ along, rays @ offset
    d = float(along @ offset)
    spread = np.maximum(a - b * b, 1e-9)
    t = np.clip((d - b * c) / spread, 0.0, 1.0)  # on the segment; then the ray, then again
    s = np.maximum(t * b - c, 0.0)
    t = np.clip((s * b + d) / max(a, 1e-12), 0.0, 1.0)
    s = np.maximum(t * b - c, 0.0)
    gap = offset + s[..., None] * rays - t[..., None] * along
    return np.linalg.norm(gap, axis=-1)
