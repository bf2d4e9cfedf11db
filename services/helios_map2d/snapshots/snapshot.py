"""Published versions of the map, and their NPZ format."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from helios_core import proto as pb
from helios_core.codec import frame_id_from_proto
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN
from helios_core.npz_reading import unpacked
from helios_core.types import FrameId
from numpy.typing import NDArray

from helios_map2d.grid import GridSpec
from helios_map2d.layers.frontiers import Frontier
from helios_map2d.layers.line_of_sight import line_of_sight
from helios_map2d.snapshots.tiles import (
    Ground,
    GroundTile,
    Values,
    ValueTile,
    assembled,
    cut_up,
    occupancy_of,
)

EVIDENCE = 4  # evidence of an obstacle from a file without evidence


@dataclass(frozen=True, eq=False)
class MapSnapshot:
    """One immutable version of the map.

    `grid` covers the known cells (see `GridSpec`). Arrays over it are `[rows, columns]`, read-only,
    and assembled from the tiles at the first access. `map_id` identifies the map of one world
    epoch. `robot_pose` is x, y (m), yaw (rad); `trajectory_m` float64 [n, 2].
    """

    map_id: str
    version: int
    frame_id: FrameId | None
    stamp_ns: int
    context_id: str
    grid: GridSpec
    ground: Ground
    layers: Mapping[str, Values]
    frontiers: tuple[Frontier, ...]
    robot_pose: tuple[float, float, float] | None
    trajectory_m: NDArray[np.float64]
    next_frontier_id: int = 1
    trajectory_starts: tuple[int, ...] = ()  # indices of points that begin a separate piece

    @cached_property
    def occupancy(self) -> NDArray[np.int8]:
        """Occupancy: -1 unknown, 0 free, 100 occupied."""
        return occupancy_of(self.ground, self.grid)

    @property
    def known(self) -> NDArray[np.uint8]:
        """Array with 1 in known cells, in all searches.

        Files call it `explored`. Messages call its area `explored_m2`, but their `explored` is
        `explored_for_search`.
        """
        return (self.occupancy != UNKNOWN).astype(np.uint8)

    @cached_property
    def explored_for_search(self) -> NDArray[np.uint8]:
        """Array with 1 in cells that the current search has seen."""
        parts = [(t, g.searched) for t, g in self.ground.items()]
        return assembled(parts, self.grid).astype(np.uint8, copy=False)

    @cached_property
    def z_low_m(self) -> NDArray[np.float32]:
        """Height of the lowest obstacle, 0 where not occupied."""
        parts = [
            (t, np.where(g.occupancy == OCCUPIED, g.z_low_m, np.float32(0)))
            for t, g in self.ground.items()
        ]
        return assembled(parts, self.grid)

    @cached_property
    def z_high_m(self) -> NDArray[np.float32]:
        """Height of the highest obstacle, 0 where not occupied."""
        parts = [
            (t, np.where(g.occupancy == OCCUPIED, g.z_high_m, np.float32(0)))
            for t, g in self.ground.items()
        ]
        return assembled(parts, self.grid)

    @cached_property
    def top_mm(self) -> NDArray[np.uint16]:
        """Height of the highest obstacle in millimetres, 0 where not occupied."""
        parts = [(t, g.top_mm) for t, g in self.ground.items()]
        return assembled(parts, self.grid).astype(np.uint16, copy=False)

    @cached_property
    def values(self) -> Mapping[str, NDArray[np.float32]]:
        """Values by layer, 0 in unseen cells."""
        return MappingProxyType(
            {
                name: assembled([(t, v.value) for t, v in tiles.items()], self.grid)
                for name, tiles in self.layers.items()
            }
        )

    @cached_property
    def confidences(self) -> Mapping[str, NDArray[np.float32]]:
        """Confidences by layer, 0 in unseen cells."""
        return MappingProxyType(
            {
                name: assembled([(t, v.confidence) for t, v in tiles.items()], self.grid)
                for name, tiles in self.layers.items()
            }
        )

    def line_of_sight(
        self, eye_m: tuple[float, float, float], point_m: tuple[float, float, float]
    ) -> bool:
        """True if the point (world x, y, z) is visible from the eye; see `line_of_sight`."""
        return line_of_sight(self.grid, self.occupancy, self.z_low_m, self.z_high_m, eye_m, point_m)

    @property
    def empty(self) -> bool:
        """True if the map has no content yet, neither from frames nor from a file."""
        return self.frame_id is None and not self.ground


def frontier_json(frontier: Frontier) -> dict[str, object]:
    """JSON of a frontier, without its cells."""
    return {
        "id": frontier.id,
        "centre_m": list(frontier.centre_m),
        "size_m": frontier.size_m,
        "reachable": frontier.reachable,
        "values": dict(frontier.values),
    }


def about(snapshot: MapSnapshot) -> dict[str, object]:
    """Metadata of every export, as JSON: map id and version, newest frame (boot id, world epoch,
    number) and its stamp, search context, robot pose, and grid."""
    frame_id = snapshot.frame_id
    return {
        "map_id": snapshot.map_id,
        "version": snapshot.version,
        "frame_id": None
        if frame_id is None
        else [frame_id.robot_boot_id, frame_id.world_epoch, frame_id.seq],
        "stamp_ns": snapshot.stamp_ns,
        "context_id": snapshot.context_id,
        "grid": _grid_json(snapshot.grid),
        "robot_pose": snapshot.robot_pose,
    }


def encode_npz(snapshot: MapSnapshot) -> bytes:
    """Compressed NPZ of a snapshot: its arrays, and `meta`, a JSON text with everything else.

    Layers are `value_<name>` and `confidence_<name>`; frontier cells are `frontier_cells` int32
    [n, 3] (index of the frontier, row, column of the world cell).
    """
    cells = [
        np.column_stack([np.full(len(f.cells), k), f.cells])
        for k, f in enumerate(snapshot.frontiers)
    ]
    meta = {
        **about(snapshot),
        "next_frontier_id": snapshot.next_frontier_id,
        "frontiers": [frontier_json(f) for f in snapshot.frontiers],
        "layers": list(snapshot.values),
        "frames": "world z up; row along y, column along x; origin_m is the lower-left corner; "
        "corner counts cells from the world's origin",
        "occupancy": {"unknown": -1, "free": 0, "occupied": 100},
    }
    arrays: dict[str, NDArray] = {
        "meta": np.array(json.dumps(meta)),
        "occupancy": snapshot.occupancy,
        "explored": snapshot.known,
        "explored_for_search": snapshot.explored_for_search,
        "z_low_m": snapshot.z_low_m,
        "z_high_m": snapshot.z_high_m,
        "trajectory_m": snapshot.trajectory_m,
        "trajectory_starts": np.array(snapshot.trajectory_starts, np.uint32),
        "frontier_cells": np.concatenate([np.empty((0, 3)), *cells]).astype(np.int32),
    }
    for k, name in enumerate(snapshot.values):
        arrays[f"value_{_key(name, k)}"] = snapshot.values[name]
        arrays[f"confidence_{_key(name, k)}"] = snapshot.confidences[name]
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


def decode_npz(data: bytes, version: int | None = None) -> MapSnapshot:
    """Snapshot of an `encode_npz` file, with its own version or the given one.

    Raises InvalidInput for other data, and for too large content before unpacking it.
    """
    try:
        arrays = unpacked(data)
        return _decoded(arrays, json.loads(str(arrays["meta"])), version)
    except InvalidInput:
        raise
    except Exception as error:
        why = f"there is no {error}" if isinstance(error, KeyError) else error
        raise InvalidInput(
            f"these {len(data)} bytes are no map snapshot (NPZ) as map2d/save writes it: {why}"
        ) from error


def _decoded(arrays: dict[str, NDArray], meta: dict, version: int | None) -> MapSnapshot:
    grid = _grid_of(meta["grid"])
    names = meta["layers"]
    layered = {
        name: (arrays[f"value_{_key(name, k)}"], arrays[f"confidence_{_key(name, k)}"])
        for k, name in enumerate(names)
    }
    plain = ("occupancy", "explored", "explored_for_search", "z_low_m", "z_high_m")
    over_grid = [arrays[name] for name in plain]
    for array in [*over_grid, *(a for pair in layered.values() for a in pair)]:
        if array.shape != grid.shape:
            raise InvalidInput(
                f"a map array is {array.shape}, its grid {grid.shape}: it is damaged; save it again"
            )
    for name in ("occupancy", "explored_for_search"):
        if arrays[name].dtype.kind not in "iu":
            raise InvalidInput(f"{name} is {arrays[name].dtype}, wanted whole numbers")
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
    head = pb.KeptMap(
        map_id=meta["map_id"], stamp_ns=meta["stamp_ns"], context_id=meta["context_id"]
    )
    if meta["frame_id"] is not None:
        boot_id, epoch, seq = meta["frame_id"]
        head.id.CopyFrom(pb.FrameId(robot_boot_id=boot_id, world_epoch=epoch, seq=seq))
    pose = meta["robot_pose"]
    trajectory_m = np.ascontiguousarray(arrays["trajectory_m"], np.float64).reshape(-1, 2)
    trajectory_m.flags.writeable = False
    version = int(meta["version"]) if version is None else version
    return MapSnapshot(
        map_id=head.map_id,
        version=version,
        frame_id=frame_id_from_proto(head.id) if head.HasField("id") else None,
        stamp_ns=head.stamp_ns,
        context_id=head.context_id,
        grid=grid,
        ground=ground_of(grid, version, over_grid[0], over_grid[2], over_grid[3], over_grid[4]),
        layers=MappingProxyType(
            {name: values_of(name, grid, version, *pair) for name, pair in layered.items()}
        ),
        frontiers=frontiers,
        robot_pose=None if pose is None else (float(pose[0]), float(pose[1]), float(pose[2])),
        trajectory_m=trajectory_m,
        next_frontier_id=int(meta["next_frontier_id"]),
        trajectory_starts=tuple(arrays.get("trajectory_starts", np.empty(0)).astype(int).tolist()),
    )


def ground_of(
    grid: GridSpec,
    version: int,
    occupancy: NDArray,
    searched: NDArray,
    z_low_m: NDArray,
    z_high_m: NDArray,
) -> Ground:
    """Ground tiles from arrays over `grid`; obstacles get `EVIDENCE`, free cells `floor_seen`."""
    what = cut_up(occupancy.astype(np.int8), grid, UNKNOWN)
    seen = cut_up(searched.astype(np.uint8), grid)
    low = cut_up(z_low_m.astype(np.float32), grid)
    high = cut_up(z_high_m.astype(np.float32), grid)
    return MappingProxyType(
        {
            tile: GroundTile(
                tile,
                version,
                version,
                what[tile],
                seen[tile],
                low[tile],
                high[tile],
                np.where(what[tile] == OCCUPIED, EVIDENCE, 0).astype(np.uint8),
                (what[tile] == FREE).astype(np.uint8),
            )
            for tile in what
        }
    )


def values_of(
    name: str, grid: GridSpec, version: int, value: NDArray, confidence: NDArray
) -> Values:
    """Tiles of a value layer from arrays over `grid`."""
    value_parts = cut_up(value.astype(np.float32), grid)
    confidence_parts = cut_up(confidence.astype(np.float32), grid)
    return MappingProxyType(
        {t: ValueTile(t, name, version, value_parts[t], confidence_parts[t]) for t in value_parts}
    )


def _key(name: str, index: int) -> str:
    """Part of a ZIP member name for a layer: its name, or its index if that is no identifier."""
    return name if name.isidentifier() else str(index)


def _grid_json(grid: GridSpec) -> dict[str, object]:
    return {
        "cell_m": grid.cell_m,
        "rows": grid.rows,
        "columns": grid.columns,
        "corner": list(grid.corner),
        "origin_m": list(grid.origin_m),
    }


def _grid_of(raw: dict) -> GridSpec:
    row, column = raw["corner"]
    return GridSpec(
        float(raw["cell_m"]), int(raw["rows"]), int(raw["columns"]), (int(row), int(column))
    )
