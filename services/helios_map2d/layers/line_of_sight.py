"""Line of sight between two points, over the heights of obstacles."""

from __future__ import annotations

import numpy as np
from helios_core.codec.frames import FARTHEST_M
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_map2d.grid import GridSpec
from helios_map2d.kernels import frontier_cells as frontier_kernels


def line_of_sight(
    grid: GridSpec,
    occupancy: NDArray[np.int8],
    z_low_m: NDArray[np.float32],
    z_high_m: NDArray[np.float32],
    eye_m: tuple[float, float, float],
    point_m: tuple[float, float, float],
    target_radius_m: float = 0.15,
    margin_m: float = 0.03,
    ground_m: float = 0.30,
) -> bool:
    """True if `point_m` is visible from `eye_m` (world x, y, z), over all obstacles between.

    A known obstacle blocks the straight line if its top rises more than `margin_m` above the line
    and its bottom does not begin more than `margin_m` above it: the line may pass over a chair and
    under a table. An obstacle that begins below `ground_m` counts as standing on the floor. Unknown
    ground does not block. Obstacles within `target_radius_m` of the point belong to the target.
    Raises InvalidInput if a coordinate is not finite or exceeds FARTHEST_M.
    """
    if not (np.abs([*eye_m, *point_m]) <= FARTHEST_M).all():
        raise InvalidInput(
            f"cannot look from {eye_m} to {point_m}: send finite metres within {FARTHEST_M:g}"
        )
    x0, y0 = grid.origin_m
    ends = [
        np.array([(y - y0) / grid.cell_m, (x - x0) / grid.cell_m, z])
        for x, y, z in (eye_m, point_m)
    ]
    row, _ = frontier_kernels.first_block(
        z_low_m,
        z_high_m,
        occupancy,
        ends[0],
        ends[1],
        target_radius_m / grid.cell_m,
        margin_m,
        ground_m,
    )
    return row < 0
