"""Changes of the map since the version that a viewer has.

Tiles are ordered by version, row and column. A viewer stores a cursor in that order; all later
tiles are new to it, for a new viewer the whole map. So the service stores nothing per viewer, a
change during the transfer follows later in the order, and each tile is encoded once for all
viewers.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from helios_core import proto as pb
from helios_core.codec import frame_id_to_proto

from helios_map2d.grid import TILE
from helios_map2d.snapshots.snapshot import MapSnapshot

DEFAULT_TILES, MOST_TILES = 64, 1024


class Cursor(NamedTuple):
    """Position in the order of changes; ground tiles have layer ""."""

    version: int = 0
    row: int = 0
    column: int = 0
    layer: str = ""


def changes_after(snapshot: MapSnapshot, request: pb.MapChangesRequest) -> pb.MapChanges:
    """Next chunk of changes for a viewer; see `MapChangesRequest` and `MapChanges`."""
    out = pb.MapChanges(
        map_id=snapshot.map_id,
        version=snapshot.version,
        tile_cells=TILE,
        cell_m=snapshot.grid.cell_m,
        context_id=snapshot.context_id,
        layers=list(snapshot.layers),
    )
    after = Cursor()
    if request.map_id == snapshot.map_id and request.after.version <= snapshot.version:
        at = request.after
        after = Cursor(at.version, at.row, at.column, at.layer)
    new = sorted(cursor for cursor in _order(snapshot, request.layers) if cursor > after)
    limit = min(request.most_tiles or DEFAULT_TILES, MOST_TILES)
    out.tiles.extend(_tile(snapshot, cursor) for cursor in new[:limit])
    last = new[min(limit, len(new)) - 1] if new else after
    out.next.CopyFrom(pb.MapCursor(**last._asdict()))
    out.more = len(new) > limit
    if snapshot.frame_id is not None:
        out.id.CopyFrom(frame_id_to_proto(snapshot.frame_id))
    if snapshot.robot_pose is not None:
        x_m, y_m, yaw_rad = snapshot.robot_pose
        out.robot.CopyFrom(pb.Pose2(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad))
    if not out.more:
        out.frontiers.extend(frontier_messages(snapshot))
    return out


def frontier_messages(snapshot: MapSnapshot) -> list[pb.Frontier]:
    """Messages of the frontiers."""
    return [
        pb.Frontier(
            id=f.id,
            x_m=f.centre_m[0],
            y_m=f.centre_m[1],
            size_m=f.size_m,
            values=dict(f.values),
            reachable=f.reachable,
        )
        for f in snapshot.frontiers
    ]


def _order(snapshot: MapSnapshot, layers: bool) -> Iterator[Cursor]:
    """Cursors of all tiles of a version."""
    for place, tile in snapshot.ground.items():
        yield Cursor(tile.version, *place)
    if layers:
        for name, tiles in snapshot.layers.items():
            for place, value in tiles.items():
                yield Cursor(value.version, *place, name)


def _tile(snapshot: MapSnapshot, cursor: Cursor) -> pb.MapTile:
    """Message of the tile at a cursor."""
    version, row, column, layer = cursor
    out = pb.MapTile(row=row, column=column, version=version, layer=layer)
    if layer:
        out.value = snapshot.layers[layer][row, column].message
    else:
        out.ground.CopyFrom(snapshot.ground[row, column].message)
    return out
