"""What is no longer there: Gaussians that views see through fade, and then go.

A Gaussian is seen through where everything measured around its pixel lies behind it by more than
the depth noise explains. Each view that differs from the last one to see through it counts; after
a set number it is removed. A view that sees a surface where it stands takes all of it back, so
that an error of one view removes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_objectmap.evidence.create import tolerance_m
from helios_objectmap.kernels.sighting import THERE, THROUGH, sight_kernel
from helios_objectmap.rendering.renderer import Projection


@dataclass(frozen=True)
class Sight:
    """What a depth image says of the Gaussians in view, as indices into a projection."""

    through: NDArray[np.intp]  # everything around them is farther away
    there: NDArray[np.intp]  # a surface is where they are


def sight(projection: Projection, depth_m: NDArray[np.float32], front_m: float) -> Sight:
    """Compare Gaussians with measured depth [h, w]. front_m: least distance that counts.

    For seeing through, all nine pixels must be valid and farther, so that an edge that is off by a
    pixel is kept.
    """
    depth_m = np.ascontiguousarray(depth_m, np.float32)
    nearest = cv2.erode(depth_m, np.ones((3, 3), np.uint8), borderValue=0.0).astype(np.float32)
    state = np.empty(len(projection.rows), np.uint8)
    sight_kernel(
        projection.uv, projection.depth_m, nearest, tolerance_m(nearest, front_m), depth_m,
        tolerance_m(depth_m, front_m), state,
    )  # fmt: skip
    return Sight(np.flatnonzero(state == THROUGH), np.flatnonzero(state == THERE))
