"""Plain torch rasteriser of Gaussians, tile by tile: the peer of our renderer."""

from __future__ import annotations

import torch
from torch import Tensor

TILE = 16
LOW_PASS_PX2 = 0.3


def render(
    means: Tensor,  # [n, 3] world
    radius: Tensor,  # [n]
    opacity: Tensor,  # [n]
    features: Tensor,  # [n, c]
    T_cam_world: Tensor,  # [4, 4]
    f: float,
    cx: float,
    cy: float,
    width: int,
    height: int,
) -> Tensor:
    """Blended features [c, h, w] (eq. 1): alpha by EWA splatting, composited near to far."""
    p = means @ T_cam_world[:3, :3].T + T_cam_world[:3, 3]
    z = p[:, 2]
    front = z > 0.05
    p, z, radius = p[front], z[front], radius[front]
    opacity, features = opacity[front], features[front]
    u, v = f * p[:, 0] / z + cx, f * p[:, 1] / z + cy
    # J J^T r^2 with J the Jacobian of the projection, plus a low-pass filter
    a, b = -f * p[:, 0] / z**2, -f * p[:, 1] / z**2
    s2 = radius**2
    cxx = s2 * ((f / z) ** 2 + a * a) + LOW_PASS_PX2
    cyy = s2 * ((f / z) ** 2 + b * b) + LOW_PASS_PX2
    cxy = s2 * a * b
    det = cxx * cyy - cxy**2
    reach = 3.33 * torch.sqrt(torch.maximum(cxx, cyy))
    order = torch.argsort(z, stable=True)
    u, v, reach, opacity, features = (t[order] for t in (u, v, reach, opacity, features))
    conic = torch.stack([cyy[order], -cxy[order], cxx[order]], 1) / det[order, None]
    out = torch.zeros(features.shape[1], height, width)
    ys, xs = torch.meshgrid(torch.arange(TILE), torch.arange(TILE), indexing="ij")
    for y0 in range(0, height, TILE):
        row = (v + reach >= y0) & (v - reach < y0 + TILE)
        for x0 in range(0, width, TILE):
            own = torch.nonzero(row & (u + reach >= x0) & (u - reach < x0 + TILE)).squeeze(1)
            if len(own) == 0:
                continue
            dx = (xs.reshape(1, -1) + x0) - u[own, None]
            dy = (ys.reshape(1, -1) + y0) - v[own, None]
            c = conic[own]
            power = c[:, :1] * dx * dx + 2 * c[:, 1:2] * dx * dy + c[:, 2:] * dy * dy
            alpha = (opacity[own, None] * torch.exp(-0.5 * power)).clamp(max=0.999)
            alpha = torch.where(alpha < 1 / 255, 0.0, alpha)
            light = torch.cumprod(1 - alpha, 0)
            kappa = alpha * torch.cat([torch.ones(1, TILE * TILE), light[:-1]])
            tile = (features[own].T @ kappa).reshape(-1, TILE, TILE)
            h, w = min(TILE, height - y0), min(TILE, width - x0)
            out[:, y0 : y0 + h, x0 : x0 + w] = tile[:, :h, :w]
    return out
