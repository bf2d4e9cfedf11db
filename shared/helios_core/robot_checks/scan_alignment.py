"""Relative motion of a camera from two depth images: point-to-plane alignment.

Each image becomes a field of small planes, fitted in inverse depth over a window
(`floor_plane` explains why). The alignment finds the motion that puts the points of one image onto
the planes of the other. It starts from the claimed motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_core.geometry import Matrix, Pinhole

GRID_PX = 320  # width to which an image is reduced
WINDOW_PX = 9  # of the reduced image
RANGE_M = (0.4, 4.5)
LEAST_VALID = 0.8  # share of a window with depth
FLAT_PER_M = 0.004  # largest spread of inverse depth about a window's plane
STRIDE_PX = 2  # of the planes, for the points
LEAST_POINTS = 250
ITERATIONS = 12
WIDEST_PER_M, NARROWEST_PER_M = 0.06, 0.003  # scale of the robust weights, start and end
SAME_NORMAL = 0.85  # least cosine between the normals of a point and its plane
INDEPENDENT = 60.0  # neighbouring residuals per independent one
TRIAL_YAWS_RAD = np.radians(np.arange(-24.0, 24.1, 3.0))


@dataclass(frozen=True)
class PlaneField:
    """Planes of a depth image: g [h, w, 3] with g . p = 1 (camera frame, m); NaN where none."""

    g: NDArray[np.float64]
    camera: Pinhole  # of the reduced image


@dataclass(frozen=True)
class Alignment:
    """Measured motion T_b_a [4, 4] between two camera poses."""

    T_b_a: Matrix
    covariance: Matrix  # [6, 6] of rotation (rad) and translation (m), frame of b
    points: int
    share: float  # of the points that fit


def plane_field(depth_m: NDArray[np.float32], camera: Pinhole) -> PlaneField:
    """Planes of a depth image [h, w] (m; 0: none)."""
    step = max(1, round(camera.width / GRID_PX))
    z = depth_m[::step, ::step].astype(np.float64)
    valid = (z > RANGE_M[0]) & (z < RANGE_M[1])
    i = np.divide(1.0, z, out=np.zeros_like(z), where=valid)
    m = valid.astype(np.float64)
    v, u = np.mgrid[0 : z.shape[0], 0 : z.shape[1]].astype(np.float64)
    sums = [_mean(a) for a in (m, m * u, m * v, m * u * u, m * u * v, m * v * v)]
    sums += [_mean(a) for a in (i, i * u, i * v, i * i)]
    n, su, sv, suu, suv, svv, si, siu, siv, sii = sums
    u, v = u[::2, ::2], v[::2, ::2]
    # Offsets from each window's centre keep the sums small.
    suu, svv = suu - 2 * u * su + u * u * n, svv - 2 * v * sv + v * v * n
    suv = suv - u * sv - v * su + u * v * n
    siu, siv, su, sv = siu - u * si, siv - v * si, su - u * n, sv - v * n
    A = np.stack([n, su, sv, su, suu, suv, sv, suv, svv], -1).reshape(*n.shape, 3, 3)
    enough = (n > LEAST_VALID) & valid[::2, ::2]
    b = np.stack([si, siu, siv], -1)
    c = np.full_like(b, np.nan)
    c[enough] = np.linalg.solve(A[enough], b[enough][..., None])[..., 0]
    c[~(sii - (c * b).sum(-1) <= n * FLAT_PER_M**2)] = np.nan
    step *= 2
    small = Pinhole(
        camera.fx / step,
        camera.fy / step,
        camera.cx / step,
        camera.cy / step,
        n.shape[1],
        n.shape[0],
    )
    x, y = (u / 2 - small.cx) / small.fx, (v / 2 - small.cy) / small.fy
    gx, gy = 2 * c[..., 1] * small.fx, 2 * c[..., 2] * small.fy  # per tangent
    return PlaneField(np.stack([gx, gy, c[..., 0] - gx * x - gy * y], -1), small)


def _mean(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over a window about every other pixel."""
    size = (WINDOW_PX, WINDOW_PX)
    means = cv2.boxFilter(image, -1, size, borderType=cv2.BORDER_CONSTANT)
    return means[::2, ::2].astype(np.float64, copy=False)


