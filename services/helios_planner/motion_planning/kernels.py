"""Numba kernels of the path planners and of base placement. The tests hold readable equivalents."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

UNREACHED = np.float32(np.inf)
# Steps of a descent: every direction of a step of at most 3 cells along an axis.
DESCENT_STEPS = np.array(
    [(r, c) for r in range(-3, 4) for c in range(-3, 4) if math.gcd(r, c) == 1], np.int64
)
SWEEP_RAD = math.radians(4)  # largest turn between two headings that are checked


@njit(cache=True)
def march(speed, sources, arrival, following, cell_of, head, bucket_width, slowest):
    """First-order upwind solution of |grad T| = 1 / speed (Sethian 1996), with a circular bucket
    queue (Yatziv, Bartesaghi and Sapiro 2006). Each bucket is processed until no time in it falls.

    speed: float32 [h, w], 0 blocks, border 0; sources: int64 [k] flat; arrival: float32 [h, w]
    output, UNREACHED without a path; following, cell_of: int32 [n] buffers; head: int32 [a power of
    two] that spans the greatest slowness. Returns False if n nodes are too few for the queue.

    The order within a bucket does not matter: a cell whose time falls is queued again, so the
    result equals that of an exact heap up to rounding. Outdated entries are skipped.
    """
    one, width = np.uint32(1), np.uint32(speed.shape[1])  # unsigned: no test for negative indices
    f, t = speed.ravel(), arrival.ravel()
    t[:] = UNREACHED
    head[:] = -1
    mask = head.shape[0] - 1
    inverse = np.float32(1) / bucket_width
    free, top, waiting = np.int32(-1), np.int32(0), 0
    for s in sources:
        t[s] = 0
        cell_of[top], following[top] = s, head[0]
        head[0] = top
        top += np.int32(1)
        waiting += 1
    bucket = np.int32(0)
    while waiting > 0:
        node = head[bucket & mask]
        if node < 0:
            bucket += np.int32(1)
            continue
        c = np.uint32(cell_of[np.uint32(node)])
        head[bucket & mask] = following[np.uint32(node)]
        following[np.uint32(node)] = free
        free = node
        waiting -= 1
        here = t[c]
        if np.int32(here * inverse) < bucket:
            continue  # processed in an earlier bucket
        for k in range(4):
            if k < 2:
                q, beyond = (c + one, c + one + one) if k == 0 else (c - one, c - one - one)
                left, right = q - width, q + width
            else:
                q, beyond = (
                    (c + width, c + width + width) if k == 2 else (c - width, c - width - width)
                )
                left, right = q - one, q + one
            old = t[q]
            if old <= here or f[q] <= 0:
                continue
            slowness = np.float32(1) / max(f[q], slowest)
            a = min(here, t[beyond])
            b = min(t[left], t[right])
            gap = abs(a - b)
            if gap >= slowness:
                new = min(a, b) + slowness
            else:
                root = np.sqrt(np.float32(2) * slowness * slowness - gap * gap)
                new = np.float32(0.5) * (a + b + root)
            if new >= old:
                continue
            t[q] = new
            place = max(np.int32(new * inverse), bucket)
            if old < UNREACHED and place != bucket and np.int32(old * inverse) == place:
                continue  # already queued in that bucket
            if free >= 0:
                node = free
                free = following[np.uint32(node)]
            else:
                if top >= following.shape[0]:
                    return False
                node = top
                top += np.int32(1)
            cell_of[np.uint32(node)] = q
            following[np.uint32(node)] = head[place & mask]
            head[place & mask] = node
            waiting += 1
    return True


@njit(cache=True)
def clear_labels(labels, chosen, mask):
    """Set mask [h, w] to 0 where the label [h, w] is chosen [labels]."""
    for r in range(labels.shape[0]):
        for c in range(labels.shape[1]):
            if chosen[labels[r, c]]:
                mask[r, c] = 0


@njit(cache=True)
def _open_between(arrival, row, column, down, right):
    """True if the step touches only reached cells: it crosses no wall and cuts no corner."""
    rows, columns = abs(down), abs(right)
    i = j = 0
    while i < rows or j < columns:
        to_row, to_column = (2 * i + 1) * columns, (2 * j + 1) * rows
        if to_row == to_column:  # through the point where four cells meet
            beside = arrival[row + (i + 1) * np.sign(down), column + j * np.sign(right)]
            above = arrival[row + i * np.sign(down), column + (j + 1) * np.sign(right)]
            if max(beside, above) >= UNREACHED:
                return False
        i += to_row <= to_column
        j += to_column <= to_row
        if arrival[row + i * np.sign(down), column + j * np.sign(right)] >= UNREACHED:
            return False
    return True


@njit(cache=True)
def _slowness(arrival, row, column):
    """1 / speed of a reached cell, from the equation that `march` solves; 0 at a source."""
    here = arrival[row, column]
    across = here - min(arrival[row, column - 1], arrival[row, column + 1])
    along = here - min(arrival[row - 1, column], arrival[row + 1, column])
    return math.hypot(max(across, 0.0), max(along, 0.0))


@njit(cache=True)
def descend(arrival, row, column, out):
    """Steepest descent by steps in 32 directions into out int32 [n, 2]; returns the number of
    cells.

    Each step is the one whose fall comes nearest to its travel time (no step is faster than the
    front was). Every cell but a source has a lower 4-neighbour, so the descent ends at a source.
    """
    n = 0
    while n < out.shape[0]:
        out[n, 0], out[n, 1] = row, column
        n += 1
        here, slow = arrival[row, column], _slowness(arrival, row, column)
        best, best_row, best_column = 0.0, -1, -1
        for k in range(DESCENT_STEPS.shape[0]):
            down, right = DESCENT_STEPS[k]
            r, c = row + down, column + right
            if r < 0 or c < 0 or r >= arrival.shape[0] or c >= arrival.shape[1]:
                continue
            fall = here - arrival[r, c]
            if not fall > 0 or not _open_between(arrival, row, column, down, right):
                continue
            pieces = max(abs(down), abs(right))
            total = 0.5 * (slow + _slowness(arrival, r, c))
            for k in range(1, pieces):
                total += _slowness(
                    arrival,
                    math.floor(row + down * k / pieces + 0.5),
                    math.floor(column + right * k / pieces + 0.5),
                )
            took = total / pieces * math.hypot(down, right)
            if fall / took > best:
                best, best_row, best_column = fall / took, r, c
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
    """Pull each stretch of a route straight that stays wide enough or no narrower than the route.
    Writes the indices of the remaining points of the route [n, 2] (cells, not rounded) to kept
    int64 [n]; returns their number."""
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
    """True if an obstacle on the line of sight rises above it, or above always_m.

    The last near_cells before the target belong to the target.
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


