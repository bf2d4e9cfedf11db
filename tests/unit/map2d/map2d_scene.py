"""A minimal ray caster over boxes on a floor, and frames rendered with it."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from helios_core.geometry import Pinhole, se2_to_se3
from helios_core.types import Frame, FrameId
from numpy.typing import NDArray

CAMERA = Pinhole(fx=150.0, fy=150.0, cx=79.5, cy=59.5, width=160, height=120)
CAMERA_HEIGHT_M = 1.31


@dataclass(frozen=True)
class Block:
    """An axis-aligned box: opposite corners in the world, metres."""

    lo: tuple[float, float, float]
    hi: tuple[float, float, float]


def camera_pose(
    x: float, y: float, yaw: float, pitch_down: float = math.radians(30), roll: float = 0.0
) -> NDArray[np.float64]:
    """T_world_cam of a camera over (x, y); OpenCV axes, roll about the optical axis."""
    c, s = math.cos(yaw), math.sin(yaw)
    forward = np.array([c * math.cos(pitch_down), s * math.cos(pitch_down), -math.sin(pitch_down)])
    right = np.array([s, -c, 0.0])
    down = np.cross(forward, right)
    cr, sr = math.cos(roll), math.sin(roll)
    T = np.eye(4)
    T[:3, 0] = cr * right + sr * down
    T[:3, 1] = -sr * right + cr * down
    T[:3, 2] = forward
    T[:3, 3] = x, y, CAMERA_HEIGHT_M
    return T


def cast(
    blocks: Sequence[Block], T_world_cam: NDArray[np.float64], camera: Pinhole = CAMERA
) -> NDArray[np.float32]:
    """Depth along the optical axis (m) of the nearest block or the floor; 0 where nothing is."""
    return _cast(tuple(blocks), T_world_cam.tobytes(), camera).copy()


@functools.lru_cache(1024)  # many tests use the same room and poses
def _cast(blocks: tuple[Block, ...], pose: bytes, camera: Pinhole) -> NDArray[np.float32]:
    T_world_cam = np.frombuffer(pose).reshape(4, 4)
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.stack(
        [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1
    )
    rays = rays @ T_world_cam[:3, :3].T
    eye = T_world_cam[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(rays[..., 2] < 0, -eye[2] / rays[..., 2], np.inf)
        for block in blocks:
            a = (np.array(block.lo) - eye) / rays
            b = (np.array(block.hi) - eye) / rays
            enter = np.nanmax(np.minimum(a, b), axis=-1)
            leave = np.nanmin(np.maximum(a, b), axis=-1)
            t = np.where((enter < leave) & (enter > 0) & (enter < t), enter, t)
    return np.where(np.isfinite(t), t, 0).astype(np.float32)


def room(width: float = 4.0, depth: float = 3.0, wall: float = 0.1) -> list[Block]:
    """Four walls 2.5 m high around the inside [0, width] x [0, depth]."""
    top = 2.5
    return [
        Block((-wall, -wall, 0), (width + wall, 0, top)),
        Block((-wall, depth, 0), (width + wall, depth + wall, top)),
        Block((-wall, 0, 0), (0, depth, top)),
        Block((width, 0, 0), (width + wall, depth, top)),
    ]


def table(x: float, y: float, width: float = 0.8, depth: float = 0.6) -> list[Block]:
    """A table top 0.70-0.74 m up on four legs of 4 cm, centred on (x, y)."""
    x0, x1, y0, y1 = x - width / 2, x + width / 2, y - depth / 2, y + depth / 2
    legs = [
        Block((a, b, 0), (a + 0.04, b + 0.04, 0.7))
        for a in (x0, x1 - 0.04)
        for b in (y0, y1 - 0.04)
    ]
    return [Block((x0, y0, 0.70), (x1, y1, 0.74)), *legs]


def chair(x: float, y: float) -> list[Block]:
    """A chair: a seat of 40 x 40 cm, a back, and four legs of 3 cm."""
    legs = [
        Block((x + a, y + b, 0), (x + a + 0.03, y + b + 0.03, 0.45))
        for a in (-0.2, 0.17)
        for b in (-0.2, 0.17)
    ]
    seat = Block((x - 0.2, y - 0.2, 0.42), (x + 0.2, y + 0.2, 0.46))
    return [seat, Block((x - 0.2, y + 0.17, 0.46), (x + 0.2, y + 0.2, 0.9)), *legs]


@dataclass
class Walk:
    """Renders numbered frames of a scene; depth noise grows with the square of depth."""

    blocks: list[Block]
    camera: Pinhole = CAMERA
    noise_at_1_m: float = 0.0
    outliers: float = 0.0
    seq: int = 0
    epoch: int = 0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(7))

    def frame(
        self,
        x: float,
        y: float,
        yaw: float,
        pitch_down: float = math.radians(30),
        roll: float = 0.0,
        keyframe: bool = True,
    ) -> Frame:
        T_world_cam = camera_pose(x, y, yaw, pitch_down, roll)
        depth = cast(self.blocks, T_world_cam, self.camera)
        if self.noise_at_1_m:
            depth += (self.rng.normal(0, self.noise_at_1_m, depth.shape) * depth**2) * (depth > 0)
        if self.outliers:
            wild = self.rng.random(depth.shape) < self.outliers
            depth = np.where(wild, self.rng.uniform(0.3, 5, depth.shape), depth)
        self.seq += 1
        return Frame(
            id=FrameId("boot", self.epoch, self.seq),
            stamp_ns=self.seq * 1_000_000,
            keyframe=keyframe,
            color=np.zeros((self.camera.height, self.camera.width, 3), np.uint8),
            depth_m=depth.astype(np.float32),
            camera=self.camera,
            T_world_cam=T_world_cam,
            T_world_base=se2_to_se3(x, y, yaw),
        )

    def look_around(
        self, x: float, y: float, pitch_down: float = math.radians(30), roll: float = 0.0
    ) -> list[Frame]:
        """Render twelve frames, one every 30 degrees."""
        return [self.frame(x, y, k * math.pi / 6, pitch_down, roll) for k in range(12)]
