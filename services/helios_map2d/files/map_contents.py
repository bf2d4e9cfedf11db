"""Content of a map from any file format, and its validation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from helios_core.codec.frames import FARTHEST_M
from helios_core.codec.search import MOST_CHARACTERS
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN
from helios_core.types import FrameId
from numpy.typing import NDArray

from helios_map2d.grid import TILE, Tile
from helios_map2d.snapshots.tiles import GroundTile, ValueTile

SAME_CELL_M = 1e-6
HIGHEST_NUMBER = 2**53  # limit of a frontier's id


@dataclass(frozen=True)
class MapContent:
    """Content of a map file. `frontiers`: id -> world cells [n, 2]."""

    frame_id: FrameId | None
    stamp_ns: int
    context_id: str
    ground: dict[Tile, GroundTile]
    values: dict[str, dict[Tile, ValueTile]]
    robot_pose: tuple[float, float, float] | None
    trajectory_m: NDArray[np.float64]
    trajectory_starts: tuple[int, ...]
    frontiers: dict[int, NDArray[np.int32]]
    next_frontier_id: int


def check_cell(theirs_m: float, ours_m: float) -> None:
    """Raise InvalidInput unless a map's cell size equals this service's."""
    if not (math.isfinite(theirs_m) and theirs_m > 0):
        raise InvalidInput(
            f"the map says that its cells are {theirs_m} m wide, wanted more than 0: it is "
            "damaged; save it again"
        )
    if abs(theirs_m - ours_m) > SAME_CELL_M:
        raise InvalidInput(
            f"the map has cells of {theirs_m} m, this service {ours_m} m: start it with "
            f"HELIOS_MAP2D_CELL_M={theirs_m}"
        )


def check_content(content: MapContent, cell_m: float) -> None:
    """Raise InvalidInput for values that are not finite, places beyond FARTHEST_M, and undefined
    states of cells."""
    pose = content.robot_pose or ()
    poses = np.array([*pose, *content.trajectory_m.ravel()])
    if not np.isfinite(poses).all():
        raise InvalidInput("the map's poses are not finite: it is damaged; save it again")
    most = FARTHEST_M / cell_m
    tiles = [*content.ground, *(tile for part in content.values.values() for tile in part)]
    cells = content.frontiers.values()
    if (
        np.abs(poses).max(initial=0.0) > FARTHEST_M
        or any(abs(row) * TILE > most or abs(column) * TILE > most for row, column in tiles)
        or any(np.abs(part.astype(np.int64)).max(initial=0) > most for part in cells)
    ):
        raise InvalidInput(
            f"the map lies more than {FARTHEST_M:g} m from the world's origin: move it there, for "
            "a ROS map by its YAML's origin"
        )
    for tile in content.ground.values():
        _check_ground(tile)
    for name, part in content.values.items():
        if len(name) > MOST_CHARACTERS:
            raise InvalidInput(
                f"a value layer of the map has a name of {len(name)} characters, wanted at most "
                f"{MOST_CHARACTERS}: save it again"
            )
        if not all(_is_value(tile) for tile in part.values()):
            raise InvalidInput(
                f"value layer {name[:80]!r} of the map holds values that are not finite, or "
                "confidences below 0: it is damaged; save it again"
            )
    numbers = (*content.frontiers, content.next_frontier_id)
    if not all(0 <= number < HIGHEST_NUMBER for number in numbers) or any(
        part.shape[1:] != (2,) for part in cells
    ):
        raise InvalidInput("the map's frontiers are damaged: save it again")


def _check_ground(tile: GroundTile) -> None:
    state = tile.occupancy
    there = state == OCCUPIED
    if not ((state == UNKNOWN) | (state == FREE) | there).all():
        raise InvalidInput(
            f"tile {tile.place} of the map has cells that are neither {UNKNOWN} (unknown), {FREE} "
            f"(free) nor {OCCUPIED} (occupied): it is damaged; save it again"
        )
    if not np.isfinite([tile.z_low_m[there], tile.z_high_m[there]]).all():
        raise InvalidInput(
            f"tile {tile.place} of the map has obstacles whose height is not finite: it is "
            "damaged; save it again"
        )
    if tile.searched.max(initial=0) > 1 or tile.floor_seen.max(initial=0) > 1:
        raise InvalidInput(
            f"tile {tile.place} of the map says neither 0 nor 1 of what was seen: it is damaged; "
            "save it again"
        )


def _is_value(tile: ValueTile) -> bool:
    sure = tile.confidence
    return bool(np.isfinite(tile.value).all() and np.isfinite(sure).all() and (sure >= 0).all())
