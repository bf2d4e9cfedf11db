"""Near to far, and the same whatever order the Gaussians came in."""

from __future__ import annotations

import numpy as np
from numba import njit

from helios_objectmap.kernels.projection import DEPTH, LOG2_OPACITY, RADIUS, U, V

_PASSES = 3


@njit(cache=True, nogil=True)
def depth_order_kernel(splats, order):
    """Fill order [k] with the splats from near to far: a radix sort of the bits of the depth.

    Positive float32 are ordered as their bits are. Equal depths are ordered by what is drawn:
    centre, radius and opacity.
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
    """What orders a splat among those equally far: centre, radius and opacity, mixed.

    words: [n, COLUMNS] the bits of the splats.
    """
    mixed = (np.uint64(words[i, U]) << np.uint64(32)) | np.uint64(words[i, V])
    mixed ^= np.uint64(words[i, RADIUS]) * np.uint64(0x9E3779B97F4A7C15)
    return mixed ^ (np.uint64(words[i, LOG2_OPACITY]) * np.uint64(0xC2B2AE3D27D4EB4F))
