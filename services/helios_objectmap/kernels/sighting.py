"""What a depth image says of each splat: one pass instead of a dozen over all in view."""

from __future__ import annotations

import numpy as np
from numba import njit

UNKNOWN, THROUGH, THERE = range(3)

_f4 = np.float32


@njit(cache=True, nogil=True)
def sight_kernel(uv, depth_m, nearest_m, nearest_tolerance_m, measured_m, tolerance_m, state):
    """Fill state [k] for splats at uv [k, 2] pixels and depth_m [k].

    measured_m, tolerance_m: [h, w]; nearest_m, nearest_tolerance_m: [h, w] least depth of the nine
    pixels around, 0 where one of them is invalid.
    """
    height, width = measured_m.shape
    for k in range(uv.shape[0]):
        state[k] = UNKNOWN
        u, v = np.int64(np.rint(uv[k, 0])), np.int64(np.rint(uv[k, 1]))
        if u < 0 or v < 0 or u >= width or v >= height:
            continue
        z, around, here = depth_m[k], nearest_m[v, u], measured_m[v, u]
        if around > 0 and z < around - nearest_tolerance_m[v, u]:
            state[k] = THROUGH
        elif here > 0 and abs(z - here) < tolerance_m[v, u]:
            state[k] = THERE
