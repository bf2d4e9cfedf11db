"""Front-to-back blending of the splats of a tile: kappa (eq. 1), row by row of sixteen pixels.

The splats of a tile are taken in chunks. For each row of the tile, the kernel lists the splats that
reach the row, computes their kappa with the remaining light held in a register, and either blends
features, blends depth alone, or sums kappa per label.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from helios_objectmap.rendering.kernels import (
    ALPHA_MIN,
    COVERAGE_MIN,
    DEPTH,
    LOG2_OPACITY,
    QUADRATIC_UU,
    QUADRATIC_UV,
    QUADRATIC_VV,
    TILE,
    U,
    V,
)
from helios_objectmap.rendering.simd_intrinsics import (
    LANES,
    at_most,
    exp2_above,
    fill,
    fill_from,
    larger,
    largest_of,
    load,
    ramp,
    store,
    sum_of,
)

TRANSMITTANCE_MIN = 1e-4
CHUNK = 64  # splats at a time; a row without light is finished after its chunk
CHANNEL_BLOCK = 4  # channels blended together; their sums fit the registers of every CPU
_ALL_ROWS = (1 << TILE) - 1
_PARAMETERS = 8  # per splat in a tile

_f4 = np.float32
_i8 = np.int64
_LOG2_ALPHA_MIN = math.log2(ALPHA_MIN)
_SLACK_PX2 = 0.01  # margin, so that rounding misses no row


@njit(cache=True, nogil=True, error_model="numpy")
def _list_hits(splats, entries, first, n, tile_u, tile_v, own, hits, n_hits):
    """Copy n splats relative to a tile into `own`; list, for each row, the splats that reach it."""
    reached = np.empty(CHUNK, np.uint32)  # bit r: reaches row r
    zero, rows, last = fill(_f4(0)), ramp(), fill(_f4(TILE - 1))
    for j in range(n):
        g = entries[first + j]
        u, v = splats[g, U] - _f4(tile_u), splats[g, V] - _f4(tile_v)
        a, b, c = splats[g, QUADRATIC_UU], splats[g, QUADRATIC_UV], splats[g, QUADRATIC_VV]
        strength = splats[g, LOG2_OPACITY]
        own[j * _PARAMETERS] = u
        own[j * _PARAMETERS + 1] = v
        own[j * _PARAMETERS + 2] = a
        own[j * _PARAMETERS + 3] = b
        own[j * _PARAMETERS + 4] = c
        own[j * _PARAMETERS + 5] = strength
        # In a row the exponent peaks at `middle`; within `width2` (squared) it exceeds the minimum.
        inverse = _f4(-1) / a
        dv = rows - fill(v)
        middle = fill(u) + fill(_f4(0.5) * b * inverse) * dv
        width2 = fill((strength - _f4(_LOG2_ALPHA_MIN)) * inverse + _f4(_SLACK_PX2)) + (
            fill((c + _f4(0.25) * b * b * inverse) * inverse) * dv * dv
        )
        gap = larger(zero, larger(zero - middle, middle - last))
        reached[j] = at_most(gap * gap, width2)
    for row in range(TILE):  # branch-free: the hits are unpredictable
        m = 0
        for j in range(n):
            hits[row * CHUNK + m] = j
            m += _i8((reached[j] >> np.uint32(row)) & np.uint32(1))
        n_hits[row] = m


@njit(cache=True, nogil=True, error_model="numpy")
def _kappa_of_row(own, hits, n, row, light, at_light, kappa):
    """kappa [n, 16] of the splats that reach a row (eq. 1); dims light [at_light : + 16].

    Returns the largest remaining light of a pixel.
    """
    left, u = load(light, at_light), ramp()
    for i in range(n):
        at = _i8(hits[row * CHUNK + i]) * _PARAMETERS
        du = u - fill_from(own, at)
        dv = _f4(row) - own[at + 1]
        exponent = du * (du * fill_from(own, at + 2) + fill(own[at + 3] * dv)) + fill(
            own[at + 4] * dv * dv + own[at + 5]
        )
        k = exp2_above(exponent, _f4(_LOG2_ALPHA_MIN)) * left
        left = left - k
        store(kappa, i * TILE, k)
    store(light, at_light, left)
    return largest_of(left)


@njit(cache=True, nogil=True, error_model="numpy")
def _copy_channels(splats, features, n_features, entries, first, n, n_channels, channels):
    """Copy depth and features of n splats into channels [n, n_channels].

    It copies sixteen features at a time. The next splat overwrites the surplus ones, or they blend
    into unused channels.
    """
    for j in range(n):
        g = _i8(entries[first + j])
        channels[j * n_channels] = splats[g, DEPTH]
        for c in range(0, n_features, LANES):
            at, to = g * n_features + c, j * n_channels + 1 + c
            if at + LANES <= features.size:
                store(channels, to, load(features, at))
            else:
                for i in range(min(LANES, n_features - c)):
                    channels[to + i] = features[at + i]


@njit(cache=True, nogil=True, error_model="numpy")
def _blend_row(channels, hits, n, row, n_channels, kappa, band, at_band, stride):
    """Add kappa times the channels of the splats that reach a row to its sixteen pixels.

    The pixels of channel c start at band[at_band + c * stride].
    """
    for c in range(0, n_channels, CHANNEL_BLOCK):
        to0 = at_band + c * stride
        to1, to2, to3 = to0 + stride, to0 + 2 * stride, to0 + 3 * stride
        s0, s1, s2, s3 = load(band, to0), load(band, to1), load(band, to2), load(band, to3)
        for i in range(n):
            at = _i8(hits[row * CHUNK + i]) * n_channels + c
            k = load(kappa, i * TILE)
            s0 = s0 + k * fill_from(channels, at)
            s1 = s1 + k * fill_from(channels, at + 1)
            s2 = s2 + k * fill_from(channels, at + 2)
            s3 = s3 + k * fill_from(channels, at + 3)
        store(band, to0, s0)
        store(band, to1, s1)
        store(band, to2, s2)
        store(band, to3, s3)


@njit(cache=True, nogil=True, error_model="numpy")
def _blend_tile(
    splats, features, n_features, entries, start, end, tile_u, tile_v, n_channels, light, band,
    stride,
):  # fmt: skip
    own = np.empty(CHUNK * _PARAMETERS, np.float32)
    channels = np.zeros(CHUNK * n_channels + LANES, np.float32)
    kappa = np.empty(CHUNK * TILE, np.float32)
    hits, n_hits = np.empty(TILE * CHUNK, np.int32), np.empty(TILE, np.int32)
    finished = 0
    for first in range(start, end, CHUNK):
        n = min(CHUNK, end - first)
        _list_hits(splats, entries, first, n, tile_u, tile_v, own, hits, n_hits)
        _copy_channels(splats, features, n_features, entries, first, n, n_channels, channels)
        for row in range(TILE):
            m = n_hits[row]
            if m > 0 and not (finished >> row) & 1:
                left = _kappa_of_row(own, hits, m, row, light, row * stride + tile_u, kappa)
                at_band = row * n_channels * stride + tile_u
                _blend_row(channels, hits, m, row, n_channels, kappa, band, at_band, stride)
                if left < _f4(TRANSMITTANCE_MIN):
                    finished |= 1 << row
        if finished == _ALL_ROWS:
            break


@njit(cache=True, nogil=True, error_model="numpy")
def _depth_of_row(own, depths, hits, n, row, light, at_light, band, at_band):
    """Add kappa times the depth of the splats that reach a row to band [at_band : + 16].

    Like `_kappa_of_row` and `_blend_row` with one channel, without storing kappa. Dims light
    [at_light : + 16] and returns the largest remaining light of a pixel.
    """
    left, total, u = load(light, at_light), load(band, at_band), ramp()
    for i in range(n):
        j = _i8(hits[row * CHUNK + i])
        at = j * _PARAMETERS
        du = u - fill_from(own, at)
        dv = _f4(row) - own[at + 1]
        exponent = du * (du * fill_from(own, at + 2) + fill(own[at + 3] * dv)) + fill(
            own[at + 4] * dv * dv + own[at + 5]
        )
        k = exp2_above(exponent, _f4(_LOG2_ALPHA_MIN)) * left
        left = left - k
        total = total + k * fill_from(depths, j)
    store(light, at_light, left)
    store(band, at_band, total)
    return largest_of(left)


@njit(cache=True, nogil=True, error_model="numpy")
def _blend_depth_of_tile(splats, entries, start, end, tile_u, tile_v, light, band, stride):
    """Like `_blend_tile` without features: band [row, u]."""
    own = np.empty(CHUNK * _PARAMETERS, np.float32)
    depths = np.empty(CHUNK, np.float32)
    hits, n_hits = np.empty(TILE * CHUNK, np.int32), np.empty(TILE, np.int32)
    finished = 0
    for first in range(start, end, CHUNK):
        n = min(CHUNK, end - first)
        _list_hits(splats, entries, first, n, tile_u, tile_v, own, hits, n_hits)
        for j in range(n):
            depths[j] = splats[entries[first + j], DEPTH]
        for row in range(TILE):
            m = n_hits[row]
            if m > 0 and not (finished >> row) & 1:
                at = row * stride + tile_u
                left = _depth_of_row(own, depths, hits, m, row, light, at, band, at)
                if left < _f4(TRANSMITTANCE_MIN):
                    finished |= 1 << row
        if finished == _ALL_ROWS:
            break


@njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def raster_kernel(splats, features, offsets, entries, depth_m, coverage, blended):
    """Blend depth [h, w] and features [k * c] into blended [c, h, w]; coverage: sum of kappa.

    The line above eq. 1. Depth is divided by the coverage, features are not. The kernel blends a
    band of tiles before it writes it, so that each image row is fetched once.
    """
    height, width = coverage.shape
    n_features = blended.shape[0]
    n_channels = (1 + n_features + CHANNEL_BLOCK - 1) // CHANNEL_BLOCK * CHANNEL_BLOCK
    if n_features == 0:
        n_channels = 1
    tiles_x = (width + TILE - 1) // TILE
    tiles_y = (height + TILE - 1) // TILE
    stride = (tiles_x | 1) * TILE  # an odd number of tiles: rows map to different cache sets
    for i in prange(tiles_y):
        tile_y = _dealt(i, tiles_y)
        light = np.ones(TILE * stride, np.float32)
        band = np.zeros(TILE * n_channels * stride, np.float32)  # [row, channel, u]
        for tile_x in range(tiles_x):
            t = tile_y * tiles_x + tile_x
            if n_features == 0:
                _blend_depth_of_tile(
                    splats,
                    entries,
                    offsets[t],
                    offsets[t + 1],
                    tile_x * TILE,
                    tile_y * TILE,
                    light,
                    band,
                    stride,
                )
            else:
                _blend_tile(
                    splats, features, n_features, entries, offsets[t], offsets[t + 1],
                    tile_x * TILE, tile_y * TILE, n_channels, light, band, stride,
                )  # fmt: skip
        for row in range(min(TILE, height - tile_y * TILE)):
            v = tile_y * TILE + row
            for u in range(width):
                covered = _f4(1) - light[row * stride + u]
                depth = band[row * n_channels * stride + u]
                coverage[v, u] = covered
                depth_m[v, u] = depth / covered if covered > _f4(COVERAGE_MIN) else _f4(0)
            for c in range(n_features):
                at = (row * n_channels + 1 + c) * stride
                for u in range(width):
                    blended[c, v, u] = band[at + u]


@njit(cache=True, nogil=True)
def _dealt(i, n):
    """Band that loop step i handles: the even bands first, then the odd ones.

    Neighbouring bands cost about the same; this order spreads them over the threads.
    """
    half = (n + 1) // 2
    return 2 * i if i < half else 2 * (i - half) + 1


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_tile(
    splats, entries, start, end, tile_u, tile_v, planes, present, n_labels, light, partial
):
    """Sum kappa per label in one tile. planes: [labels * TILE * TILE], 1 where a pixel has the
    label; present: [labels * TILE], True where a pixel of the row has it."""
    own = np.empty(CHUNK * _PARAMETERS, np.float32)
    kappa = np.empty(CHUNK * TILE, np.float32)
    hits, n_hits = np.empty(TILE * CHUNK, np.int32), np.empty(TILE, np.int32)
    finished = 0
    for row in range(TILE):
        some = False
        for label in range(n_labels):
            some |= present[label * TILE + row]
        if not some:  # its light does not reach other rows
            finished |= 1 << row
    for first in range(start, end, CHUNK):
        n = min(CHUNK, end - first)
        _list_hits(splats, entries, first, n, tile_u, tile_v, own, hits, n_hits)
        for row in range(TILE):
            if n_hits[row] > 0 and not (finished >> row) & 1:
                left = _kappa_of_row(own, hits, n_hits[row], row, light, row * TILE, kappa)
                for label in range(n_labels):
                    if present[label * TILE + row]:
                        plane = load(planes, (label * TILE + row) * TILE)
                        for i in range(n_hits[row]):
                            to = first + hits[row * CHUNK + i]
                            partial[to, label] += sum_of(load(kappa, i * TILE) * plane)
                if left < _f4(TRANSMITTANCE_MIN):
                    finished |= 1 << row
        if finished == _ALL_ROWS:
            break


@njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def kappa_sums_kernel(splats, offsets, entries, labels, n_labels, partial):
    """Sum kappa per (tile entry, label) over the pixels with label >= 0; partial [entries, l]."""
    height, width = labels.shape
    tiles_x = (width + TILE - 1) // TILE
    tiles_y = (height + TILE - 1) // TILE
    for i in prange(tiles_y * tiles_x):
        tile_y = _dealt(i // tiles_x, tiles_y)
        t = tile_y * tiles_x + i % tiles_x
        tile_v = tile_y * TILE
        tile_u = i % tiles_x * TILE
        partial[offsets[t] : offsets[t + 1]] = 0
        if offsets[t + 1] == offsets[t]:
            continue
        planes = np.zeros(n_labels * TILE * TILE, np.float32)
        present = np.zeros(n_labels * TILE, np.bool_)
        some = False
        for r in range(min(TILE, height - tile_v)):
            for x in range(min(TILE, width - tile_u)):
                label = labels[tile_v + r, tile_u + x]
                if label >= 0:
                    planes[(label * TILE + r) * TILE + x] = _f4(1)
                    present[label * TILE + r] = True
                    some = True
        if some:
            light = np.ones(TILE * TILE, np.float32)
            _sum_tile(
                splats, entries, offsets[t], offsets[t + 1], tile_u, tile_v, planes, present,
                n_labels, light, partial,
            )  # fmt: skip


@njit(cache=True, nogil=True)
def scatter_kernel(entries, partial, out):
    """Add each tile entry's sums to its splat, in list order; out [k, l]."""
    for k in range(entries.size):
        g = entries[k]
        for label in range(partial.shape[1]):
            out[g, label] += partial[k, label]
