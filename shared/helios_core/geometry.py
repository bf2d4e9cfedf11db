"""Rigid transforms and the pinhole camera; see `docs/reference/frames-and-units.md`.

World: z up, metres, floor at z = 0. Base: x forward, y left. Camera: OpenCV (x right, y down,
z forward). `T_a_b` is a 4x4 matrix that maps points of b to a.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

# Rotation from camera axes (OpenCV) to a body frame with x forward, y left, z up.
R_BODY_CAM: Matrix = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])

STRAIGHT_DOWN = 1e-3  # least horizontal part of an optical axis that has a heading


@dataclass(frozen=True)
class Pinhole:
    """Intrinsics in pixels; pixel (u, v) has the ray ((u - cx) / fx, (v - cy) / fy, 1)."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @property
    def matrix(self) -> Matrix:
        """K [3, 3]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def hfov_rad(self) -> float:
        """Horizontal field of view, if the principal point is in the middle."""
        return 2.0 * math.atan(self.width / (2.0 * self.fx))

    @property
    def vfov_rad(self) -> float:
        """Vertical field of view, if the principal point is in the middle."""
        return 2.0 * math.atan(self.height / (2.0 * self.fy))


def wrap_angle(angle_rad: float) -> float:
    """Equivalent angle in (-pi, pi]."""
    return -((-angle_rad + math.pi) % (2.0 * math.pi) - math.pi)


def se2_to_se3(x_m: float, y_m: float, yaw_rad: float) -> Matrix:
    """T_world_base [4, 4] of a base on the floor."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    out = np.eye(4)
    out[:2, :2] = [[c, -s], [s, c]]
    out[:2, 3] = [x_m, y_m]
    return out


def yaw_of(T_world_base: Matrix) -> float:
    """Heading of the x axis in the ground plane, radians."""
    return math.atan2(T_world_base[1, 0], T_world_base[0, 0])


def invert(T_a_b: Matrix) -> Matrix:
    """Inverse T_b_a of a rigid transform; the result is exactly rigid."""
    out = np.eye(4)
    out[:3, :3] = T_a_b[:3, :3].T
    out[:3, 3] = -T_a_b[:3, :3].T @ T_a_b[:3, 3]
    return out


def camera_on_base(
    T_world_base: Matrix, height_m: float, tilt_rad: float, forward_m: float = 0.0
) -> Matrix:
    """T_world_cam [4, 4] of a camera above the base, tilted down by `tilt_rad`."""
    c, s = math.cos(tilt_rad), math.sin(tilt_rad)
    tilt = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    T_base_cam = np.eye(4)
    T_base_cam[:3, :3] = tilt @ R_BODY_CAM
    T_base_cam[:3, 3] = [forward_m, 0.0, height_m]
    return T_world_base @ T_base_cam


def tilt_of(T_world_cam: Matrix) -> float:
    """Angle of the optical axis below the horizontal, radians."""
    return math.asin(min(max(-float(T_world_cam[2, 2]), -1.0), 1.0))


def base_below_camera(T_world_cam: Matrix) -> Matrix:
    """T_world_base [4, 4] on the floor below the camera, with the camera's heading.

    If the camera looks straight up or down, the top of its image gives the heading.
    """
    ahead = T_world_cam[:2, 2]  # the optical axis on the ground
    if np.hypot(*ahead) < STRAIGHT_DOWN:
        ahead = -T_world_cam[:2, 1]
    x_m, y_m = (float(v) for v in T_world_cam[:2, 3])
    return se2_to_se3(x_m, y_m, math.atan2(ahead[1], ahead[0]))


def is_rigid(T_a_b: Matrix, tolerance: float = 1e-3) -> bool:
    """True if the matrix is finite, [4, 4], with a right-handed rotation and last row 0 0 0 1."""
    if T_a_b.shape != (4, 4) or not np.isfinite(T_a_b).all():
        return False
    if np.abs(T_a_b[3] - [0.0, 0.0, 0.0, 1.0]).max() >= tolerance:
        return False
    R = T_a_b[:3, :3]
    return bool(np.abs(R @ R.T - np.eye(3)).max() < tolerance and np.linalg.det(R) > 0)


def lift_pixels(depth_m: NDArray[np.float32], camera: Pinhole, T_world_cam: Matrix) -> Matrix:
    """World points [h, w, 3] (m) seen by each pixel; NaN where depth is 0."""
    height, width = depth_m.shape
    points_cam = np.empty((height, width, 3))
    x, y, z = points_cam[..., 0], points_cam[..., 1], points_cam[..., 2]
    z[...] = depth_m
    z[~(depth_m > 0)] = np.nan
    np.multiply((np.arange(width) - camera.cx) / camera.fx, z, out=x)
    np.multiply(((np.arange(height) - camera.cy) / camera.fy)[:, None], z, out=y)
    return points_cam @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]


def project(
    points_world_m: Matrix, camera: Pinhole, T_world_cam: Matrix
) -> tuple[Matrix, NDArray[np.float64]]:
    """Pixels [n, 2] and depth along the optical axis [n] of world points [n, 3].

    Points behind the camera have a depth of 0 or less; their pixels are meaningless.
    """
    p = (points_world_m - T_world_cam[:3, 3]) @ T_world_cam[:3, :3]
    z = p[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        uv = p[:, :2] / z[:, None] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    return uv, z


def quaternion_from_rotation(R: Matrix) -> tuple[float, float, float, float]:
    """Unit quaternion (x, y, z, w) of a rotation [3, 3]."""
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], 0.0, 0.0, 0.0],
            [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], 0.0, 0.0],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], 0.0],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], np.trace(R)],
        ]
    )
    _, vectors = np.linalg.eigh(K)  # the largest eigenvector of Bar-Itzhack's matrix
    x, y, z, w = (float(q) for q in vectors[:, -1])
    return (x, y, z, w) if w >= 0 else (-x, -y, -z, -w)


def rotation_from_quaternion(x: float, y: float, z: float, w: float) -> Matrix:
    """Rotation [3, 3] of a quaternion; it is normalised first."""
    n = math.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / n, y / n, z / n, w / n
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
