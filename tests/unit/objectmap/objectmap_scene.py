"""A table with mugs: ray-cast boxes, with depth without noise by default and with true masks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from helios_core.geometry import Pinhole, camera_on_base, se2_to_se3
from helios_core.types import (
    Detection,
    Frame,
    FrameId,
    Observation,
    Role,
    SearchClass,
    SearchContext,
)
from helios_objectmap.settings import ObjectMapSettings
from numpy.typing import NDArray

CAMERA = Pinhole(fx=140.0, fy=140.0, cx=79.5, cy=59.5, width=160, height=120)
SETTINGS = ObjectMapSettings(stride_px=1)

MUG = SearchClass("mug", Role.OBJECT, 0.3)
TABLE = SearchClass("table", Role.START_RECEPTACLE, 0.3)
COUNTER = SearchClass("counter", Role.GOAL_RECEPTACLE, 0.3)
CONTEXT = SearchContext("c1", (MUG, TABLE))

Box = tuple[str, tuple[float, float, float], tuple[float, float, float]]  # name, low, high

FLOOR: Box = ("floor", (-20, -20, -0.1), (20, 20, 0.0))
WALL: Box = ("wall", (4, -20, 0), (4.1, 20, 3))
TABLE_BOX: Box = ("table", (1.0, -0.6, 0.7), (1.8, 0.6, 0.75))


def mug_at(x: float, y: float) -> Box:
    """A mug's box, 9 cm wide and 10 cm high, on the table."""
    return ("mug", (x - 0.045, y - 0.045, 0.75), (x + 0.045, y + 0.045, 0.85))


ROOM = (FLOOR, WALL, TABLE_BOX)


def pose(
    x: float = 0.0, y: float = 0.0, yaw: float = 0.0, tilt: float = 0.45
) -> NDArray[np.float64]:
    """T_world_cam of a camera 1.3 m above (x, y)."""
    return camera_on_base(se2_to_se3(x, y, yaw), 1.3, tilt)


def looking_at(x: float, y: float, target: Sequence[float]) -> NDArray[np.float64]:
    """T_world_cam of a camera 1.3 m above (x, y), facing a point."""
    dx, dy, dz = target[0] - x, target[1] - y, 1.3 - target[2]
    return pose(x, y, math.atan2(dy, dx), math.atan2(dz, math.hypot(dx, dy)))


def cast(
    boxes: Sequence[Box], T_world_cam: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Depth [h, w] along the optical axis, and the number of the box at each pixel."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width].astype(float)
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], -1)
    rays = rays @ T_world_cam[:3, :3].T  # the distance along them is the depth
    origin = T_world_cam[:3, 3]
    depth, which = np.full(u.shape, np.inf), np.full(u.shape, -1)
    for i, (_, low, high) in enumerate(boxes):
        with np.errstate(divide="ignore"):
            a, b = (np.array(low) - origin) / rays, (np.array(high) - origin) / rays
        near, far = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
        hit = (near < far) & (near > 0) & (near < depth)
        depth[hit], which[hit] = near[hit], i
    return np.where(np.isfinite(depth), depth, 0).astype(np.float32), which.astype(np.int32)


def _box_of(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    v, u = np.nonzero(mask)
    return int(u.min()), int(v.min()), int(u.max()) + 1, int(v.max()) + 1


def observe(
    boxes: Sequence[Box],
    T_world_cam: NDArray[np.float64],
    *,
    context: SearchContext = CONTEXT,
    seq: int = 0,
    epoch: int = 0,
    called: Mapping[int, str] | None = None,
    noise_m: float = 0.0,
) -> Observation:
    """Observation of a perfect detector. `called`: box number -> class, default its name."""
    depth, which = cast(boxes, T_world_cam)
    noise = np.random.default_rng(seq).normal(0, 1, depth.shape) * noise_m
    depth = np.where(depth > 0, depth + noise, 0).astype(np.float32)
    named = {i: box[0] for i, box in enumerate(boxes)} if called is None else called
    detections = tuple(
        Detection(named[i], 0.9, _box_of(which == i), which == i)
        for i in range(len(boxes))
        if named.get(i) in {c.name for c in context.classes} and (which == i).any()
    )
    frame = Frame(
        FrameId("boot", epoch, seq),
        seq,
        True,
        np.full((CAMERA.height, CAMERA.width, 3), 128, np.uint8),
        depth,
        CAMERA,
        T_world_cam,
        np.eye(4),
    )
    return Observation(frame, context.id, detections, {}, "truth")
