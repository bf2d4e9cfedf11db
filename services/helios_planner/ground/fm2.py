"""Fast Marching Square: paths that keep away from obstacles (Garrido et al. 2007; appendix 6.1).

Velocity rises with the distance to the nearest obstacle and saturates; the arrival time of a front
with that velocity has no local minimum but its source, so descending it gives the path.
"""

from __future__ import annotations

import numpy as np
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_planner.ground import kernels

BUCKET_WIDTH = 0.1  # of the time to cross a cell at full speed
SLOWEST = 0.05  # least speed of an open cell; bounds the width of the front


def speed_field(
    clearance_m: NDArray[np.float32], required_m: float, contact_m: float, saturation_m: float
) -> NDArray[np.float32]:
    """Speed [h, w] in 0 to 1: 0 where clearance is below `required_m`, else in proportion to the
    distance left beyond `contact_m`, full from `saturation_m` beyond it. The border is closed."""
    speed = np.clip((clearance_m - contact_m) / saturation_m, 0.1, 1.0).astype(np.float32)
    speed[clearance_m < required_m] = 0
    speed[[0, -1]] = 0
    speed[:, [0, -1]] = 0
    return speed


def arrival_time(speed: NDArray[np.float32], sources: NDArray[np.integer]) -> NDArray[np.float32]:
    """Arrival time [h, w] of a front from the source cells [k, 2] (row, column), in cells at full
    speed; inf where no way leads. speed: float32 [h, w], 0 (closed) to 1; an open cell is never
    slower than SLOWEST. Raises InvalidInput for an open border or a source on it or beyond it."""
    field = np.ascontiguousarray(speed, np.float32)
    rows, columns = field.shape
    if field[[0, -1]].any() or field[:, [0, -1]].any():
        raise InvalidInput("the speed field is open at its border; close it, a front ends there")
    if ((sources < 1) | (sources > (rows - 2, columns - 2))).any():
        raise InvalidInput(f"a source lies on the border of the {rows}x{columns} field or beyond")
    flat = np.ravel_multi_index((sources[:, 0], sources[:, 1]), field.shape).astype(np.int64)
    arrival = np.empty(field.shape, np.float32)
    span = int(1 / (SLOWEST * BUCKET_WIDTH)) + 2
    head = np.empty(1 << span.bit_length(), np.int32)
    nodes = field.size + len(flat)
    while not kernels.march(
        field, flat, arrival, np.empty(nodes, np.int32), np.empty(nodes, np.int32), head,
        np.float32(BUCKET_WIDTH), np.float32(SLOWEST),
    ):  # fmt: skip
        nodes *= 2
    return arrival


def descend(arrival: NDArray[np.float32], start: tuple[int, int]) -> NDArray[np.int32]:
    """Cells [n, 2] from `start` down to a source, at most 3 apart along an axis, with only reached
    cells between them; empty when `start` was not reached."""
    if not np.isfinite(arrival[start]):
        return np.empty((0, 2), np.int32)
    out = np.empty((arrival.size, 2), np.int32)
    n = kernels.descend(arrival, start[0], start[1], out)
    return out[:n].copy()
