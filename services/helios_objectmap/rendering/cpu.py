"""CPU renderer: numba kernels that run on all of numba's threads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.camera import View
from helios_objectmap.rendering.kernels import (
    COLUMNS,
    DEPTH,
    TILE,
    U,
    V,
    bin_kernel,
    depth_order_kernel,
    merge_kernel,
    merged_offsets_kernel,
    project_kernel,
)
from helios_objectmap.rendering.rasterizer import kappa_sums_kernel, raster_kernel, scatter_kernel
from helios_objectmap.rendering.renderer_interface import (
    FAR_M,
    LOW_PASS_PX2,
    NEAR_M,
    Float32,
    Rendering,
)


@dataclass(frozen=True)
class CpuProjection:
    """Gaussians projected into one view, with the image tiles that each of them touches."""

    width: int
    height: int
    rows: NDArray[np.int32]  # [k] indices of the Gaussians
    splats: Float32  # [k, COLUMNS], see kernels.py
    offsets: NDArray[np.int64]  # [tiles + 1] into entries
    entries: NDArray[np.int32]  # indices into the k splats, per tile, near to far

    @property
    def depth_m(self) -> Float32:
        """Distances [k] along the optical axis."""
        return self.splats[:, DEPTH]

    @property
    def uv(self) -> Float32:
        """Projected centres [k, 2] in pixels."""
        return self.splats[:, U : V + 1]

    def render(self, features: Float32 | None = None) -> Rendering:
        """Blend depth and, if given, features [k, c] of the rows over the image (eq. 1)."""
        if features is None:
            features = np.empty((len(self.rows), 0), np.float32)
        shape = (self.height, self.width)
        depth_m, coverage = np.empty(shape, np.float32), np.empty(shape, np.float32)
        blended = np.empty((features.shape[1], *shape), np.float32)
        flat = np.ascontiguousarray(features, np.float32).reshape(-1)
        raster_kernel(self.splats, flat, self.offsets, self.entries, depth_m, coverage, blended)
        return Rendering(depth_m, coverage, blended)

    def kappa_sums(self, labels: NDArray[np.int32], n_labels: int) -> Float32:
        """Sum kappa(p, n) over the pixels of each label: the sum of eq. 3, [k, n_labels].

        labels: [h, w]; pixels with a negative label are left out.
        """
        of_entry = np.empty((len(self.entries), n_labels), np.float32)
        labels = np.ascontiguousarray(labels, np.int32)
        kappa_sums_kernel(self.splats, self.offsets, self.entries, labels, n_labels, of_entry)
        sums = np.zeros((len(self.rows), n_labels), np.float32)
        scatter_kernel(self.entries, of_entry, sums)
        return sums

    def renewed(self, gone: NDArray[np.integer], more: CpuProjection) -> CpuProjection:
        """This projection without the Gaussians `gone`, plus those of `more` in the same view."""
        number, n_kept = np.arange(len(self.rows), dtype=np.int32), len(self.rows) - len(gone)
        kept = slice(None)
        if len(gone):
            kept = np.delete(number, gone)
            number[gone] = -1
            number[kept] = np.arange(n_kept, dtype=np.int32)
        rows = np.concatenate([self.rows[kept], more.rows])
        splats = np.concatenate([self.splats[kept], more.splats])
        offsets = np.empty_like(self.offsets)
        merged_offsets_kernel(number, self.offsets, self.entries, more.offsets, offsets)
        entries = np.empty(int(offsets[-1]), np.int32)
        merge_kernel(
            splats,
            number,
            self.offsets,
            self.entries,
            n_kept,
            more.offsets,
            more.entries,
            offsets,
            entries,
        )
        return CpuProjection(self.width, self.height, rows, splats, offsets, entries)


def project(
    means: Float32,
    radius_m: Float32,
    opacity: Float32,
    view: View,
    rows: NDArray[np.int32] | None = None,
    far_m: float = FAR_M,
) -> CpuProjection:
    """Project Gaussians into a view and order them by depth: see `renderer_interface.Project`."""
    if rows is None:
        rows = np.arange(len(means), dtype=np.int32)
    n, width, height = len(rows), view.width, view.height
    splats = np.empty((n, COLUMNS), np.float32)
    tiles = np.empty((n, 4), np.int16)
    visible = np.empty(n, np.int32)
    f4 = np.float32
    count = project_kernel(
        rows,
        means,
        radius_m,
        opacity,
        np.ascontiguousarray(view.T_cam_world, np.float32),
        (f4(view.fx), f4(view.fy), f4(view.cx), f4(view.cy)),
        (width, height),
        (f4(NEAR_M), f4(far_m), f4(LOW_PASS_PX2)),
        splats,
        tiles,
        visible,
    )
    splats, tiles = splats[:count], tiles[:count]
    order = np.empty(count, np.int32)
    depth_order_kernel(splats, order)
    tiles_x, tiles_y = -(-width // TILE), -(-height // TILE)
    offsets = np.empty(tiles_x * tiles_y + 1, np.int64)
    bin_kernel(order, tiles, tiles_x, offsets, order, False)
    entries = np.empty(int(offsets[-1]), np.int32)
    bin_kernel(order, tiles, tiles_x, offsets, entries, True)
    return CpuProjection(width, height, visible[:count], splats, offsets, entries)
