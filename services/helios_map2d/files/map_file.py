"""Encoding and decoding of the map file, which holds a complete map.

The file consists of a head line, the SHA-256 of the rest, and a `KeptMap` message, joined from the
encoded tiles of a published version. So truncated, altered or foreign files are recognised. Each
tile is encoded once, but every file is joined and hashed as a whole.
"""

from __future__ import annotations

import hashlib

import numpy as np
from google.protobuf.message import DecodeError
from helios_core import proto as pb
from helios_core.codec import frame_id_from_proto, frame_id_to_proto
from helios_core.errors import InvalidInput
from helios_core.types import WorldId
from numpy.typing import NDArray

from helios_map2d.epoch_map import EpochMap
from helios_map2d.files.map_contents import MapContent, check_cell, check_content
from helios_map2d.grid import TILE, Tile
from helios_map2d.layers.frontiers import Frontier
from helios_map2d.layers.parameters import MapRules
from helios_map2d.snapshots.snapshot import MapSnapshot
from helios_map2d.snapshots.tiles import ValueTile, read_ground, read_values
from helios_map2d.snapshots.trajectory import Trajectory
from helios_map2d.view_memory.stored_views import SeenView, read_view

HEAD = b"helios map2d 1\n"
FILE_NAME = "map2d.map"
HIGHEST_VERSION = 2**62  # later versions of the map must fit into messages, too


def encode_map(snapshot: MapSnapshot, views: tuple[SeenView, ...], world: WorldId | None) -> bytes:
    """Map file of a version, with its stored views and its world."""
    head = pb.KeptMap(
        map_id=snapshot.map_id,
        stamp_ns=snapshot.stamp_ns,
        version=snapshot.version,
        cell_m=snapshot.grid.cell_m,
        tile_cells=TILE,
        context_id=snapshot.context_id,
        layers=list(snapshot.layers),
        trajectory_m=snapshot.trajectory_m.ravel().tolist(),
        trajectory_starts=snapshot.trajectory_starts,
        next_frontier_id=snapshot.next_frontier_id,
        frontiers=[
            pb.KeptFrontier(id=f.id, cells=f.cells.ravel().tolist()) for f in snapshot.frontiers
        ],
    )
    if world is not None:
        head.robot_boot_id, head.world_epoch = world.robot_boot_id, world.world_epoch
        head.origin_id = world.origin_id
    if snapshot.frame_id is not None:
        head.id.CopyFrom(frame_id_to_proto(snapshot.frame_id))
    if snapshot.robot_pose is not None:
        x_m, y_m, yaw_rad = snapshot.robot_pose
        head.robot.CopyFrom(pb.Pose2(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad))
    body = b"".join(
        [head.SerializeToString()]
        + [tile.kept for tile in snapshot.ground.values()]
        + [tile.kept for tiles in snapshot.layers.values() for tile in tiles.values()]
        + [view.kept for view in views]
    )
    return HEAD + hashlib.sha256(body).digest() + body


def decode_map(
    data: bytes, rules: MapRules, footprint_radius_m: float, version: int
) -> tuple[EpochMap, WorldId]:
    """Map of a file, with a version above `version`, and its world.

    Raises InvalidInput if the file is truncated, damaged, foreign, or has another cell size or a
    version of HIGHEST_VERSION or more.
    """
    start = len(HEAD) + hashlib.sha256().digest_size
    if not data.startswith(HEAD):
        raise InvalidInput(
            f"these {len(data)} bytes are no map file of this version of HELIOS; use the "
            "HELIOS that wrote it, or start with an empty map"
        )
    if hashlib.sha256(data[start:]).digest() != data[len(HEAD) : start]:
        raise InvalidInput(f"the map file is damaged or cut short, at {len(data)} bytes")
    try:
        message = pb.KeptMap.FromString(data[start:])
    except DecodeError as error:
        raise InvalidInput(f"the map file cannot be read: {error}") from error
    check_cell(message.cell_m, rules.cell_m)
    if message.tile_cells != TILE:
        raise InvalidInput(
            f"the map file has tiles of {message.tile_cells} cells, wanted {TILE}: load an export "
            "(npz) of it instead"
        )
    if message.version >= HIGHEST_VERSION:
        raise InvalidInput(
            f"the map file says that its map has version {message.version}, wanted less than "
            f"{HIGHEST_VERSION}: it is damaged; save the map again"
        )
    version = max(version, message.version)
    ground = [read_ground(tile, version + 1) for tile in message.ground]
    values: dict[str, dict[Tile, ValueTile]] = {name: {} for name in message.layers}
    for kept in message.values:
        tile = read_values(kept, version + 1)
        values.setdefault(tile.layer, {})[tile.place] = tile
    state = map_from_content(
        MapContent(
            frame_id=frame_id_from_proto(message.id) if message.HasField("id") else None,
            stamp_ns=message.stamp_ns,
            context_id=message.context_id,
            ground={tile.place: tile for tile in ground},
            values=values,
            robot_pose=(message.robot.x_m, message.robot.y_m, message.robot.yaw_rad)
            if message.HasField("robot")
            else None,
            trajectory_m=_pairs(np.array(message.trajectory_m, np.float64)),
            trajectory_starts=tuple(message.trajectory_starts),
            frontiers={f.id: _pairs(np.array(f.cells, np.int32)) for f in message.frontiers},
            next_frontier_id=message.next_frontier_id,
        ),
        rules,
        footprint_radius_m,
        version,
    )
    for view in message.views:
        state.memory.add(read_view(view))
    return state, WorldId(message.robot_boot_id, message.world_epoch, message.origin_id)


def map_from_content(
    content: MapContent, rules: MapRules, footprint_radius_m: float, version: int
) -> EpochMap:
    """Map with this content and a new id, so that viewers of another map start over.

    Raises InvalidInput if it would be larger than allowed, or the content is not valid.
    """
    check_content(content, rules.cell_m)
    centre = content.robot_pose[:2] if content.robot_pose is not None else (0.0, 0.0)
    if content.robot_pose is None and content.ground:
        row, column = next(iter(content.ground))
        centre = column * TILE * rules.cell_m, row * TILE * rules.cell_m
    state = EpochMap(rules, centre, footprint_radius_m, version)
    state.context_id = content.context_id
    state.frame_id, state.stamp_ns = content.frame_id, content.stamp_ns
    state.order.newest = content.frame_id.seq if content.frame_id is not None else None
    state.robot_pose = content.robot_pose
    state.trajectory = Trajectory(
        rules.trajectory_step_m, content.trajectory_m, content.trajectory_starts
    )
    state.stack.frontiers.next_id = max(1, content.next_frontier_id)
    state.stack.frontiers.remember(
        tuple(
            Frontier(id, (0.0, 0.0), 0.0, False, {}, cells)
            for id, cells in content.frontiers.items()
            if len(cells)
        )
    )
    state.restore(content.ground, content.values)
    state.publish_above(version)
    return state


def _pairs(numbers: NDArray) -> NDArray:
    """Numbers [2 n] as [n, 2]. Raises InvalidInput for an odd count."""
    if len(numbers) % 2:
        raise InvalidInput(
            f"the map file has places of {len(numbers)} numbers, not x, y: it is damaged"
        )
    return numbers.reshape(-1, 2)
