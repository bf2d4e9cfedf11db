"""The three functions of gsplat 1.5 that the CUDA back end calls, in plain torch, for any device.

They follow gsplat's documentation and serve to test the code around them without a GPU. They do
not test gsplat itself.
"""

from __future__ import annotations

import torch
from torch import Tensor


def isect_tiles(
    means2d: Tensor,  # [1, n, 2]
    radii: Tensor,  # [1, n, 2] int32
    depths: Tensor,  # [1, n]
    tile_size: int,
    tile_width: int,
    tile_height: int,
) -> tuple[Tensor, Tensor, Tensor]:
    """Tiles per splat, sorted keys (tile, depth) and the splat of each."""
    low = torch.floor((means2d[0] - radii[0]) / tile_size).long()
    high = torch.ceil((means2d[0] + radii[0]) / tile_size).long()
    bits = depths[0].contiguous().view(torch.int32).tolist()
    keys, splats, counts = [], [], []
    for i, ((u0, v0), (u1, v1)) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        tiles = [
            v * tile_width + u
            for v in range(max(v0, 0), min(v1, tile_height))
            for u in range(max(u0, 0), min(u1, tile_width))
        ]
        keys += [(tile << 32) | bits[i] for tile in tiles]
        splats += [i] * len(tiles)
        counts.append(len(tiles))
    order = torch.argsort(torch.tensor(keys, dtype=torch.int64), stable=True)
    return (
        torch.tensor([counts]),
        torch.tensor(keys, dtype=torch.int64)[order],
        torch.tensor(splats, dtype=torch.int32)[order],
    )


def isect_offset_encode(keys: Tensor, n_images: int, tile_width: int, tile_height: int) -> Tensor:
    """[1, tile_height, tile_width] first entry of each tile."""
    assert n_images == 1
    tiles = torch.arange(tile_width * tile_height)
    first = torch.searchsorted(keys >> 32, tiles)
    return first.to(torch.int32).reshape(1, tile_height, tile_width)


def rasterize_to_pixels(
    means2d: Tensor,  # [1, n, 2], the first pixel's centre is (1/2, 1/2)
    conics: Tensor,  # [1, n, 3]
    colors: Tensor,  # [1, n, c]
    opacities: Tensor,  # [1, n]
    width: int,
    height: int,
    tile_size: int,
    offsets: Tensor,
    entries: Tensor,
) -> tuple[Tensor, Tensor]:
    """[1, h, w, c] blended colours and [1, h, w, 1] coverage, differentiable in the colours."""
    tiles_v, tiles_u = offsets.shape[1:]
    ends = torch.cat([offsets.flatten()[1:], torch.tensor([len(entries)])]).tolist()
    v, u = torch.meshgrid(torch.arange(tile_size), torch.arange(tile_size), indexing="ij")
    tiles = []
    for t, (first, end) in enumerate(zip(offsets.flatten().tolist(), ends, strict=True)):
        own = entries[first:end].long()
        du = u.reshape(-1, 1) + t % tiles_u * tile_size + 0.5 - means2d[0, own, 0]
        dv = v.reshape(-1, 1) + t // tiles_u * tile_size + 0.5 - means2d[0, own, 1]
        a, b, c = conics[0, own].T
        alpha = opacities[0, own] * torch.exp(-0.5 * (a * du * du + c * dv * dv) - b * du * dv)
        alpha = torch.where(alpha < 1 / 255, 0.0, alpha.clamp(max=0.999))
        left = torch.cumprod(1 - alpha, 1)
        before = torch.cat([torch.ones(len(alpha), 1), left], 1)[:, : len(own)]
        kappa = torch.where(left > 1e-4, alpha * before, 0.0)
        tiles.append(torch.cat([kappa @ colors[0, own], kappa.sum(1, keepdim=True)], 1))
    image = torch.stack(tiles).reshape(tiles_v, tiles_u, tile_size, tile_size, -1)
    image = image.permute(0, 2, 1, 3, 4).reshape(tiles_v * tile_size, tiles_u * tile_size, -1)
    image = image[None, :height, :width]
    return image[..., :-1], image[..., -1:]
