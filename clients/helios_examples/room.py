"""Simulated hardware: a painted room, its image by ray casting, and a collision check."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from helios_core.geometry import Matrix, Pinhole
from numpy.typing import NDArray

ROOM_M = np.array([[-2.5, -2.0, 0.0], [2.5, 2.0, 2.4]])  # opposite corners
PAINT = np.array([[200, 195, 185], [185, 190, 200], [150, 130, 110]], np.uint8)  # by axis: x, y, z
Thing = tuple[NDArray[np.float64], tuple[int, int, int]]  # opposite corners in m, and colour
THINGS: tuple[Thing, ...] = (  # a blue table, a red box on it, a high green shelf
    (np.array([[1.4, -0.6, 0.0], [2.0, 0.6, 0.5]]), (40, 70, 200)),
    (np.array([[1.5, -0.1, 0.5], [1.7, 0.1, 0.6]]), (210, 40, 40)),
    (np.array([[-2.4, 1.1, 0.0], [-1.6, 1.9, 1.5]]), (50, 150, 70)),
)


def look(
    camera: Pinhole, T_world_cam: Matrix, things: Iterable[Thing] = THINGS
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Colour [h, w, 3] and depth [h, w] along the optical axis, metres."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays_cam = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, u**0], -1)
    rays = rays_cam @ T_world_cam[:3, :3].T  # 1 m along the optical axis, so lengths are depths
    eye_m = T_world_cam[:3, 3]
    walls_m = ((ROOM_M[:, None, None] - eye_m) / rays).max(0)  # [h, w, 3]: far wall per axis
    depth_m, color = walls_m.min(-1), PAINT[walls_m.argmin(-1)]
    for corners_m, paint in things:
        sides_m = (corners_m[:, None, None] - eye_m) / rays
        near_m, far_m = sides_m.min(0).max(-1), sides_m.max(0).min(-1)
        hit = (near_m > 0) & (near_m < np.minimum(far_m, depth_m))
        depth_m[hit], color[hit] = near_m[hit], paint
    return color, depth_m.astype(np.float32)


def fits(x_m: float, y_m: float, radius_m: float) -> bool:
    """True if a round base at this position touches nothing."""
    at_m = np.array([x_m, y_m])
    inside = (at_m - radius_m >= ROOM_M[0, :2]).all() and (at_m + radius_m <= ROOM_M[1, :2]).all()
    gaps_m = [np.linalg.norm(np.clip(at_m, *c[:, :2]) - at_m) for c, _ in THINGS]
    return bool(inside and min(gaps_m) >= radius_m)
