"""Numba kernels of the path planner; reached through `fm2` only."""

from __future__ import annotations

import numpy as np
from numba import njit

UNREACHED = np.float32(1e30)


@njit(cache=True, inline="always")
def _eikonal(t, c, width, slowness):
    """First-order upwind solution of |grad T| = slowness at flat cell c (Sethian)."""
    a = min(t[c - 1], t[c + 1])
    b = min(t[c - width], t[c + width])
    if a > b:
        a, b = b, a
    if b - a >= slowness:
        return a + slowness
    gap = b - a
    return np.float32(0.5) * (a + b + np.sqrt(np.float32(2) * slowness * slowness - gap * gap))


@njit(cache=True)
def march(speed, sources, arrival, frozen, following, cell_of, head, bucket_width):
    """Fast marching with a circular bucket queue (Yatziv, Bartesaghi and Sapiro 2006).

    speed: float32 [h, w], 0 blocks, border 0; sources: int64 [k] flat; arrival: float32 [h, w] out,
    UNREACHED where no way leads; frozen: uint8 [h, w] work; following, cell_of: int32 [5 h w] work;
    head: int32 [buckets]. The queue is lazy: a cell is queued again when its time falls.
    """
    width = speed.shape[1]
    f, t, z = speed.ravel(), arrival.ravel(), frozen.ravel()
    t[:] = UNREACHED
    z[:] = 0
    head[:] = -1
    buckets = head.shape[0]
    inverse = np.float32(1) / bucket_width
    free, top, waiting = np.int32(-1), 0, 0
    for s in sources:
        t[s] = 0
        cell_of[top], following[top] = s, head[0]
        head[0] = top
        top += 1
        waiting += 1
    bucket = 0
    while waiting > 0:
        node = head[bucket % buckets]
        if node < 0:
            bucket += 1
            continue
        head[bucket % buckets] = following[node]
        c = cell_of[node]
        following[node] = free
        free = node
        waiting -= 1
        if z[c] != 0:
            continue
        z[c] = 1
        for k in range(4):
            q = c + (1 if k == 0 else -1 if k == 1 else width if k == 2 else -width)
            if f[q] <= 0 or z[q] != 0:
                continue
            old = t[q]
            new = _eikonal(t, q, width, np.float32(1) / f[q])
            if new < old:
                t[q] = new
                place = max(int(new * inverse), bucket)
                if old < UNREACHED and int(old * inverse) == place:
                    continue  # it waits in that bucket already
                if free >= 0:
                    node = free
                    free = following[node]
                else:
                    node = top
                    top += 1
                cell_of[node] = q
                following[node] = head[place % buckets]
                head[place % buckets] = node
                waiting += 1


@njit(cache=True)
def descend(arrival, row, column, out):
    """Steepest descent over 8 neighbours into out int32 [n, 2]; the number of cells written.

    A diagonal step is taken only where both cells beside it were reached too, so that no corner
    is cut. Every cell but a source has a lower 4-neighbour, so the descent ends at a source.
    """
    n = 0
    while n < out.shape[0]:
        out[n, 0], out[n, 1] = row, column
        n += 1
        here = arrival[row, column]
        best, best_row, best_column = np.float32(0), -1, -1
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                there = arrival[row + dr, column + dc]
                if there >= here:
                    continue
                fall = here - there
                if dr != 0 and dc != 0:
                    if max(arrival[row + dr, column], arrival[row, column + dc]) >= UNREACHED:
                        continue
                    fall *= np.float32(0.70710678)
                if fall > best:
                    best, best_row, best_column = fall, row + dr, column + dc
        if best_row < 0:
            break
        row, column = best_row, best_column
    return n


@njit(cache=True)
def least_along(field, row0, column0, row1, column1):
    """Smallest value of field [h, w] on the segment between two points in cells (not rounded)."""
    length = np.hypot(row1 - row0, column1 - column0)
    steps = int(length * 2) + 1
    least = np.float32(1e30)
    for k in range(steps + 1):
        row = int(np.floor(row0 + (row1 - row0) * k / steps))
        column = int(np.floor(column0 + (column1 - column0) * k / steps))
        if row < 0 or column < 0 or row >= field.shape[0] or column >= field.shape[1]:
            return np.float32(-1e30)
        least = min(least, field[row, column])
    return least


@njit(cache=True)
def pull_straight(slack, exact, wide_enough, kept):
    """Indices of the route's points [n, 2] (cells, not rounded) that remain when each stretch is
    pulled straight that stays wide enough or no narrower than the route; into kept int64 [n]."""
    last = exact.shape[0] - 1
    kept[0] = 0
    count, here = 1, 0
    while here < last:
        there = last
        while there > here + 1:
            along = np.float32(1e30)
            for k in range(here, there + 1):
                along = min(along, slack[int(np.floor(exact[k, 0])), int(np.floor(exact[k, 1]))])
            straight = least_along(
                slack, exact[here, 0], exact[here, 1], exact[there, 0], exact[there, 1]
            )
            if straight >= min(wide_enough, max(along, np.float32(0))):
                break
            there = here + 1 + (there - here - 1) * 2 // 3
        kept[count] = there
        count += 1
        here = there
    return count


@njit(cache=True)
def hidden_along(top_m, row0, column0, z0, row1, column1, z1, near_cells, always_m):
    """Whether something on the line of sight stands above it, or above always_m.

    The last near_cells before the target belong to what is looked at.
    """
    length = np.hypot(row1 - row0, column1 - column0)
    steps = int(length) + 1
    for k in range(steps):
        share = k / steps
        if length * (1 - share) <= near_cells:
            return False
        row = int(np.floor(row0 + (row1 - row0) * share))
        column = int(np.floor(column0 + (column1 - column0) * share))
        if row < 0 or column < 0 or row >= top_m.shape[0] or column >= top_m.shape[1]:
            continue
        top = top_m[row, column]
        if top > z0 + (z1 - z0) * share + 0.03 or top > always_m:
            return True
    return False