@njit(cache=True)
def capsule_slack(clearance, row, column, yaw, half, ahead, radius):
    """Least clearance of a capsule, minus its radius, along a straight move. All in cells except
    clearance and radius (m): `half` from its middle to either end's centre, `ahead` the move."""
    dr, dc = math.sin(yaw), math.cos(yaw)
    front = half + ahead
    return (
        least_along(
            clearance, row - half * dr, column - half * dc, row + front * dr, column + front * dc
        )
        - radius
    )


@njit(cache=True)
def turn_slack(clearance, row, column, yaw, angle, half, radius):
    """Least slack of a capsule during a turn on the spot by `angle`."""
    steps = int(math.ceil(abs(angle) / SWEEP_RAD))  # noqa: RUF046
    least = np.float32(1e30)
    for k in range(1, steps + 1):
        heading = yaw + angle * k / steps
        least = min(least, capsule_slack(clearance, row, column, heading, half, 0.0, radius))
    return least


@njit(cache=True)
def march_poses(
    clearance, start, steps, headings, seeds, seed_turns, half, radius, needed, here, leave,
    saturation, turn_cost, spacing, cell_m, times, came, following, state_of, head,
):  # fmt: skip
    """Dijkstra over a lattice of poses by moves ahead and turns to the next heading; every
    intermediate pose is checked. Bucket queue as in `kernels.march`, buckets one cell wide.

    start: [4] exact row and column of the first node, node of the robot; steps: [k, 2] in nodes,
    headings: [k] their headings; seeds: headings that the robot can turn to at the start,
    seed_turns: their angles (rad); times: float32 [k, rows, columns] output, cells at full speed;
    came: int8, same shape, output: 0 a move ahead, 1 a turn left, -1 a turn right, 2 the start.
    `needed`: slack in m, as little as `here` at the start, back to needed `leave` cells away.
    Returns False if the queue is too short.
    """
    count, rows, columns = times.shape
    t, origin = times.ravel(), came.ravel()
    t[:] = UNREACHED
    head[:] = -1
    mask = head.shape[0] - 1
    free, top, waiting = -1, 0, 0
    row0, column0 = int(start[2]), int(start[3])
    for n in range(seeds.shape[0]):
        state = (seeds[n] * rows + row0) * columns + column0
        t[state] = turn_cost * abs(seed_turns[n])
        origin[state] = 2
        slot = int(t[state]) & mask
        state_of[top], following[top] = state, head[slot]
        head[slot] = top
        top += 1
        waiting += 1
    bucket = 0
    while waiting > 0:
        node = head[bucket & mask]
        if node < 0:
            bucket += 1
            continue
        head[bucket & mask] = following[node]
        state = state_of[node]
        following[node] = free
        free = node
        waiting -= 1
        now = t[state]
        if int(now) < bucket:
            continue
        k, at = state // (rows * columns), state % (rows * columns)
        i, j = at // columns, at % columns
        row, column = start[0] + spacing * i, start[1] + spacing * j
        middle = clearance[int(row), int(column)]
        for kind in range(-1, 2):
            angle = 0.0
            if kind == 0:
                m, p, q = k, i + steps[k, 0], j + steps[k, 1]
                if p < 0 or q < 0 or p >= rows or q >= columns:
                    continue
                length = spacing * math.hypot(steps[k, 0], steps[k, 1])
                slack = capsule_slack(clearance, row, column, headings[k], half, length, radius)
                cost = length / min(max(slack / saturation, 0.1), 1.0)
            else:
                m, p, q = (k + kind) % count, i, j
                angle = headings[m] - headings[k]
                angle -= 2 * math.pi * math.floor(angle / (2 * math.pi) + 0.5)
                cost = turn_cost * abs(angle)
                slack = needed
            goal = (m * rows + p) * columns + q
            if now + cost >= t[goal]:
                continue
            if kind != 0 and middle - radius < needed + half * cell_m:
                slack = turn_slack(clearance, row, column, headings[k], angle, half, radius)
            away = spacing * math.hypot(p - row0, q - column0)
            least = needed
            if here < needed and away < leave:
                least = here + (needed - here) * away / leave
            if slack < least:
                continue
            old = t[goal]
            t[goal] = now + cost
            origin[goal] = kind
            if old < UNREACHED and int(old) == int(t[goal]) and int(old) != bucket:
                continue
            if free >= 0:
                node = free
                free = following[node]
            else:
                if top >= following.shape[0]:
                    return False
                node = top
                top += 1
            slot = int(t[goal]) & mask
            state_of[node], following[node] = goal, head[slot]
            head[slot] = node
            waiting += 1
    return True
