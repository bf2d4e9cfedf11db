"""Render isotropic 3D Gaussians and collect their blending weights (section 3.1.3, eq. 1).

    alpha_n(p) = opacity_n * exp(-0.5 d^T S_n^-1 d),  d = p - mean of the splat in the image
    kappa(p, n) = alpha_n(p) * prod_{j nearer than n} (1 - alpha_j(p))                   (eq. 1)

The printed kernel lacks the minus sign. S_n is the EWA covariance of a sphere of `radius` plus
`low_pass_px2`; an alpha below 1/255 counts as 0, and a pixel is finished once less than 1e-4 of
its light is left. Another back end (CUDA) offers the same three functions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_objectmap import kernels
from helios_objectmap.view import View

LOW_PASS_PX2 = 0.3  # as in 3DGS: a splat never falls between two pixels
NEAR_M = 0.05
FAR_M = 100.0

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Projection:
    """Gaussians as one view sees them: those that touch the image, near to far."""

    width: int
    height: int
    rows: NDArray[np.int32]  # [k] which of the Gaussians given
    params: Float32  # [k, 8] u, v, conic a b c, opacity, depth_m, half height; see kernels.py
    offsets: NDArray[np.int64]  # [tiles + 1] into entries
    entries: NDArray[np.int32]  # those of the k on each tile, near to far

    @property
    def depth_m(self) -> Float32:
        """[k] distance along the optical axis."""
        return self.params[:, kernels.DEPTH]

    @property
    def uv(self) -> Float32:
        """[k, 2] projected centres in pixels."""
        return self.params[:, kernels.U : kernels.V + 1]


@dataclass(frozen=True)
class Rendering:
    """What a view shows of the Gaussians."""

    depth_m: Float32  # [h, w] blended depth along the optical axis, 0 where nothing is modelled
    coverage: Float32  # [h, w] sum of kappa, in [0, 1]
    features: Float32  # [c, h, w] sums of kappa * feature, not divided by the coverage


def project(
    means: Float32,
    radius_m: Float32,
    opacity: Float32,
    view: View,
    rows: NDArray[np.int32] | None = None,
    far_m: float = FAR_M,
) -> Projection:
    """Project Gaussians into a view and order them by depth.

    means: [n, 3] world, metres; radius_m, opacity: [n]; rows: the ones to look at, default all.
    Equal depths are ordered by the projected centre, so the order of the rows never changes a
    pixel.
    """
    if rows is None:
        rows = np.arange(len(means), dtype=np.int32)
    n = len(rows)
    width, height = view.width, view.height
    params = np.empty((n, kernels.N_PARAMETERS), np.float32)
    tiles = np.empty((n, 4), np.int32)
    keys = np.empty(n, np.uint64)
    visible = np.empty(n, np.int32)
    f4 = np.float32
    count = kernels.project_kernel(
        rows,
        means,
        radius_m,
        opacity,
        np.ascontiguousarray(view.T_cam_world, np.float32),
        f4(view.fx),
        f4(view.fy),
        f4(view.cx),
        f4(view.cy),
        width,
        height,
        f4(NEAR_M),
        f4(far_m),
        f4(LOW_PASS_PX2),
        params,
        tiles,
        keys,
        visible,
    )
    order = np.argsort(keys[:count], kind="stable")
    tiles = tiles[order]
    tiles_x, tiles_y = -(-width // kernels.TILE), -(-height // kernels.TILE)
    offsets = np.empty(tiles_x * tiles_y + 1, np.int64)
    kernels.bin_kernel(tiles, tiles_x, offsets, visible, False)
    entries = np.empty(int(offsets[-1]), np.int32)
    kernels.bin_kernel(tiles, tiles_x, offsets, entries, True)
    return Projection(width, height, visible[order], params[order], offsets, entries)


def render(projection: Projection, features: Float32 | None = None) -> Rendering:
    """Blend depth and, if given, features [k, c] of `projection.rows` over the image (eq. 1)."""
    channels = np.ascontiguousarray(
        projection.depth_m[:, None]
        if features is None
        else np.concatenate([projection.depth_m[:, None], features], axis=1),
        np.float32,
    )
    shape = (projection.height, projection.width)
    out = np.zeros((channels.shape[1], *shape), np.float32)
    transmittance = np.ones(shape, np.float32)
    kernels.raster_kernel(
        projection.params,
        channels,
        projection.offsets,
        projection.entries,
        projection.width,
        projection.height,
        out,
        transmittance,
    )
    coverage = 1 - transmittance
    depth_m = np.divide(out[0], coverage, out=np.zeros(shape, np.float32), where=coverage > 1e-3)
    return Rendering(depth_m, coverage, out[1:])


def kappa_sums(projection: Projection, labels: NDArray[np.int32], n_labels: int) -> Float32:
    """Sum kappa(p, n) over the pixels of each label: the sum of eq. 3, [k, n_labels].

    Rows of the sums are those of `projection.rows`. labels: [h, w]; pixels with a negative label
    are left out.
    """
    entries = projection.entries
    partial = np.zeros((len(entries), n_labels), np.float32)
    kernels.kappa_sums_kernel(
        projection.params,
        projection.offsets,
        entries,
        np.ascontiguousarray(labels, np.int32),
        n_labels,
        projection.width,
        projection.height,
        partial,
    )
    sums = np.zeros((len(projection.params), n_labels), np.float32)
    kernels.scatter_kernel(entries, partial, sums)
    return sums
