"""Decoding of the 2D map message (`MapSnapshot`) into arrays.

Every array is `[rows, columns]`: rows along world y, columns along world x, cell [0, 0] at
`origin_m`. In the message each is zlib-compressed, in row order, little-endian.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.types import FrameId

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
MAX_CELLS = 64_000_000  # a larger map is refused before it is unpacked


@dataclass(frozen=True)
class MapView:
    """One version of the map, over the box of known cells. Arrays are read-only."""

    version: int
    frame_id: FrameId
    context_id: str
    cell_m: float
    origin_m: tuple[float, float]  # world x, y of the corner of cell [0, 0]
    occupancy: NDArray[np.int8]  # [rows, columns] UNKNOWN, FREE or OCCUPIED
    explored: NDArray[np.bool_]  # [rows, columns] seen since the search began
    top_m: NDArray[np.float32]  # [rows, columns] highest obstacle, 0 without one
    values: Mapping[str, NDArray[np.float32]]  # layer -> [rows, columns]
    frontiers: tuple[pb.Frontier, ...]
    robot_pose: tuple[float, float, float]  # x (m), y (m), yaw (rad) in the world
    trajectory_m: NDArray[np.float32]  # [n, 2]
    explored_m2: float
    occupied_m2: float
    trajectory_starts: tuple[int, ...] = ()  # indices of points that begin a separate piece
    map_id: str = ""  # a different id: a new map has begun

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)"""
        rows, columns = self.occupancy.shape
        return rows, columns


def decode_snapshot(snapshot: pb.MapSnapshot) -> MapView:
    """MapView of a message.

    Only `explored` and `top_m` may be missing; they are then False and 0. Raises InvalidInput if
    another array is missing, or one is corrupt or has the wrong size.
    """
    shape = (snapshot.height, snapshot.width)
    good = math.isfinite(snapshot.cell_m) and snapshot.cell_m > 0
    if shape[0] * shape[1] > MAX_CELLS or (not good and shape[0] * shape[1] > 0):
        raise InvalidInput(
            f"the map is {shape[1]}x{shape[0]} cells of {snapshot.cell_m} m; wanted cells above "
            f"0 m and at most {MAX_CELLS // 10**6} million of them"
        )
    if shape[0] * shape[1] and not snapshot.occupancy:
        raise InvalidInput(
            f"the map is {shape[1]}x{shape[0]} cells without occupancy; send it: without, no cell "
            "is known to be free"
        )
    if len(snapshot.trajectory_m) % 2:
        raise InvalidInput(f"the trajectory has {len(snapshot.trajectory_m)} numbers; send x, y …")
    robot = snapshot.robot
    occupancy = inflated(snapshot.occupancy, "<i1", shape, "occupancy of the map")
    return MapView(
        version=snapshot.version,
        frame_id=FrameId(snapshot.id.robot_boot_id, snapshot.id.world_epoch, snapshot.id.seq),
        context_id=snapshot.context_id,
        cell_m=snapshot.cell_m,
        origin_m=(snapshot.origin_x_m, snapshot.origin_y_m),
        occupancy=occupancy.astype(np.int8),
        explored=_optional(snapshot.explored, "<u1", shape, "explored") > 0,
        top_m=_optional(snapshot.top_mm, "<u2", shape, "top_mm").astype(np.float32)
        * np.float32(0.001),
        values={
            name: inflated(data, "<f2", shape, f"value layer {name} of the map").astype(np.float32)
            for name, data in snapshot.values.items()
        },
        frontiers=tuple(snapshot.frontiers),
        robot_pose=(robot.x_m, robot.y_m, robot.yaw_rad),
        trajectory_m=np.array(snapshot.trajectory_m, np.float32).reshape(-1, 2),
        explored_m2=snapshot.explored_m2,
        occupied_m2=snapshot.occupied_m2,
        trajectory_starts=tuple(snapshot.trajectory_starts),
        map_id=snapshot.map_id,
    )


def _optional(data: bytes, dtype: str, shape: tuple[int, int], what: str) -> NDArray:
    """Array of the map; zeros if the message has none."""
    return inflated(data, dtype, shape, f"{what} of the map") if data else np.zeros(shape, dtype)


def inflated(data: bytes, dtype: str, shape: tuple[int, int], what: str) -> NDArray:
    """Read-only array of `shape` from zlib-compressed data in row order.

    Never unpacks more than the shape needs. Raises InvalidInput, which names the array `what`, for
    any other data.
    """
    wanted = shape[0] * shape[1] * np.dtype(dtype).itemsize
    try:
        raw = zlib.decompressobj().decompress(data, wanted + 1)
    except zlib.error as error:
        raise InvalidInput(f"{what} is corrupt: {error}; send it whole, packed by zlib") from error
    if len(raw) != wanted:
        came = f"more than {wanted}" if len(raw) > wanted else str(len(raw))
        raise InvalidInput(
            f"{what} is no {shape[1]}x{shape[0]} array: {came} bytes unpacked, {wanted} wanted; "
            f"send all rows, {np.dtype(dtype).itemsize} bytes a cell"
        )
    return np.frombuffer(raw, dtype).reshape(shape)
