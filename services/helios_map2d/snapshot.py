"""Published versions of the map, and their NPZ form for people and programs."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.types import FrameId
from numpy.typing import NDArray

from helios_map2d.frontiers import Frontier
from helios_map2d.grid import GridSpec
from helios_map2d.sight import Sight, line_of_sight


@dataclass(frozen=True)
class MapSnapshot:
    """One immutable version of the map, cut to the box of what is known.

    Arrays are read-only, `[rows, columns]` of `grid` (see `GridSpec`): `occupancy` int8 (-1
    unknown, 0 free, 100 occupied), `explored` and `explored_for_search` uint8, `z_low_m` and
    `z_high_m` float32 (obstacle heights, 0 where not occupied), `values` and `confidences` float32
    by layer name. `whole_grid` is the grid that may become known. `robot_pose` is x, y (m), yaw
    (rad); `trajectory_m` float64 [n, 2]. Frontier cells are rows and columns of `whole_grid`.
    """

    version: int
    frame_id: FrameId | None
    stamp_ns: int
    context_id: str
    grid: GridSpec
    whole_grid: GridSpec
    occupancy: NDArray[np.int8]
    explored: NDArray[np.uint8]
    explored_for_search: NDArray[np.uint8]
    z_low_m: NDArray[np.float32]
    z_high_m: NDArray[np.float32]
    values: Mapping[str, NDArray[np.float32]]
    confidences: Mapping[str, NDArray[np.float32]]
    frontiers: tuple[Frontier, ...]
    robot_pose: tuple[float, float, float] | None
    trajectory_m: NDArray[np.float64]

    def line_of_sight(
        self, eye_m: tuple[float, float, float], point_m: tuple[float, float, float]
    ) -> Sight:
        """Can the point (world x, y, z) be seen from the eye? See `sight.line_of_sight`."""
        return line_of_sight(self.grid, self.occupancy, self.z_high_m, eye_m, point_m)

    @property
    def empty(self) -> bool:
        return self.frame_id is None


def frontier_json(frontier: Frontier) -> dict[str, object]:
    """A frontier without its cells, as plain JSON."""
    return {
        "id": frontier.id,
        "centre_m": list(frontier.centre_m),
        "size_m": frontier.size_m,
        "reachable": frontier.reachable,
        "values": dict(frontier.values),
    }


def encode_npz(snapshot: MapSnapshot) -> bytes:
    """The snapshot as a compressed NPZ: its arrays, and `meta`, a JSON text with everything else.

    Layers are `value_<name>` and `confidence_<name>`; frontier cells `frontier_cells` int32
    [n, 3] (index of the frontier, row, column of the whole grid).
    """
    cells = [np.column_stack([np.full(len(f.cells), k), f.cells])
             for k, f in enumerate(snapshot.frontiers)]  # fmt: skip
    frame_id = snapshot.frame_id
    meta = {
        "version": snapshot.version,
        "frame_id": None if frame_id is None else
        [frame_id.robot_boot_id, frame_id.world_epoch, frame_id.seq],
        "stamp_ns": snapshot.stamp_ns,
        "context_id": snapshot.context_id,
        "grid": _grid_json(snapshot.grid),
        "whole_grid": _grid_json(snapshot.whole_grid),
        "robot_pose": snapshot.robot_pose,
        "frontiers": [frontier_json(f) for f in snapshot.frontiers],
        "layers": list(snapshot.values),
        "frames": "world z up; row along y, column along x; origin_m is the lower-left corner",
        "occupancy": {"unknown": -1, "free": 0, "occupied": 100},
    }  # fmt: skip
    arrays: dict[str, NDArray] = {
        "meta": np.array(json.dumps(meta)),
        "occupancy": snapshot.occupancy,
        "explored": snapshot.explored,
        "explored_for_search": snapshot.explored_for_search,
        "z_low_m": snapshot.z_low_m,
        "z_high_m": snapshot.z_high_m,
        "trajectory_m": snapshot.trajectory_m,
        "frontier_cells": np.concatenate([np.empty((0, 3)), *cells]).astype(np.int32),
    }
    for k, name in enumerate(snapshot.values):
        arrays[f"value_{_key(name, k)}"] = snapshot.values[name]
        arrays[f"confidence_{_key(name, k)}"] = snapshot.confidences[name]
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


def decode_npz(data: bytes) -> MapSnapshot:
    """What `encode_npz` wrote. Raises InvalidInput for anything else."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        return _decoded(arrays, json.loads(str(arrays["meta"])))
    except InvalidInput:
        raise
    except Exception as error:
        raise InvalidInput(f"these {len(data)} bytes are no map snapshot (NPZ): {error}") from error


def _decoded(arrays: dict[str, NDArray], meta: dict) -> MapSnapshot:
    grid = _grid_of(meta["grid"])
    names = meta["layers"]
    layered = {name: (arrays[f"value_{_key(name, k)}"], arrays[f"confidence_{_key(name, k)}"])
               for k, name in enumerate(names)}  # fmt: skip
    plain = ("occupancy", "explored", "explored_for_search", "z_low_m", "z_high_m")
    over_grid = [arrays[name] for name in plain]
    for array in [*over_grid, *(a for pair in layered.values() for a in pair)]:
        if array.shape != grid.shape:
            raise InvalidInput(
                f"a map array is {array.shape}, its grid {grid.shape}: it is corrupt"
            )
    for array in arrays.values():
        array.flags.writeable = False
    cells = arrays["frontier_cells"]
    frontiers = tuple(
        Frontier(
            id=int(f["id"]),
            centre_m=(float(f["centre_m"][0]), float(f["centre_m"][1])),
            size_m=float(f["size_m"]),
            reachable=bool(f["reachable"]),
            values=f["values"],
            cells=cells[cells[:, 0] == k, 1:],
        )
        for k, f in enumerate(meta["frontiers"])
    )
    pose = meta["robot_pose"]
    return MapSnapshot(
        version=int(meta["version"]),
        frame_id=None if meta["frame_id"] is None else FrameId(*meta["frame_id"]),
        stamp_ns=int(meta["stamp_ns"]),
        context_id=meta["context_id"],
        grid=grid,
        whole_grid=_grid_of(meta["whole_grid"]),
        occupancy=over_grid[0],
        explored=over_grid[1],
        explored_for_search=over_grid[2],
        z_low_m=over_grid[3],
        z_high_m=over_grid[4],
        values=MappingProxyType({name: pair[0] for name, pair in layered.items()}),
        confidences=MappingProxyType({name: pair[1] for name, pair in layered.items()}),
        frontiers=frontiers,
        robot_pose=None if pose is None else (pose[0], pose[1], pose[2]),
        trajectory_m=arrays["trajectory_m"],
    )


def _key(name: str, index: int) -> str:
    """A layer's name as part of a member name of the zip: by number where it is no plain word."""
    return name if name.isidentifier() else str(index)


def _grid_json(grid: GridSpec) -> dict[str, object]:
    return {"cell_m": grid.cell_m, "rows": grid.rows, "columns": grid.columns,
            "origin_m": list(grid.origin_m)}  # fmt: skip


def _grid_of(raw: dict) -> GridSpec:
    x_m, y_m = raw["origin_m"]
    return GridSpec(float(raw["cell_m"]), int(raw["rows"]), int(raw["columns"]), (x_m, y_m))
