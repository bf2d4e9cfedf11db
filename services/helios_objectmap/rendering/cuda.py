"""CUDA renderer: projection in torch, rasterisation by gsplat (the extra `cuda`).

gsplat blends as the CPU renderer does, but it leaves a pixel just before less than 1e-4 of the
light would remain, and it sums kappa with atomics: results differ between runs by rounding. The
centre of its pixel (u, v) is (u + 1/2, v + 1/2).
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from helios_core.errors import Unavailable
from numpy.typing import NDArray

from helios_objectmap.camera import View
from helios_objectmap.rendering.kernels import ALPHA_MIN, COVERAGE_MIN, OPACITY_MAX, TILE
from helios_objectmap.rendering.renderer_interface import (
    FAR_M,
    LOW_PASS_PX2,
    NEAR_M,
    Float32,
    Rendering,
)

if TYPE_CHECKING:
    from torch import Tensor

DEVICE = "cuda"
_HALF_PIXEL = 0.5


def _gsplat():
    """The gsplat module, imported at the first use, which also builds its kernels."""
    return importlib.import_module("gsplat")


def require() -> None:
    """Raise Unavailable, with the remedy, unless gsplat can run here."""
    chosen = "HELIOS_OBJECTMAP_RENDERER is cuda, but"
    try:
        import torch

        _gsplat()
    except ImportError as error:
        install = "pip install 'helios-ovmm[cuda]'"
        raise Unavailable(f"{chosen} {error}; {install}, or choose cpu") from error
    if not torch.cuda.is_available():
        raise Unavailable(
            f"{chosen} torch {torch.__version__} sees no CUDA device; check nvidia-smi and that "
            "this torch is built for CUDA, or choose cpu"
        )


@dataclass(frozen=True)
class Splats:
    """Tensors of the Gaussians that touch an image, on one device, in the order of their rows."""

    rows: Tensor  # [k] int64
    uv: Tensor  # [k, 2] pixels
    conics: Tensor  # [k, 3] inverse covariances, 1 / px^2: uu, uv, vv
    half_px: Tensor  # [k, 2] half extent in which alpha exceeds ALPHA_MIN
    depth_m: Tensor  # [k]
    opacity: Tensor  # [k]
    radius_m: Tensor  # [k]


@dataclass(frozen=True)
class CudaProjection:
    """Gaussians projected into one view."""

    width: int
    height: int
    rows: NDArray[np.int32]  # [k] indices of the Gaussians
    depth_m: Float32  # [k] distance along the optical axis
    uv: Float32  # [k, 2] projected centres in pixels
    splats: Splats  # of the same rows
    offsets: Tensor | None  # [1, tiles v, tiles u] into entries; None if nothing is in view
    entries: Tensor | None  # splats of each tile, near to far

    def render(self, features: Float32 | None = None) -> Rendering:
        """Blend depth and, if given, features [k, c] of the rows over the image (eq. 1)."""
        import torch

        channels = self.splats.depth_m[:, None]
        if features is not None:
            given = torch.from_numpy(np.ascontiguousarray(features, np.float32))
            channels = torch.cat([channels, given.to(channels.device)], dim=1)
        if not len(self.rows):
            blank = np.zeros((self.height, self.width), np.float32)
            planes = np.zeros((channels.shape[1] - 1, *blank.shape), np.float32)
            return Rendering(blank, blank.copy(), planes)
        with torch.no_grad():
            blended, coverage = self._rasterized(channels)
            depth = torch.where(coverage > COVERAGE_MIN, blended[..., 0] / coverage, 0.0)
            planes = blended[..., 1:].permute(2, 0, 1).contiguous()
        return Rendering(depth.cpu().numpy(), coverage.cpu().numpy(), planes.cpu().numpy())

    def kappa_sums(self, labels: NDArray[np.int32], n_labels: int) -> Float32:
        """Sum kappa(p, n) over the pixels of each label: the sum of eq. 3, [k, n_labels].

        The blended image is linear in the channels, so the sum of kappa over a label's pixels
        equals the gradient of the blended channel, summed over these pixels.
        """
        import torch

        if not len(self.rows):
            return np.zeros((0, n_labels), np.float32)
        device = self.splats.uv.device
        channels = torch.zeros(len(self.rows), n_labels, device=device, requires_grad=True)
        number = torch.arange(n_labels, device=device)
        chosen = torch.from_numpy(np.ascontiguousarray(labels, np.int32)).to(device)
        with torch.enable_grad():
            blended, _ = self._rasterized(channels)
            (sums,) = torch.autograd.grad(
                blended, channels, (chosen[..., None] == number).to(blended.dtype)
            )
        return sums.cpu().numpy()

    def renewed(self, gone: NDArray[np.integer], more: CudaProjection) -> CudaProjection:
        """This projection without the Gaussians `gone`, plus those of `more` in the same view."""
        import torch

        kept = torch.ones(len(self.rows), dtype=torch.bool, device=self.splats.uv.device)
        kept[torch.from_numpy(np.asarray(gone, np.int64)).to(kept.device)] = False
        splats = Splats(
            *(
                torch.cat([getattr(self.splats, f.name)[kept], getattr(more.splats, f.name)])
                for f in fields(Splats)
            )
        )
        return _projection(splats, self.width, self.height)

    def _rasterized(self, channels: Tensor) -> tuple[Tensor, Tensor]:
        """Channels [k, c] blended to an image [h, w, c], and the coverage [h, w]."""
        blended, coverage = _gsplat().rasterize_to_pixels(
            (self.splats.uv + _HALF_PIXEL)[None],
            self.splats.conics[None],
            channels[None],
            self.splats.opacity[None],
            self.width,
            self.height,
            TILE,
            self.offsets,
            self.entries,
        )
        return blended[0], coverage[0, ..., 0]


def project(
    means: Float32,
    radius_m: Float32,
    opacity: Float32,
    view: View,
    rows: NDArray[np.int32] | None = None,
    far_m: float = FAR_M,
) -> CudaProjection:
    """Project Gaussians into a view and order them by depth: see `renderer_interface.Project`."""
    import torch

    if rows is None:
        rows = np.arange(len(means), dtype=np.int32)
    with torch.no_grad():
        splats = splats_of(means, radius_m, opacity, view, rows, far_m, DEVICE)
    return _projection(splats, view.width, view.height)


def _projection(splats: Splats, width: int, height: int) -> CudaProjection:
    """Projection from splats: adds the tiles that each splat touches."""
    import torch

    offsets = entries = None
    with torch.no_grad():
        if len(splats.rows):
            offsets, entries = _tiles(splats, width, height)
    return CudaProjection(
        width,
        height,
        splats.rows.to(torch.int32).cpu().numpy(),
        splats.depth_m.cpu().numpy(),
        splats.uv.cpu().numpy(),
        splats,
        offsets,
        entries,
    )


def _tiles(splats: Splats, width: int, height: int) -> tuple[Tensor, Tensor]:
    """Offsets and entries of a projection."""
    import torch

    tiles_u, tiles_v = -(-width // TILE), -(-height // TILE)
    order = tie_order(splats)  # gsplat's sort by depth is stable: ties keep this order
    uv = splats.uv[order] + _HALF_PIXEL
    half_px = torch.ceil(splats.half_px[order]).to(torch.int32)
    _, keys, entries = _gsplat().isect_tiles(
        uv[None], half_px[None], splats.depth_m[order][None], TILE, tiles_u, tiles_v
    )
    offsets = _gsplat().isect_offset_encode(keys, 1, tiles_u, tiles_v)
    return offsets, order[entries.long()].to(torch.int32)


def splats_of(
    means: Float32,
    radius_m: Float32,
    opacity: Float32,
    view: View,
    rows: NDArray[np.int32],
    far_m: float,
    device: str,
) -> Splats:
    """EWA projection in torch; equivalent to `rendering.kernels.project_kernel`."""
    import torch

    def tensor(array: NDArray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array, np.float32)).to(device)

    T = tensor(view.T_cam_world)
    strength = tensor(opacity[rows]).clamp(max=OPACITY_MAX)
    radius = tensor(radius_m[rows])
    p = tensor(means[rows]) @ T[:3, :3].T + T[:3, 3]
    depth = p[:, 2]
    slope = p[:, :2] / depth[:, None]
    focal = torch.tensor([view.fx, view.fy], dtype=torch.float32, device=device)
    center = torch.tensor([view.cx, view.cy], dtype=torch.float32, device=device)
    last = torch.tensor([view.width - 1, view.height - 1], device=device)
    uv = focal * slope + center
    scale = radius[:, None] * focal / depth[:, None]
    variance = scale**2 * (1 + slope**2) + LOW_PASS_PX2
    covariance = scale.prod(dim=1) * slope.prod(dim=1)
    reach = 2 * torch.log(strength / ALPHA_MIN)
    half = torch.sqrt(reach.clamp(min=0)[:, None] * variance)
    first_px = torch.ceil(uv - half).clamp(min=0)
    last_px = torch.minimum(torch.floor(uv + half), last)
    shown = (depth > NEAR_M) & (depth < far_m) & (reach > 0) & (first_px <= last_px).all(dim=1)
    k = torch.nonzero(shown).squeeze(1)
    determinant = variance[k].prod(dim=1) - covariance[k] ** 2
    conics = torch.stack([variance[k, 1], -covariance[k], variance[k, 0]], dim=1)
    return Splats(
        torch.from_numpy(rows.astype(np.int64)).to(device)[k],
        uv[k],
        conics / determinant[:, None],
        half[k],
        depth[k],
        strength[k],
        radius[k],
    )


def tie_order(splats: Splats) -> Tensor:
    """Order [k] of the splats by drawn attributes only: centre, radius and opacity."""
    import torch

    order = torch.arange(len(splats.rows), device=splats.rows.device)
    for drawn in (splats.opacity, splats.radius_m, splats.uv[:, 1], splats.uv[:, 0]):
        order = order[torch.argsort(drawn[order], stable=True)]
    return order
