"""Pinhole camera with pose, and the pixel grid on which the object map works."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class View:
    """Pinhole camera (OpenCV axes; pixel centres at integers) with its pose in the world."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    T_world_cam: NDArray[np.float64]  # [4, 4] camera to world

    @property
    def T_cam_world(self) -> NDArray[np.float64]:
        """Transform [4, 4] from world to camera."""
        rotation = self.T_world_cam[:3, :3].T
        T = np.eye(4)
        T[:3, :3] = rotation
        T[:3, 3] = -rotation @ self.T_world_cam[:3, 3]
        return T

    def strided(self, stride: int) -> View:
        """Coarser view whose pixel k is this view's pixel `offset(stride) + k * stride`."""
        first = offset(stride)
        return View(
            self.fx / stride,
            self.fy / stride,
            (self.cx - first) / stride,
            (self.cy - first) / stride,
            kept_pixels(self.width, stride),
            kept_pixels(self.height, stride),
            self.T_world_cam,
        )

    def lift(self, depth_m: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
        """World points [k, 3] of the masked pixels, row by row. depth_m: [h, w] along the axis."""
        v, u = np.nonzero(mask)
        z = depth_m[v, u].astype(np.float64)
        points = np.stack([(u - self.cx) / self.fx * z, (v - self.cy) / self.fy * z, z], axis=1)
        world = points @ self.T_world_cam[:3, :3].T + self.T_world_cam[:3, 3]
        return world.astype(np.float32)


def offset(stride: int) -> int:
    """First pixel that a stride keeps: the middle of its block, so that the grid has no bias."""
    return stride // 2


def kept_pixels(size_px: int, stride: int) -> int:
    """Number of pixels that a stride keeps of a row or column of `size_px`."""
    return len(range(offset(stride), size_px, stride))
