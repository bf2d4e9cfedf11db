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
    new = np.zeros(depth_m.shape, np.bool_)
    creation_kernel(
        depth_m, rendering.depth_m, rendering.coverage, detected, np.float32(front_m), new
    )
    return new


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
    state = np.empty(len(projection.rows), np.uint8)
    sight_kernel(projection.uv, projection.depth_m, depth_m, np.float32(front_m), state)
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


@njit(cache=True, nogil=True, inline="always")
def _tolerance_m(depth_m, floor_m):
    """`tolerance_m` of one depth; every operation is in float32."""
    off = depth_m - _f4(0.4)
    noise = _f4(0.0012) + _f4(0.0019) * (off * off)
    return max(floor_m, _f4(4) * noise)


@njit(cache=True, nogil=True)
def _nearest_m(depth_m, v, u):
    """Smallest of the nine depths around a pixel; 0 at the edge of the image."""
    if v < 1 or u < 1 or v >= depth_m.shape[0] - 1 or u >= depth_m.shape[1] - 1:
        return _f4(0)
    least = depth_m[v, u]
    for r in range(v - 1, v + 2):
        for c in range(u - 1, u + 2):
            least = min(least, depth_m[r, c])
    return least


@njit(cache=True, nogil=True)
def creation_kernel(depth_m, rendered_m, coverage, detected, front_m, new):
    """Fill new [h, w]: detected pixels with a depth that are not modelled, or where the depth of
    all nine pixels around lies in front of the rendered one."""
    height, width = depth_m.shape
    for v in range(height):
        for u in range(width):
            if not (detected[v, u] and depth_m[v, u] > 0):
                continue
            if coverage[v, u] < _f4(MODELLED):
                new[v, u] = True
                continue
            if v < 1 or u < 1 or v >= height - 1 or u >= width - 1:
                continue
            in_front = _in_front(depth_m, rendered_m, coverage, v, u, front_m)
            for k in range(9):
                in_front = in_front and _in_front(
                    depth_m, rendered_m, coverage, v + k // 3 - 1, u + k % 3 - 1, front_m
                )
            new[v, u] = in_front


@njit(cache=True, nogil=True)
def _in_front(depth_m, rendered_m, coverage, v, u, front_m):
    here = depth_m[v, u]
    near = here < rendered_m[v, u] - _tolerance_m(here, front_m)
    return near and coverage[v, u] >= _f4(MODELLED)


@njit(cache=True, nogil=True)
def sight_kernel(uv, depth_m, measured_m, front_m, state):
    """Fill state [k] for splats at uv [k, 2] pixels and depth_m [k]. measured_m: [h, w]; front_m:
    smallest difference that counts."""
    height, width = measured_m.shape
    for k in range(uv.shape[0]):
        state[k] = UNKNOWN
        u, v = np.int64(np.rint(uv[k, 0])), np.int64(np.rint(uv[k, 1]))
        if u < 0 or v < 0 or u >= width or v >= height:
            continue
        z, around, here = depth_m[k], _nearest_m(measured_m, v, u), measured_m[v, u]
        if around > 0 and z < around - _tolerance_m(around, front_m):
            state[k] = THROUGH
        elif here > 0 and abs(z - here) < _tolerance_m(here, front_m):
            state[k] = THERE
