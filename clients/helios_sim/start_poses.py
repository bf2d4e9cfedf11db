"""Random start poses of the robot in a home."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from helios_sim.episode_tracker import navigable_area_of
from helios_sim.home import Home

ROOM_M = 0.35  # radius of the free disc around a start pose

_STREAM = 0x57A27


def with_random_start(home: Home, seed: int) -> Home:
    """The home with another start pose: uniform over the floor that its own start can reach.

    The same home and seed give the same pose.
    """
    area = navigable_area_of(home, ROOM_M)
    rows, columns = np.nonzero(area.free)
    if not len(rows):
        return home
    rng = np.random.default_rng([home.seed, seed, _STREAM])
    at = int(rng.integers(len(rows)))
    x_m = area.origin_m[0] + (columns[at] + 0.5) * area.cell_m
    y_m = area.origin_m[1] + (rows[at] + 0.5) * area.cell_m
    yaw_rad = rng.uniform(-math.pi, math.pi)
    return replace(home, start_pose=(float(x_m), float(y_m), float(yaw_rad)))
