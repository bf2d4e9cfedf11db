"""Numba kernels over poses (x, y, heading) of a robot that is no disc; reached through `poses`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from helios_planner.ground.kernels import UNREACHED, least_along

SWEEP_RAD = math.radians(4)  # headings between two that are checked in a turn


@njit(cache=True)
def capsule_slack(clearance, row, column, yaw, half, ahead, radius):
    """Least clearance of a capsule, less its radius, along a straight move. All in cells but
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
    """Least slack while it turns on the spot by `angle`."""
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
    """Dijkstra over a lattice of poses by moves ahead and turns to the next heading, every
    intermediate pose checked; bucket queue as in `kernels.march`, buckets one cell wide.

    start: [4] exact row and column of the first node, node of the robot; steps: [k, 2] in nodes,
    headings [k] of them; seeds: headings that can be turned to at the start, seed_turns their
    angles (rad); times: float32 [k, rows, columns] out, cells at full speed; came: int8 likewise:
    0 a move ahead, 1 a turn left, -1 a turn right, 2 the start. `needed` slack in m; as little as
    `here` at the start, back to needed `leave` cells away. False when the queue was too short.
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
