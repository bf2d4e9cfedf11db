"""Benchmark of FM² arrival times against scikit-fmm (first order) on the same speed field."""

from __future__ import annotations

import cv2
import numpy as np
import skfmm
from helios_planner.motion_planning.path_planner import SLOWEST, arrival_time, speed_field
from numpy.typing import NDArray

from helios_eval.bench.timing import Row, compare

CELLS, CELL_M = 2000, 0.025
RADIUS_M, SATURATION_M = 0.3, 0.6  # radius of the robot; clearance beyond it for full speed
ROOM_M, WALL_M, DOOR_M, AISLE_M = 4.1, 0.15, 1.0, 0.65
HOMES = ((4, 4), (12, 12))  # rows, columns of rooms: a flat mid-map; a building that fills the map


def building(rooms: tuple[int, int], seed: int = 0) -> NDArray[np.bool_]:
    """Obstacles [CELLS, CELLS] of a building with these rows and columns of rooms, mid-map.

    Each room has a door to every neighbour and four pieces of furniture.
    """
    rng = np.random.default_rng(seed)
    n, wall, door = (round(length / CELL_M) for length in (ROOM_M, WALL_M, DOOR_M))
    aisle = round(AISLE_M / CELL_M)
    low = [(CELLS - count * n) // 2 for count in rooms]
    blocked = np.ones((CELLS, CELLS), bool)
    for i in range(rooms[0]):
        for j in range(rooms[1]):
            room = blocked[low[0] + i * n :, low[1] + j * n :][:n, :n]
            room[wall:, wall:] = False
            at = rng.integers(wall + door // 2, n - 2 * door, 2)
            if i:
                room[:wall, at[0] : at[0] + door] = False
            if j:
                room[at[1] : at[1] + door, :wall] = False
            inner = room[wall + aisle : -aisle, wall + aisle : -aisle]
            for size in rng.integers(round(0.2 / CELL_M), round(1.2 / CELL_M), (4, 2)):
                row, column = rng.integers(0, np.array(inner.shape) - size)
                inner[row : row + size[0], column : column + size[1]] = True
    return blocked


def plan_fm2() -> list[Row]:
    """One row per home."""
    return [_row(rooms) for rooms in HOMES]


def _row(rooms: tuple[int, int]) -> Row:
    blocked = building(rooms)
    clearance = cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, 5) * CELL_M
    speed = speed_field(clearance.astype(np.float32), RADIUS_M, RADIUS_M, SATURATION_M)
    goal = np.argwhere(speed == speed.max())[:1]
    speed[~np.isfinite(arrival_time(speed, goal))] = 0  # unreachable corners behind furniture
    phi = np.ones(speed.shape)
    phi[tuple(goal[0])] = -1
    phi = np.ma.MaskedArray(phi, speed == 0)
    speeds = np.maximum(speed, SLOWEST)
    return compare(
        "plan_fm2",
        f"{CELLS}x{CELLS} cells, {np.count_nonzero(speed)} reachable",
        lambda _: arrival_time(speed, goal),
        "scikit-fmm",
        lambda _: skfmm.travel_time(phi, speeds, order=1),
        9,
    )
