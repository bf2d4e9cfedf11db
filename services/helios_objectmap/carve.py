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

from helios_objectmap.create import tolerance_m
from helios_objectmap.splat import Projection


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
    nearest = cv2.erode(depth_m, np.ones((3, 3), np.uint8), borderValue=0.0)
    uv = np.rint(projection.uv).astype(np.int32)
    inside = np.flatnonzero(
        (uv[:, 0] >= 0)
        & (uv[:, 0] < projection.width)
        & (uv[:, 1] >= 0)
        & (uv[:, 1] < projection.height)
    )
    u, v = uv[inside].T
    z = projection.depth_m[inside]
    all_around, here = nearest[v, u].astype(np.float32), depth_m[v, u]
    through = (all_around > 0) & (z < all_around - tolerance_m(all_around, front_m))
    there = (here > 0) & (np.abs(z - here) < tolerance_m(here, front_m))
    return Sight(inside[through], inside[there & ~through])
