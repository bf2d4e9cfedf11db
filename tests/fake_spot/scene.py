"""Boxes, upright cylinders and capsules, and their camera images by ray casting.

World: x, y, z up, floor at z = 0, metres. Rays have length 1 along the optical axis, so that the
distance along a ray is the depth of its pixel.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Color = tuple[int, int, int]
LIGHT = np.array([0.4, 0.2, 0.9]) / np.linalg.norm([0.4, 0.2, 0.9])
SKY: Color = (200, 210, 220)


@dataclass(frozen=True)
class Box:
    """A box along the world's axes."""

    center: tuple[float, float, float]
    size: tuple[float, float, float]
    color: Color

    @property
    def bounds(self) -> tuple[Array, Array]:
        c, half = np.array(self.center), np.array(self.size) / 2
        return c - half, c + half

    def cast(self, eye: Array, rays: Array) -> tuple[Array, Array]:
        """(t [n], normal [n, 3]); inf where a ray misses."""
        low, high = self.bounds
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - eye) / rays, (high - eye) / rays
        near, far = np.minimum(a, b), np.maximum(a, b)
        axis = np.argmax(near, axis=-1)
        t = np.take_along_axis(near, axis[:, None], 1)[:, 0]
        hit = (t > 0) & (t <= far.min(axis=-1))
        normal = np.zeros_like(rays)
        sign = -np.sign(np.take_along_axis(rays, axis[:, None], 1))
        np.put_along_axis(normal, axis[:, None], sign, 1)
        return np.where(hit, t, np.inf), normal


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder."""

    center: tuple[float, float, float]
    radius: float
    height: float
    color: Color

    @property
    def bounds(self) -> tuple[Array, Array]:
        c, half = np.array(self.center), np.array([self.radius, self.radius, self.height / 2])
        return c - half, c + half

    def cast(self, eye: Array, rays: Array) -> tuple[Array, Array]:
        """As Box."""
        o = eye - np.array(self.center)
        a = rays[:, 0] ** 2 + rays[:, 1] ** 2
        b = rays[:, 0] * o[0] + rays[:, 1] * o[1]
        c = o[0] ** 2 + o[1] ** 2 - self.radius**2
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (-b - np.sqrt(b * b - a * c)) / a
            side = (t > 0) & (np.abs(o[2] + t * rays[:, 2]) <= self.height / 2)
            cap_z = np.where(rays[:, 2] < 0, self.height / 2, -self.height / 2)
            t_cap = (cap_z - o[2]) / rays[:, 2]
        at = o[:2] + t_cap[:, None] * rays[:, :2]
        cap = (t_cap > 0) & ((at**2).sum(-1) <= self.radius**2)
        t_side, t_cap = np.where(side, t, np.inf), np.where(cap, t_cap, np.inf)
        p = o + np.where(side, t, 0)[:, None] * rays
        normal = np.where(
            (t_side < t_cap)[:, None],
            p * [1, 1, 0] / self.radius,
            np.stack([np.zeros_like(cap_z), np.zeros_like(cap_z), np.sign(cap_z)], -1),
        )
        return np.minimum(t_side, t_cap), normal


@dataclass(frozen=True)
class Capsule:
    """All points within a radius of a line segment; models the robot's arm."""

    a: tuple[float, float, float]
    b: tuple[float, float, float]
    radius: float
    color: Color

    @property
    def bounds(self) -> tuple[Array, Array]:
        ends = np.array([self.a, self.b])
        return ends.min(0) - self.radius, ends.max(0) + self.radius

    def cast(self, eye: Array, rays: Array) -> tuple[Array, Array]:
        """As Box, for an eye outside. Casts spheres along the line that overlap to a tube."""
        a, b = np.array(self.a), np.array(self.b)
        n = max(2, int(np.linalg.norm(b - a) / (0.3 * self.radius)) + 2)
        best, normal = np.full(len(rays), np.inf), np.zeros_like(rays)
        rr = (rays**2).sum(-1)
        for f in np.linspace(0, 1, n):
            o = eye - (a + f * (b - a))
            rb, c = rays @ o, float(o @ o) - self.radius**2
            if c < 0:
                continue  # the eye is inside the sphere
            with np.errstate(invalid="ignore"):
                t = (-rb - np.sqrt(rb * rb - rr * c)) / rr
            nearer = (t > 0) & (t < best)
            best = np.where(nearer, t, best)
            normal[nearer] = (o + t[nearer, None] * rays[nearer]) / self.radius
        return best, normal


Shape = Box | Cylinder | Capsule


@dataclass(frozen=True)
class Seen:
    """A camera image: depth [h, w] along the optical axis (0: no hit), colour, and shape names."""

    depth_m: NDArray[np.float32]
    color: NDArray[np.uint8]
    index: NDArray[np.int16]  # [h, w] into `names`; -1: no hit
    names: tuple[str, ...]


def look(
    shapes: Mapping[str, Shape], T_world_cam: Array, rays_cam: Array, far_m: float = 20.0
) -> Seen:
    """Render the shapes. rays_cam: [h, w, 3] with z = 1, one for each pixel."""
    h, w, _ = rays_cam.shape
    eye = T_world_cam[:3, 3]
    rays = (rays_cam @ T_world_cam[:3, :3].T).reshape(-1, 3)
    depth = np.full(h * w, far_m)
    color = np.tile(np.array(SKY, np.float64), (h * w, 1))
    index = np.full(h * w, -1, np.int16)
    for k, shape in enumerate(shapes.values()):
        some = np.flatnonzero(_may_meet(shape, eye, rays))
        t, normal = shape.cast(eye, rays[some])
        nearer = t < depth[some]
        at = some[nearer]
        depth[at], index[at] = t[nearer], k
        shade = 0.65 + 0.35 * np.clip(normal[nearer] @ LIGHT, 0, 1)
        color[at] = np.array(shape.color) * shade[:, None]
    depth[index < 0] = 0
    return Seen(
        depth.reshape(h, w).astype(np.float32),
        color.reshape(h, w, 3).astype(np.uint8),
        index.reshape(h, w),
        tuple(shapes),
    )


def first_hit(shapes: Mapping[str, Shape], eye: Array, ray: Array) -> tuple[str, float]:
    """(name, distance in ray lengths) of the first shape that a ray hits; ("", inf) for none."""
    found = [(float(s.cast(eye, ray[None])[0][0]), name) for name, s in shapes.items()]
    t, name = min(found, default=(np.inf, ""))
    return (name, t) if np.isfinite(t) else ("", np.inf)


def support_below(shapes: Iterable[Shape], x: float, y: float, below_z: float) -> float:
    """Height of the highest surface below a point; 0 is the floor."""
    tops = [0.0]
    for shape in shapes:
        low, high = shape.bounds
        if low[0] <= x <= high[0] and low[1] <= y <= high[1] and high[2] <= below_z + 1e-6:
            tops.append(float(high[2]))
    return max(tops)


def _may_meet(shape: Shape, eye: Array, rays: Array) -> NDArray[np.bool_]:
    """Which rays [n, 3] pass through the shape's bounding sphere."""
    low, high = shape.bounds
    o, r = (low + high) / 2 - eye, float(np.linalg.norm(high - low) / 2)
    along = rays @ o
    rr = (rays**2).sum(-1)
    away2 = float(o @ o) - along**2 / rr
    return (away2 <= r * r) & ((along > 0) | (float(o @ o) < r * r))
