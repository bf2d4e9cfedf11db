"""Numba kernels of the object map. Reached only through `splat.py` and `instances.py`.

Pixel (u, v) has its centre at the integer coordinates (u, v), as in `helios_core.geometry`.
Written for SIMD: each Gaussian touches a flat run of whole tile rows, exp is a polynomial, and a
tile owns its pixels, so threads never share an output and results do not depend on their number.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

TILE = 16
ALPHA_MIN = 1.0 / 255.0
ALPHA_MAX = 0.999
TRANSMITTANCE_MIN = 1e-4
# Columns of the projected parameters.
U, V, CONIC_A, CONIC_B, CONIC_C, OPACITY, DEPTH, HALF_HEIGHT = range(8)
N_PARAMETERS = 8

_f4 = np.float32
_i4 = np.int32
_LOG2E = 1.4426950408889634


@njit(cache=True, nogil=True, error_model="numpy")
def project_kernel(
    rows,
    means,
    radius,
    opacity,
    T_cam_world,
    fx,
    fy,
    cx,
    cy,
    width,
    height,
    near_m,
    far_m,
    low_pass,
    params,
    tiles,
    keys,
    visible,
):
    """EWA projection of the Gaussians in `rows`; lists the visible ones with params/tiles/keys.

    keys order by depth first and then by the bits of the projected centre, so that equal depths
    are ordered by what is drawn and never by their place in the store.
    """
    bits = np.empty(4, np.float32)
    words = bits.view(np.uint32)
    n_visible = 0
    for row in range(rows.size):
        i = rows[row]
        x = means[i, 0]
        y = means[i, 1]
        z = means[i, 2]
        depth = (
            T_cam_world[2, 0] * x + T_cam_world[2, 1] * y + T_cam_world[2, 2] * z
        ) + T_cam_world[2, 3]
        if depth <= near_m or depth >= far_m:
            continue
        xc = T_cam_world[0, 0] * x + T_cam_world[0, 1] * y + T_cam_world[0, 2] * z
        yc = T_cam_world[1, 0] * x + T_cam_world[1, 1] * y + T_cam_world[1, 2] * z
        slope_x = (xc + T_cam_world[0, 3]) / depth
        slope_y = (yc + T_cam_world[1, 3]) / depth
        u = fx * slope_x + cx
        v = fy * slope_y + cy
        scale_x = radius[i] * fx / depth
        scale_y = radius[i] * fy / depth
        cov_a = scale_x * scale_x * (_f4(1) + slope_x * slope_x) + low_pass
        cov_b = scale_x * scale_y * slope_x * slope_y
        cov_c = scale_y * scale_y * (_f4(1) + slope_y * slope_y) + low_pass
        reach = _f4(2) * math.log(opacity[i] / _f4(ALPHA_MIN))
        if reach <= 0:
            continue
        half_w = math.sqrt(reach * cov_a)
        half_h = math.sqrt(reach * cov_c)
        u0 = max(0, math.ceil(u - half_w))
        u1 = min(width - 1, math.floor(u + half_w))
        v0 = max(0, math.ceil(v - half_h))
        v1 = min(height - 1, math.floor(v + half_h))
        if u0 > u1 or v0 > v1:
            continue
        inverse_det = _f4(1) / (cov_a * cov_c - cov_b * cov_b)
        params[n_visible, U] = u
        params[n_visible, V] = v
        params[n_visible, CONIC_A] = cov_c * inverse_det
        params[n_visible, CONIC_B] = -cov_b * inverse_det
        params[n_visible, CONIC_C] = cov_a * inverse_det
        params[n_visible, OPACITY] = opacity[i]
        params[n_visible, DEPTH] = depth
        params[n_visible, HALF_HEIGHT] = half_h
        tiles[n_visible, 0] = u0 // TILE
        tiles[n_visible, 1] = u1 // TILE
        tiles[n_visible, 2] = v0 // TILE
        tiles[n_visible, 3] = v1 // TILE
        bits[0] = depth
        bits[1] = u
        bits[2] = v
        bits[3] = radius[i]
        tie = np.uint64(words[1]) * np.uint64(2654435761) ^ np.uint64(words[2]) * np.uint64(40503)
        tie = (tie ^ np.uint64(words[3])) & np.uint64(0xFFFFFFFF)
        keys[n_visible] = (np.uint64(words[0]) << np.uint64(32)) | tie
        visible[n_visible] = i
        n_visible += 1
    return n_visible


@njit(cache=True, nogil=True)
def bin_kernel(tiles, tiles_x, offsets, entries, fill):
    """List per tile the Gaussians that touch it, in their order. First call with fill=False."""
    if not fill:
        offsets[:] = 0
        for g in range(tiles.shape[0]):
            for ty in range(tiles[g, 2], tiles[g, 3] + 1):
                for tx in range(tiles[g, 0], tiles[g, 1] + 1):
                    offsets[ty * tiles_x + tx + 1] += 1
        for t in range(offsets.size - 1):
            offsets[t + 1] += offsets[t]
        return
    cursor = offsets[:-1].copy()
    for g in range(tiles.shape[0]):
        for ty in range(tiles[g, 2], tiles[g, 3] + 1):
            for tx in range(tiles[g, 0], tiles[g, 1] + 1):
                t = ty * tiles_x + tx
                entries[cursor[t]] = g
                cursor[t] += 1


@njit(fastmath=True, cache=True, nogil=True, error_model="numpy")
def _pixel_grid(tile_u, tile_v, pu, pv):
    for i in range(TILE * TILE):
        pu[i] = _f4(i % TILE) + _f4(tile_u)
        pv[i] = _f4(i // TILE) + _f4(tile_v)


@njit(fastmath=True, cache=True, nogil=True, error_model="numpy")
def _blend_run(params, g, tile_v, pu, pv, trans, kappa, int_bits, float_bits):
    """Kappa of Gaussian g (eq. 1) over the flat run of tile rows it touches; dims `trans`.

    Returns the first pixel of the run and its length.
    """
    a = _f4(-0.5 * _LOG2E) * params[g, CONIC_A]
    b = _f4(-_LOG2E) * params[g, CONIC_B]
    c = _f4(-0.5 * _LOG2E) * params[g, CONIC_C]
    mu = params[g, U]
    mv = params[g, V]
    op = params[g, OPACITY]
    half = params[g, HALF_HEIGHT]
    row0 = max(0, math.ceil(mv - half) - tile_v)
    row1 = min(TILE - 1, math.floor(mv + half) - tile_v)
    first = row0 * TILE
    n = max(0, (row1 - row0 + 1) * TILE)
    run_u = pu[first : first + n]
    run_v = pv[first : first + n]
    run_t = trans[first : first + n]
    run_k = kappa[first : first + n]
    run_i = int_bits[first : first + n]
    run_f = float_bits[first : first + n]
    for i in range(n):
        du = run_u[i] - mu
        dv = run_v[i] - mv
        e = max(du * (a * du + b * dv) + c * dv * dv, _f4(-100))
        whole = _i4(e - _f4(0.5))
        f = e - _f4(whole)
        run_i[i] = (whole + _i4(127)) << _i4(23)
        p = _f4(1.8775767e-3) * f + _f4(8.9893397e-3)
        p = p * f + _f4(5.5826318e-2)
        p = p * f + _f4(2.4015361e-1)
        p = p * f + _f4(6.9315308e-1)
        run_k[i] = (p * f + _f4(1)) * op
    for i in range(n):
        alpha = min(run_k[i] * run_f[i], _f4(ALPHA_MAX))
        alpha = alpha if alpha >= _f4(ALPHA_MIN) else _f4(0)
        k = alpha * run_t[i]  # eq. 1
        run_k[i] = k
        run_t[i] -= k
    return first, n


@njit(fastmath=True, cache=True, nogil=True, error_model="numpy")
def _is_opaque(trans):
    most = _f4(0)
    for i in range(TILE * TILE):
        most = max(most, trans[i])
    return most < _f4(TRANSMITTANCE_MIN)


@njit(parallel=True, fastmath=True, cache=True, nogil=True, error_model="numpy")
def raster_kernel(params, features, offsets, entries, width, height, out, transmittance):
    """Alpha-blend features [n, c] front to back into out [c, h, w] (the line above eq. 1)."""
    n_channels = features.shape[1]
    tiles_x = (width + TILE - 1) // TILE
    n_pixels = TILE * TILE
    for t in prange(offsets.size - 1):
        if offsets[t + 1] > offsets[t]:
            tile_v = t // tiles_x * TILE
            tile_u = t % tiles_x * TILE
            acc = np.zeros((n_channels, n_pixels), np.float32)
            trans = np.ones(n_pixels, np.float32)
            kappa = np.empty(n_pixels, np.float32)
            pu = np.empty(n_pixels, np.float32)
            pv = np.empty(n_pixels, np.float32)
            int_bits = np.empty(n_pixels, np.int32)
            float_bits = int_bits.view(np.float32)
            _pixel_grid(tile_u, tile_v, pu, pv)
            for k in range(offsets[t], offsets[t + 1]):
                g = entries[k]
                first, n = _blend_run(params, g, tile_v, pu, pv, trans, kappa, int_bits, float_bits)
                run_k = kappa[first : first + n]
                for ch in range(n_channels):
                    value = features[g, ch]
                    run_a = acc[ch, first : first + n]
                    for i in range(n):
                        run_a[i] += run_k[i] * value
                if (k - offsets[t]) & 15 == 15 and _is_opaque(trans):
                    break
            for r in range(min(TILE, height - tile_v)):
                for ch in range(n_channels):
                    for x in range(min(TILE, width - tile_u)):
                        out[ch, tile_v + r, tile_u + x] = acc[ch, r * TILE + x]
                for x in range(min(TILE, width - tile_u)):
                    transmittance[tile_v + r, tile_u + x] = trans[r * TILE + x]


@njit(parallel=True, fastmath=True, cache=True, nogil=True, error_model="numpy")
def kappa_sums_kernel(params, offsets, entries, labels, n_labels, width, height, partial):
    """Sum kappa per (tile entry, label) over the pixels with label >= 0; partial [entries, l]."""
    tiles_x = (width + TILE - 1) // TILE
    n_pixels = TILE * TILE
    for t in prange(offsets.size - 1):
        if offsets[t + 1] > offsets[t]:
            tile_v = t // tiles_x * TILE
            tile_u = t % tiles_x * TILE
            plane = np.zeros((n_labels, n_pixels), np.float32)
            present = np.zeros(n_labels, np.int32)
            total = 0
            for r in range(min(TILE, height - tile_v)):
                for x in range(min(TILE, width - tile_u)):
                    label = labels[tile_v + r, tile_u + x]
                    if label >= 0:
                        plane[label, r * TILE + x] = _f4(1)
                        present[label] += 1
                        total += 1
            if total > 0:
                trans = np.ones(n_pixels, np.float32)
                kappa = np.empty(n_pixels, np.float32)
                pu = np.empty(n_pixels, np.float32)
                pv = np.empty(n_pixels, np.float32)
                int_bits = np.empty(n_pixels, np.int32)
                float_bits = int_bits.view(np.float32)
                _pixel_grid(tile_u, tile_v, pu, pv)
                for k in range(offsets[t], offsets[t + 1]):
                    first, n = _blend_run(
                        params, entries[k], tile_v, pu, pv, trans, kappa, int_bits, float_bits
                    )
                    run_k = kappa[first : first + n]
                    for label in range(n_labels):
                        if present[label] > 0:
                            run_y = plane[label, first : first + n]
                            s = _f4(0)
                            for i in range(n):
                                s += run_k[i] * run_y[i]
                            partial[k, label] = s
                    if (k - offsets[t]) & 15 == 15 and _is_opaque(trans):
                        break


@njit(cache=True, nogil=True)
def scatter_kernel(entries, partial, out):
    """Add each tile entry's sums to its Gaussian, in list order; out [n, l]."""
    for k in range(entries.size):
        g = entries[k]
        for label in range(partial.shape[1]):
            out[g, label] += partial[k, label]


@njit(cache=True, nogil=True)
def components_kernel(keys, deltas, parent):
    """26-connected components of sorted voxel keys; parent [n] ends as each one's first voxel."""
    n = keys.size
    for i in range(n):
        parent[i] = i
        root = i
        for d in range(deltas.size):
            j = np.searchsorted(keys, keys[i] + deltas[d])
            if j < n and keys[j] == keys[i] + deltas[d]:
                other = j
                while parent[other] != other:
                    parent[other] = parent[parent[other]]
                    other = parent[other]
                if other < root:
                    parent[root] = other
                    root = other
                elif other > root:
                    parent[other] = root
    for i in range(n):
        a = i
        while parent[a] != a:
            a = parent[a]
        parent[i] = a
