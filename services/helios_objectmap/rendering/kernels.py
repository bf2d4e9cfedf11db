"""Numba kernels that turn Gaussians into splats: projection, tile lists, depth order, merging."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

# Columns of a splat. Its alpha at (U + du, V + dv) is
# 2 ** (QUADRATIC_UU du^2 + QUADRATIC_UV du dv + QUADRATIC_VV dv^2 + LOG2_OPACITY).
U, V, QUADRATIC_UU, QUADRATIC_UV, QUADRATIC_VV, LOG2_OPACITY, DEPTH, RADIUS = range(8)
COLUMNS = 8

_f4 = np.float32
_i8 = np.int64
_LOG2E = 1.4426950408889634
_RUN = 2048  # Gaussians that one thread projects at a time


@njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def project_kernel(
    rows, means, radius, opacity, T_cam_world, camera, size, limits, splats, tiles, visible
):
    """EWA projection of the Gaussians in `rows`, [n]. Returns the number that touch the image.

    camera: fx, fy, cx, cy; size: width, height; limits: near_m, far_m, low_pass_px2. Fills the
    first rows of splats [n, COLUMNS], tiles [n, 4] (first and last, u then v) and visible [n], in
    the order of `rows`.
    """
    n = rows.size
    runs = (n + _RUN - 1) // _RUN
    counts = np.zeros(runs, np.int64)
    for run in prange(runs):
        first = run * _RUN
        counts[run] = _project_run(
            first, min(first + _RUN, n), rows, means, radius, opacity, T_cam_world, camera, size,
            limits, splats, tiles, visible,
        )  # fmt: skip
    total = 0
    for run in range(runs):
        first = run * _RUN
        if first != total:
            for i in range(counts[run]):
                for c in range(COLUMNS):
                    splats[total + i, c] = splats[first + i, c]
                for c in range(4):
                    tiles[total + i, c] = tiles[first + i, c]
                visible[total + i] = visible[first + i]
        total += counts[run]
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _project_run(
    first, end, rows, means, radius, opacity, T, camera, size, limits, splats, tiles, visible
):
    fx, fy, cx, cy = camera
    width, height = size
    near_m, far_m, low_pass = limits
    one = _f4(1)
    to = first
    last_opacity, reach, log2_strength = _f4(-1), _f4(0), _f4(0)
    for k in range(first, end):
        i = rows[k]
        x, y, z = means[i, 0], means[i, 1], means[i, 2]
        depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if not near_m < depth < far_m:
            continue
        inverse_depth = one / depth
        slope_x = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) * inverse_depth
        slope_y = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) * inverse_depth
        u = fx * slope_x + cx
        v = fy * slope_y + cy
        scale_x = radius[i] * fx * inverse_depth
        scale_y = radius[i] * fy * inverse_depth
        cov_uu = scale_x * scale_x * (one + slope_x * slope_x) + low_pass
        cov_uv = scale_x * scale_y * slope_x * slope_y
        cov_vv = scale_y * scale_y * (one + slope_y * slope_y) + low_pass
        if opacity[i] != last_opacity:  # most Gaussians have the opacity of a new one
            last_opacity = opacity[i]
            strength = min(last_opacity, _f4(OPACITY_MAX))
            reach = _f4(2) * math.log(strength * _f4(1 / ALPHA_MIN))
            log2_strength = math.log2(strength)
        if not reach > 0:
            continue
        half_w = math.sqrt(reach * cov_uu)
        half_h = math.sqrt(reach * cov_vv)
        u0, u1 = u - half_w, u + half_w
        v0, v1 = v - half_h, v + half_h
        if u1 < 0 or v1 < 0 or u0 > width - 1 or v0 > height - 1:
            continue
        first_u, last_u = max(0, _i8(math.ceil(u0))), min(width - 1, _i8(math.floor(u1)))
        first_v, last_v = max(0, _i8(math.ceil(v0))), min(height - 1, _i8(math.floor(v1)))
        if first_u > last_u or first_v > last_v:
            continue
        scale = _f4(-0.5 * _LOG2E) / (cov_uu * cov_vv - cov_uv * cov_uv)
        splats[to, U] = u
        splats[to, V] = v
        splats[to, QUADRATIC_UU] = cov_vv * scale
        splats[to, QUADRATIC_UV] = _f4(-2) * cov_uv * scale
        splats[to, QUADRATIC_VV] = cov_uu * scale
        splats[to, LOG2_OPACITY] = log2_strength
        splats[to, DEPTH] = depth
        splats[to, RADIUS] = radius[i]
        tiles[to, 0] = first_u // TILE
        tiles[to, 1] = last_u // TILE
        tiles[to, 2] = first_v // TILE
        tiles[to, 3] = last_v // TILE
        visible[to] = i
        to += 1
    return to - first


@njit(cache=True, nogil=True)
def bin_kernel(order, tiles, tiles_x, offsets, entries, fill):
    """List the splats that touch each tile, in `order`. A first call, fill=False, sets offsets."""
    if not fill:
        offsets[:] = 0
        for g in range(tiles.shape[0]):
            for ty in range(_i8(tiles[g, 2]), _i8(tiles[g, 3]) + 1):
                for tx in range(_i8(tiles[g, 0]), _i8(tiles[g, 1]) + 1):
                    offsets[ty * tiles_x + tx + 1] += 1
        for t in range(offsets.size - 1):
            offsets[t + 1] += offsets[t]
        return
    cursor = offsets[:-1].copy()
    for k in range(order.size):
        g = order[k]
        for ty in range(_i8(tiles[g, 2]), _i8(tiles[g, 3]) + 1):
            for tx in range(_i8(tiles[g, 0]), _i8(tiles[g, 1]) + 1):
                t = ty * tiles_x + tx
                entries[cursor[t]] = g
                cursor[t] += 1


_PASSES = 3


@njit(cache=True, nogil=True)
def depth_order_kernel(splats, order):
    """Fill order [k] with the splats from near to far, by a radix sort of the bits of the depth.

    Positive float32 sort like their bits. Drawn attributes order equal depths: centre, radius and
    opacity.
    """
    n = splats.shape[0]
    if n == 0:
        return
    keys = np.empty(n, np.uint32)
    bits = splats[:, DEPTH].copy().view(np.uint32)
    least, most = bits.min(), bits.max()
    width = 1
    while (most - least) >> (width * _PASSES):
        width += 1
    for i in range(n):
        keys[i] = bits[i] - least
        order[i] = i
    other_keys, other_order = np.empty_like(keys), np.empty_like(order)
    starts = np.empty((1 << width) + 1, np.int64)
    source, target = (keys, order), (other_keys, other_order)
    for which in range(_PASSES):
        _radix_pass(source, target, which * width, (1 << width) - 1, starts)
        source, target = target, source
    order[:] = source[1]
    _order_equal_depths(splats, source[0], order)


@njit(cache=True, nogil=True)
def _radix_pass(source, target, shift, mask, starts):
    keys, order = source
    to_keys, to_order = target
    starts[:] = 0
    for i in range(keys.size):
        starts[((keys[i] >> shift) & mask) + 1] += 1
    for d in range(starts.size - 1):
        starts[d + 1] += starts[d]
    for i in range(keys.size):
        digit = (keys[i] >> shift) & mask
        to = starts[digit]
        starts[digit] = to + 1
        to_keys[to] = keys[i]
        to_order[to] = order[i]


@njit(cache=True, nogil=True)
def _order_equal_depths(splats, keys, order):
    n = keys.size
    words = splats.view(np.uint32)
    first = 0
    while first < n:
        end = first + 1
        while end < n and keys[end] == keys[first]:
            end += 1
        if end - first > 1:
            run = order[first:end].copy()
            ties = np.empty(run.size, np.uint64)
            for i in range(run.size):
                ties[i] = tie(words, run[i])
            order[first:end] = run[np.argsort(ties, kind="mergesort")]
        first = end


@njit(cache=True, nogil=True)
def tie(words, i):
    """Sort key of a splat among splats of equal depth: centre, radius and opacity, mixed.

    words: [n, COLUMNS] bits of the splats.
    """
    mixed = (np.uint64(words[i, U]) << np.uint64(32)) | np.uint64(words[i, V])
    mixed ^= np.uint64(words[i, RADIUS]) * np.uint64(0x9E3779B97F4A7C15)
    return mixed ^ (np.uint64(words[i, LOG2_OPACITY]) * np.uint64(0xC2B2AE3D27D4EB4F))


@njit(cache=True, nogil=True)
def merged_offsets_kernel(number, offsets, entries, more_offsets, out_offsets):
    """Offsets of the merged tile lists: entries that keep a number (>= 0), plus the added ones."""
    out_offsets[0] = 0
    for t in range(offsets.size - 1):
        n = more_offsets[t + 1] - more_offsets[t]
        for k in range(offsets[t], offsets[t + 1]):
            n += number[entries[k]] >= 0
        out_offsets[t + 1] = out_offsets[t] + n


@njit(parallel=True, cache=True, nogil=True)
def merge_kernel(
    splats, number, offsets, entries, n_kept, more_offsets, more_entries, out_offsets, out_entries
):
    """Merge the two lists of each tile, near to far.

    splats: all splats of the new projection, the kept ones first; number: [old k] their new
    numbers, -1 for removed ones. The added splats are numbered from n_kept on.
    """
    words = splats.view(np.uint32)
    for t in prange(offsets.size - 1):
        to = out_offsets[t]
        j, last = more_offsets[t], more_offsets[t + 1]
        for k in range(offsets[t], offsets[t + 1]):
            g = number[entries[k]]
            if g < 0:
                continue
            while j < last and _is_nearer(words, n_kept + more_entries[j], g):
                out_entries[to] = n_kept + more_entries[j]
                to += 1
                j += 1
            out_entries[to] = g
            to += 1
        while j < last:
            out_entries[to] = n_kept + more_entries[j]
            to += 1
            j += 1


@njit(cache=True, nogil=True)
def _is_nearer(words, a, b):
    """True if splat a comes before splat b. Depths are positive and sort like their bits."""
    if words[a, DEPTH] != words[b, DEPTH]:
        return words[a, DEPTH] < words[b, DEPTH]
    return tie(words, a) < tie(words, b)


ALPHA_MIN = 1.0 / 255.0  # smaller alphas count as 0
OPACITY_MAX = 0.999  # larger opacities are clamped to this
COVERAGE_MIN = 1e-3  # pixels with less coverage have no depth
TILE = 16  # pixels, both ways
