"""Creation, free-space carving and re-observation of Gaussians, from measured and rendered depth.

Creation (appendix): the paper makes a Gaussian wherever measured and rendered depth differ by more
than 1 mm, which never ends with the noise of a real camera. The default rule creates where nothing
is modelled, or where the measured surface lies in front of the rendered one by more than the noise
explains. `paper` is the literal rule. Carving: Gaussians that a view sees through fade.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.rendering.renderer_interface import Projection, Rendering

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

CREATE_FRONT_M = 0.05  # a surface at least this far in front of the model is new
CARVE_FRONT_M = 0.10  # a Gaussian at least this far in front of the measured depth is seen through
REOBSERVE_AGREEMENT_M = 0.5  # depth difference up to which a pixel is observed again (appendix 6.1)
CLOSING_PX = 5  # holes up to this size close in the re-observed pixels (appendix 6.1)
MODELLED = 0.5  # a pixel with less coverage counts as not modelled
UNKNOWN, THROUGH, THERE = range(3)
_f4 = np.float32


def depth_noise_m(depth_m: Float32) -> Float32:
    """Standard deviation of structured-light depth (Nguyen, Izadi, Lovell 2012), metres."""
    return 0.0012 + 0.0019 * (depth_m - 0.4) ** 2


def tolerance_m(depth_m: Float32, floor_m: float) -> Float32:
    """Depth difference that noise does not explain: 4 standard deviations, at least `floor_m`."""
    return np.maximum(np.float32(floor_m), 4 * depth_noise_m(depth_m))


def creation_mask(
    depth_m: Float32, rendering: Rendering, detected: Mask, front_m: float = CREATE_FRONT_M
) -> Mask:
    """Pixels [h, w] that get a new Gaussian: nothing is modelled, or a new surface is in front."""
    in_front = depth_m < rendering.depth_m - tolerance_m(depth_m, front_m)
    in_front &= rendering.coverage >= MODELLED
    new = (rendering.coverage < MODELLED) | _eroded(in_front)
    return detected & (depth_m > 0) & new


def paper_creation_mask(depth_m: Float32, rendering: Rendering, detected: Mask) -> Mask:
    """Pixels [h, w] that get a new Gaussian by the paper's literal rule (appendix)."""
    valid = detected & (depth_m > 0)
    error_m = np.abs(depth_m - rendering.depth_m)
    return valid & ((error_m > 1.0) | _eroded(valid & (error_m > 0.001)))


def _eroded(mask: Mask) -> Mask:
    return cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0).astype(bool)


@dataclass(frozen=True)
class DepthComparison:
    """Gaussians in view that a depth image contradicts or confirms: indices into a projection."""

    through: NDArray[np.intp]  # seen through: all surfaces around them are farther away
    there: NDArray[np.intp]  # confirmed: a surface lies at their depth


def compare_with_depth(
    projection: Projection, depth_m: NDArray[np.float32], front_m: float = CARVE_FRONT_M
) -> DepthComparison:
    """Compare Gaussians with measured depth [h, w]. front_m: smallest difference that counts.

    A Gaussian is seen through only if all nine pixels around it are valid and farther, so that one
    at an edge that is off by a pixel is kept.
    """
    depth_m = np.ascontiguousarray(depth_m, np.float32)
    nearest = cv2.erode(depth_m, np.ones((3, 3), np.uint8), borderValue=0.0).astype(np.float32)
    state = np.empty(len(projection.rows), np.uint8)
    sight_kernel(
        projection.uv, projection.depth_m, nearest, tolerance_m(nearest, front_m), depth_m,
        tolerance_m(depth_m, front_m), state,
    )  # fmt: skip
    return DepthComparison(np.flatnonzero(state == THROUGH), np.flatnonzero(state == THERE))


def reobserved(
    depth_m: NDArray[np.float32],
    rendering: Rendering,
    created: NDArray[np.bool_],
    agreement_m: float = REOBSERVE_AGREEMENT_M,
    closing_px: int = CLOSING_PX,
) -> NDArray[np.bool_]:
    """Pixels [h, w] whose measured depth agrees with the model, small holes closed (appendix).

    `rendering` shows the map before the pixels `created` were added; those agree by construction.
    Pixels without a measured depth never count.
    """
    agrees = (rendering.coverage >= MODELLED) & (np.abs(rendering.depth_m - depth_m) < agreement_m)
    mask = ((agrees | created) & (depth_m > 0)).astype(np.uint8)
    kernel = np.ones((closing_px, closing_px), np.uint8)
    return cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel).astype(bool) & (depth_m > 0)


@njit(cache=True, nogil=True)
def sight_kernel(uv, depth_m, nearest_m, nearest_tolerance_m, measured_m, tolerance_m, state):
    """Fill state [k] for splats at uv [k, 2] pixels and depth_m [k].

    measured_m, tolerance_m: [h, w]; nearest_m, nearest_tolerance_m: [h, w] smallest depth of the
    nine pixels around, 0 where one of them is invalid.
    """
    height, width = measured_m.shape
    for k in range(uv.shape[0]):
        state[k] = UNKNOWN
        u, v = np.int64(np.rint(uv[k, 0])), np.int64(np.rint(uv[k, 1]))
        if u < 0 or v < 0 or u >= width or v >= height:
            continue
        z, around, here = depth_m[k], nearest_m[v, u], measured_m[v, u]
        if around > 0 and z < around - nearest_tolerance_m[v, u]:
            state[k] = THROUGH
        elif here > 0 and abs(z - here) < tolerance_m[v, u]:
            state[k] = THERE
