"""The fake Spot's image sources: intrinsics, mounts and rays."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from tests.fake_spot.body import Array, pose

R_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
DEPTH_SCALE = 1000.0


def _turned(yaw: float, down: float, roll: float) -> Array:
    """Rotation of a camera with heading `yaw`, pitched `down`, and rolled about its axis."""
    cy, sy, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(down), math.sin(down)
    cr, sr = math.cos(roll), math.sin(roll)
    heading = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1.0]])
    pitch = np.array([[cp, 0, sp], [0, 1.0, 0], [-sp, 0, cp]])
    about_axis = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1.0]])
    return heading @ pitch @ R_OPTICAL @ about_axis


@dataclass(frozen=True)
class Source:
    """One image source. `distortion`: k1..k4 of Kannala-Brandt, empty for a pinhole."""

    name: str
    frame: str
    parent: str  # hand or body
    T_parent_cam: Array
    cols: int
    rows: int
    focal: float
    depth: bool = False
    grey: bool = False
    distortion: tuple[float, ...] = ()

    @property
    def K(self) -> Array:
        return np.array(
            [
                [self.focal, 0, (self.cols - 1) / 2],
                [0, self.focal, (self.rows - 1) / 2],
                [0, 0, 1.0],
            ]
        )

    @cached_property
    def rays(self) -> Array:
        """[h, w, 3] with z = 1."""
        u, v = np.meshgrid(np.arange(self.cols, dtype=float), np.arange(self.rows, dtype=float))
        pixels = np.stack([u, v], -1).reshape(-1, 1, 2)
        if self.distortion:
            xy = cv2.fisheye.undistortPoints(pixels, self.K, np.array(self.distortion))
        else:
            xy = (pixels - self.K[:2, 2]) / self.focal
        xy = np.asarray(xy).reshape(self.rows, self.cols, 2)
        ones = np.ones((self.rows, self.cols, 1))
        return np.concatenate([xy, ones], -1).astype(np.float64)


def sources(cols: int = 320, rows: int = 240) -> dict[str, Source]:
    """The image sources of this Spot: the hand's colour and depth, and two of the body's."""
    hand = pose((0.02, 0.0, 0.02), R_OPTICAL)
    front = pose((0.42, 0.04, 0.02), _turned(0.0, 0.5, math.radians(-78)))
    front_depth = pose((0.42, 0.06, 0.02), _turned(0.0, 0.5, math.radians(-78)))
    focal = 552.0 * cols / 640  # of a real hand camera
    lens = (0.02, -0.01, 0.003, 0.0)
    made = (
        Source("hand_color_image", "hand_color_image_sensor", "hand", hand, cols, rows, focal),
        Source("hand_depth_in_hand_color_frame", "hand_color_image_sensor", "hand", hand,
               cols, rows, focal, depth=True),
        Source("frontleft_fisheye_image", "frontleft_fisheye", "body", front, cols, rows,
               330.0 * cols / 640, grey=True, distortion=lens),
        Source("frontleft_depth", "frontleft", "body", front_depth, 212, 120, 110.0, depth=True),
    )  # fmt: skip
    return {s.name: s for s in made}
