"""Arrival times and a path by FM², against scikit-fmm on the same speed field."""

from __future__ import annotations

import cv2
import numpy as np
import skfmm
from helios_planner.fm2 import arrival_time, speed_field
from numpy.typing import NDArray

from helios_eval.bench.scene import boxes
from helios_eval.bench.timing import Row, compare

CELL_M = 0.025


def flat(cells: int) -> NDArray[np.bool_]:
    """Obstacles of the flat in the middle of a map, walls all around."""
    blocked = np.zeros((cells, cells), bool)
    for x0, y0, _, x1, y1, _ in boxes():
        a = (np.array([x0, y0]) / CELL_M + cells / 2).astype(int)
        b = (np.array([x1, y1]) / CELL_M + cells / 2).astype(int) + 1
        blocked[max(a[1], 0) : b[1], max(a[0], 0) : b[0]] = True
    return blocked


def plan_fm2(cells: int = 480) -> Row:
    blocked = flat(cells)
    distance = cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, 5) * CELL_M
    speed = speed_field(distance.astype(np.float32), 0.35, 0.30, 0.5)
    goal = np.argwhere(speed == speed.max())[:1]
    phi = np.ones((cells, cells))
    phi[tuple(goal[0])] = -1
    field = np.ma.MaskedArray(phi, speed == 0)
    reachable = int(np.isfinite(arrival_time(speed, goal)).sum())
    return compare(
        "plan_fm2", f"{cells}x{cells} cells, {reachable} reachable",
        lambda _: arrival_time(speed, goal), "scikit-fmm",
        lambda _: skfmm.travel_time(field, np.maximum(speed, 0.05)), 7,
    )  # fmt: skip
