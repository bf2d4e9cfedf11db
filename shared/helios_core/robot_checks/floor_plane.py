"""The floor in one depth image: a robust plane fit, and the camera's errors against it.

A plane is linear in inverse depth: 1/z = g . (x, y, 1) with the pixel's tangents x and y. Depth
cameras have about constant noise in inverse depth, so the fit minimises residuals there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_core.geometry import Matrix, Pinhole, base_below_camera

GRID_PX = 160  # width to which an image is reduced
RANGE_M = (0.3, 5.0)  # depth used
NEAR_FLOOR_M, NEAR_FLOOR_SLOPE = 0.1, 0.12  # a candidate's height: the sum of both, times distance
LEAST_PIXELS = 300  # of the reduced image
LEAST_SPREAD_M = 0.25  # standard deviation of the floor's points in each direction
TRIALS, TRIAL_POINTS = 80, 1200
TRIAL_TOLERANCE_PER_M = 0.008
LEAST_COS = math.cos(math.radians(10))  # between the plane's normal and the claimed up direction
LEAST_SHARE = 0.5  # of the candidates on the plane


@dataclass(frozen=True)
class FloorView:
    """Errors of a camera's claimed pose against the floor of one view."""

    down_rad: float  # the camera looks further down than claimed
    right_rad: float  # it leans further to the right than claimed
    distance_m: float  # camera to floor, as the depth image measures it
    higher_m: float  # that distance less the claimed height
    pixels: int


def floor_in_view(
    depth_m: NDArray[np.float32], camera: Pinhole, T_world_cam: Matrix
) -> FloorView | None:
    """Floor of a depth image [h, w] (m; 0: none), if enough of it is seen.

    The floor is claimed at z = 0 of the world. None: less than `LEAST_PIXELS` of it are seen.
    """
    rays, inverse = _candidates(depth_m, camera, T_world_cam)
    if len(inverse) < LEAST_PIXELS:
        return None
    up_cam = T_world_cam[2, :3]
    g = _largest_plane(rays, inverse, up_cam)
    if g is None:
        return None
    g, on = _refined(rays, inverse, g)
    if on.sum() < max(LEAST_PIXELS, LEAST_SHARE * len(inverse)) or not _spreads(rays, inverse, on):
        return None
    length = float(np.linalg.norm(g))
    R_heading_world = base_below_camera(T_world_cam)[:3, :3].T
    x, y, z = R_heading_world @ T_world_cam[:3, :3] @ (-g / length)
    distance_m = 1.0 / length
    return FloorView(
        down_rad=-math.atan2(x, z),
        right_rad=math.atan2(y, z),
        distance_m=distance_m,
        higher_m=distance_m - float(T_world_cam[2, 3]),
        pixels=int(on.sum()),
    )


def _candidates(
    depth_m: NDArray[np.float32], camera: Pinhole, T_world_cam: Matrix
) -> tuple[Matrix, NDArray[np.float64]]:
    """Rays [n, 3] (x, y, 1) and inverse depth [n] of pixels near the claimed floor."""
    step = max(1, round(camera.width / GRID_PX))
    z = depth_m[::step, ::step].astype(np.float64)
    v, u = np.nonzero((z > RANGE_M[0]) & (z < RANGE_M[1]))
    z = z[v, u]
    x = (u * step - camera.cx) / camera.fx
    y = (v * step - camera.cy) / camera.fy
    rays = np.stack([x, y, np.ones_like(x)], 1)
    from_cam_m = (rays * z[:, None]) @ T_world_cam[:3, :3].T
    height_m = from_cam_m[:, 2] + T_world_cam[2, 3]
    away_m = np.hypot(from_cam_m[:, 0], from_cam_m[:, 1])
    near = np.abs(height_m) < NEAR_FLOOR_M + NEAR_FLOOR_SLOPE * away_m
    near &= from_cam_m[:, 2] < 0
    return rays[near].astype(np.float64), 1.0 / z[near]


def _largest_plane(rays: Matrix, inverse: NDArray[np.float64], up_cam: Matrix) -> Matrix | None:
    """Plane g [3] with the most candidates, among those that are about level."""
    rng = np.random.default_rng(0)
    few = rng.choice(len(inverse), min(TRIAL_POINTS, len(inverse)), replace=False)
    rays, inverse = rays[few], inverse[few]
    picked = rng.integers(0, len(inverse), (TRIALS, 3))
    M = rays[picked]
    M = M[np.abs(np.linalg.det(M)) > 1e-4]
    picked = picked[np.abs(np.linalg.det(rays[picked])) > 1e-4]
    if not len(M):
        return None
    planes = np.linalg.solve(M, inverse[picked][..., None])[..., 0]
    level = -(planes @ up_cam) > LEAST_COS * np.linalg.norm(planes, axis=1)
    planes = planes[level]
    if not len(planes):
        return None
    on = np.abs(planes @ rays.T - inverse) < TRIAL_TOLERANCE_PER_M
    return planes[int(on.sum(1).argmax())]


def _refined(
    rays: Matrix, inverse: NDArray[np.float64], g: Matrix
) -> tuple[Matrix, NDArray[np.bool_]]:
    """Least squares over the inliers of g, with Tukey's weights; and the inliers [n]."""
    scale = TRIAL_TOLERANCE_PER_M / 2
    for _ in range(6):
        residual = rays @ g - inverse
        weight = np.clip(1.0 - (residual / (4.0 * scale)) ** 2, 0.0, None) ** 2
        weighted = rays * weight[:, None]
        normal = weighted.T @ rays + 1e-9 * np.eye(3)
        g = np.linalg.solve(normal, weighted.T @ inverse).astype(np.float64)
        inside = np.abs(residual) < 4.0 * scale
        scale = float(np.clip(1.48 * np.median(np.abs(residual[inside])), 4e-4, scale))
    return g, np.abs(rays @ g - inverse) < 4.0 * scale


def _spreads(rays: Matrix, inverse: NDArray[np.float64], on: NDArray[np.bool_]) -> bool:
    """True if the floor's points spread far enough to measure both tilts."""
    points: Matrix = np.divide(rays[on], inverse[on, None])
    spread_m = np.sqrt(np.clip(np.linalg.eigvalsh(np.cov(points.T)), 0.0, None))
    return bool(spread_m[1] >= LEAST_SPREAD_M)
