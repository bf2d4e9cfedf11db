"""A furnished flat made of boxes, and its depth images by ray casting in numpy."""

from __future__ import annotations

import functools
import math

import numpy as np
from helios_core.geometry import Matrix, Pinhole, camera_on_base, se2_to_se3
from helios_core.types import Frame, FrameId
from numpy.typing import NDArray

CAMERA = Pinhole(525.0, 525.0, 320.0, 240.0, 640, 480)
FRAMES = 12


def boxes(seed: int = 0) -> NDArray[np.float32]:
    """Walls and furniture [n, 6] (low corner, high corner) of a flat of 10 x 8 m, metres."""
    rng = np.random.default_rng(seed)
    walls = [
        (-5.1, -4, 0, -5, 4, 2.6),
        (5, -4, 0, 5.1, 4, 2.6),
        (-5, -4.1, 0, 5, -4, 2.6),
        (-5, 4, 0, 5, 4.1, 2.6),
        (-0.05, -4, 0, 0.05, -0.6, 2.6),
        (-0.05, 0.6, 0, 0.05, 4, 2.6),
    ]
    out = list(walls)
    while len(out) < 40:
        x, y = rng.uniform(-4.6, 4.6), rng.uniform(-3.6, 3.6)
        w, d, h = rng.uniform(0.2, 1.2), rng.uniform(0.2, 0.9), rng.uniform(0.3, 1.6)
        if math.hypot(x, y) > 1.5:
            out.append((x - w / 2, y - d / 2, 0, x + w / 2, y + d / 2, h))
    return np.array(out, np.float32)


def cast(T_world_cam: Matrix, scene: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depth image [h, w] of the boxes and the floor, along the optical axis, metres."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width].astype(np.float32)
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], -1)
    direction = (rays @ T_world_cam[:3, :3].T.astype(np.float32)).reshape(-1, 3)
    origin = T_world_cam[:3, 3].astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / direction
        best = np.where(direction[:, 2] < 0, -origin[2] * inverse[:, 2], np.inf)
        for box in scene:
            a, b = (box[:3] - origin) * inverse, (box[3:] - origin) * inverse
            near = np.minimum(a, b).max(axis=1)
            far = np.maximum(a, b).min(axis=1)
            hit = (far >= near) & (near > 0.05)
            best = np.where(hit & (near < best), near, best)
    return np.where(np.isfinite(best), best, 0).astype(np.float32).reshape(CAMERA.height, -1)


@functools.cache
def frames(noise_m_per_m2: float = 0.002) -> tuple[Frame, ...]:
    """Frames of a walk on a circle through the flat; depth noise grows with depth squared."""
    rng, scene = np.random.default_rng(1), boxes()
    out = []
    for i in range(FRAMES):
        angle = 2 * math.pi * i / FRAMES
        base = se2_to_se3(0.8 * math.cos(angle), 0.8 * math.sin(angle), angle)
        T_world_cam = camera_on_base(base, 1.31, 0.5)
        depth = cast(T_world_cam, scene)
        noise = rng.normal(0, 1, depth.shape).astype(np.float32) * noise_m_per_m2 * depth**2
        depth = np.where((depth > 0) & (depth < 10), depth + noise, 0).astype(np.float32)
        color = np.repeat((depth * 25).clip(0, 255).astype(np.uint8)[..., None], 3, -1)
        out.append(Frame(FrameId("bench", 0, i), i, True, color, depth, CAMERA, T_world_cam, base))
    return tuple(out)