def align(a: PlaneField, b: PlaneField, T_b_a: Matrix, search: bool = False) -> Alignment | None:
    """Motion that puts the points of `a` onto the planes of `b`; None if they share too little.

    T_b_a: the claimed motion. search: also try starts that are turned by up to 24 degrees about
    the camera's vertical axis.
    """
    points, normals = _points(a)
    if len(points) < LEAST_POINTS:
        return None
    T = _best_start(points, normals, b, T_b_a) if search else T_b_a
    scale = WIDEST_PER_M
    H, r, on = np.eye(6), np.zeros(0), np.zeros(0, bool)
    for _ in range(ITERATIONS):
        p, g, seen = _pairs(points, normals, b, T)
        if seen < LEAST_POINTS:
            return None
        r = ((g * p).sum(1) - 1.0) / p[:, 2]
        on = np.abs(r) < 3.0 * scale
        if on.sum() < LEAST_POINTS:
            return None
        J = np.concatenate([np.cross(p, g), g], 1) / p[:, 2:]
        weight = np.clip(1.0 - (r / (3.0 * scale)) ** 2, 0.0, None) ** 2
        H = (J * weight[:, None]).T @ J
        # A weak pull to the claim holds directions that the scene does not show.
        damped = H + np.diag([1.0, 1.0, 1.0, 0.01, 0.01, 0.01]) * 1e-3
        xi = -np.linalg.solve(damped, (J * weight[:, None]).T @ r)
        T = _exp(xi) @ T
        spread = 1.48 * float(np.median(np.abs(r[on])))
        scale = max(NARROWEST_PER_M, min(1.5 * spread, 0.7 * scale))
    spread = max(1.48 * float(np.median(np.abs(r[on]))), 3e-4)
    covariance = np.linalg.inv(H / (spread**2 * INDEPENDENT) + 1e-6 * np.eye(6))
    return Alignment(T, covariance.astype(np.float64), int(on.sum()), float(on.mean()))


def _points(a: PlaneField) -> tuple[Matrix, Matrix]:
    """Points [n, 3] on the planes of a field and their unit normals [n, 3], camera frame."""
    g = a.g[STRIDE_PX // 2 :: STRIDE_PX, STRIDE_PX // 2 :: STRIDE_PX]
    v, u = np.nonzero(np.isfinite(g[..., 0]))
    g = g[v, u]
    x = (u * STRIDE_PX + STRIDE_PX // 2 - a.camera.cx) / a.camera.fx
    y = (v * STRIDE_PX + STRIDE_PX // 2 - a.camera.cy) / a.camera.fy
    rays = np.stack([x, y, np.ones_like(x)], 1)
    points = rays / (rays * g).sum(1, keepdims=True)
    return points, g / np.linalg.norm(g, axis=1, keepdims=True)


def _pairs(points: Matrix, normals: Matrix, b: PlaneField, T: Matrix) -> tuple[Matrix, Matrix, int]:
    """Points [n, 3] in the frame of b and the planes [n, 3] at their pixels."""
    p = points @ T[:3, :3].T + T[:3, 3]
    front = p[:, 2] > RANGE_M[0]
    p, n = p[front], normals[front] @ T[:3, :3].T
    u = np.rint(p[:, 0] / p[:, 2] * b.camera.fx + b.camera.cx).astype(np.int64)
    v = np.rint(p[:, 1] / p[:, 2] * b.camera.fy + b.camera.cy).astype(np.int64)
    inside = (u >= 0) & (u < b.camera.width) & (v >= 0) & (v < b.camera.height)
    p, n = p[inside], n[inside]
    g = b.g[v[inside], u[inside]]
    length = np.linalg.norm(g, axis=1)
    same = (g * n).sum(1) > SAME_NORMAL * length  # False for NaN
    return p[same], g[same], int(same.sum())


def _best_start(points: Matrix, normals: Matrix, b: PlaneField, T_b_a: Matrix) -> Matrix:
    """The claimed motion, turned by the trial angle at which the most points fit."""
    few = slice(None, None, 3)

    def fits(yaw_rad: float) -> float:
        p, g, _ = _pairs(points[few], normals[few], b, _turned(yaw_rad) @ T_b_a)
        r = np.abs(((g * p).sum(1) - 1.0) / p[:, 2])
        return float(np.clip(1.0 - (r / 0.03) ** 2, 0.0, None).sum())

    return _turned(max(TRIAL_YAWS_RAD, key=fits)) @ T_b_a


def _turned(yaw_rad: float) -> Matrix:
    """Turn [4, 4] about the camera's vertical axis."""
    return _exp(np.array([0.0, yaw_rad, 0.0, 0.0, 0.0, 0.0]))


def _exp(xi: NDArray[np.float64]) -> Matrix:
    """Motion [4, 4] of a rotation vector (rad) and a translation (m)."""
    out = np.eye(4)
    out[:3, :3] = cv2.Rodrigues(xi[:3])[0]
    out[:3, 3] = xi[3:]
    return out
