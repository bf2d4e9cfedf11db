"""Numba kernels that test whether a view sees through mapped obstacles.

Called by `kernels/occupancy_fusion`. One pixel decides most cells, in SIMD batches; only undecided
cells examine every pixel that they cover.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from helios_map2d.kernels.depth_projection import FAST

HEIGHT_SAMPLES = 6
BATCH = 128  # cells per batch
WIDEST = 6  # most pixels that a cell covers on each side of its centre


@njit(cache=True, nogil=True, fastmath=FAST)
def project_obstacles(
    shape,  # (h, w) of the image
    lens,  # float32 [4]: fx, fy, cx, cy
    pose,  # float32 [3, 4]: rotation; the camera's column and row in the window, height in metres
    cell_m,
    far,
    xs,
    ys,
    lows,
    highs,  # float32 [n]: column, row, and heights of mapped obstacles
    depths,  # float32 [samples + 1, BATCH] out: depth of points, lowest to highest, then the middle
    pixels,  # int32 [samples + 1, BATCH] out: index of the points' pixels, -1 outside the image
    widths,  # int32 [samples + 1, BATCH] out: pixels that the cell covers on each side
):
    """Project sample points of mapped obstacles into the image."""
    # Few arrays per loop: with more, the compiler cannot exclude aliasing and drops SIMD.
    h, w = shape
    n = xs.size
    half, one, near = np.float32(0.5), np.float32(1.0), np.float32(0.05)
    width_px, widest = half * cell_m * lens[0], np.float32(WIDEST)
    right, down = np.empty(n, np.float32), np.empty(n, np.float32)
    ahead = np.empty(n, np.float32)
    for i in range(n):
        dx, dy = (xs[i] - pose[0, 3]) * cell_m, (ys[i] - pose[1, 3]) * cell_m
        right[i] = pose[0, 0] * dx + pose[1, 0] * dy
        down[i] = pose[0, 1] * dx + pose[1, 1] * dy
    for i in range(n):
        dx, dy = (xs[i] - pose[0, 3]) * cell_m, (ys[i] - pose[1, 3]) * cell_m
        ahead[i] = pose[0, 2] * dx + pose[1, 2] * dy
    for k in range(depths.shape[0]):
        share = np.float32(k / (HEIGHT_SAMPLES - 1) if k < HEIGHT_SAMPLES else 0.5)
        depth, pixel, width = depths[k], pixels[k], widths[k]
        for i in range(n):
            dz = lows[i] + share * (highs[i] - lows[i]) - pose[2, 3]
            depth[i] = ahead[i] + pose[2, 2] * dz
        for i in range(n):
            z = depth[i]
            over_z = one / (z if z > near else one)
            reach = np.floor(width_px * over_z) + one
            width[i] = np.int32(reach if reach < widest else widest)
        for i in range(n):
            z = depth[i]
            good = (z > near) & (z < far)
            over_z = one / (z if good else one)
            dz = lows[i] + share * (highs[i] - lows[i]) - pose[2, 3]
            x, y = right[i] + pose[2, 0] * dz, down[i] + pose[2, 1] * dz
            u = np.floor(x * over_z * lens[0] + lens[2] + half)
            v = np.floor(y * over_z * lens[1] + lens[3] + half)
            reach = np.floor(width_px * over_z) + one
            reach = reach if reach < widest else widest
            inside = (u >= reach) & (v >= reach) & (u + reach < w) & (v + reach < h)
            at = np.int32(v) * np.int32(w) + np.int32(u)
            pixel[i] = at if good & inside else np.int32(-1)


@njit(cache=True, nogil=True, fastmath=FAST)
def mark_possibly_seen_through(flat, lows, highs, depths, pixels, tolerance, unsure):
    """Set `unsure` uint8 [n] to 1 for mapped obstacles that the view may see through.

    That is so if, for any of its points, the depth at the middle pixel lies behind the obstacle or
    is not measured. For most obstacles it is not so, and this test decides.
    """
    n = lows.size
    zero, tall = np.float32(0.0), np.float32(0.05)
    found = np.empty(n, np.float32)
    unsure[:n] = 0
    for k in range(depths.shape[0]):
        depth, pixel, wanted = depths[k], pixels[k], k < HEIGHT_SAMPLES
        for i in range(n):
            at = pixel[i]
            found[i] = flat[np.uint32(at if at > 0 else 0)]
        for i in range(n):
            limit = depth[i] + tolerance[0] + tolerance[1] * depth[i]
            stopped = (found[i] > zero) & (found[i] <= limit)
            found[i] = zero if stopped | (pixel[i] < 0) else np.float32(1.0)
        for i in range(n):
            asked = (highs[i] - lows[i] > tall) == wanted
            unsure[i] |= asked & (found[i] != zero)


@njit(cache=True, nogil=True)
def seen_through(flat, line, at, width, limit):
    """True if a square around a pixel has measured pixels and all of them lie beyond `limit`.

    `flat` is the image as float32 [h * w], with rows of `line` pixels.
    """
    measured = False
    for v in range(at - width * line, at + width * line + 1, line):
        for p in range(v - width, v + width + 1):
            d = flat[p]
            if d > 0.0:
                measured = True
                if d <= limit:
                    return False
    return measured


@njit(cache=True, nogil=True)
def on_surface(flat, line, at, width, nearest, farthest):
    """True if a square around a pixel has a measured pixel between two depths."""
    for v in range(at - width * line, at + width * line + 1, line):
        for p in range(v - width, v + width + 1):
            if flat[p] > 0.0 and nearest <= flat[p] <= farthest:
                return True
    return False


@njit(cache=True, nogil=True, fastmath=FAST)
def test_obstacle(flat, line, depths, pixels, widths, tolerance, low, high, hit):
    """Test a mapped obstacle from `low` to `high` (m) at its points from `project_obstacles`:
    `depths`, `pixels`, `widths` [samples + 1].

    Returns (gone, low, high). gone: the view sees through most points and finds no surface at any
    (never for an obstacle that this frame hit). low, high: ends of the part not seen through. Of
    all pixels that a cell covers, one that does not see through keeps the point.
    """
    samples = HEIGHT_SAMPLES if high - low > np.float32(0.05) else 1
    first = 0 if samples > 1 else HEIGHT_SAMPLES
    through = 0
    lowest, highest = np.float32(np.inf), np.float32(-np.inf)
    for k in range(first, first + samples):
        limit = depths[k] + tolerance[0] + tolerance[1] * depths[k]
        if pixels[k] >= 0 and seen_through(flat, line, pixels[k], widths[k], limit):
            through += 1
            continue
        z = low + np.float32(k / (HEIGHT_SAMPLES - 1)) * (high - low)
        lowest, highest = min(lowest, z), max(highest, z)
    gone = not hit and 2 * through > samples
    if gone and through < samples:
        for k in range(first, first + samples):
            z = depths[k]
            tol = tolerance[0] + tolerance[1] * z
            if pixels[k] >= 0 and on_surface(flat, line, pixels[k], widths[k], z - tol, z + tol):
                gone = False
    if samples > 1 and through > 0 and lowest <= highest:
        # Points seen through at the ends lower the top or raise the bottom.
        low, high = lowest, highest
    return gone, low, high
