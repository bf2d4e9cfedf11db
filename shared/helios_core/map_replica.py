"""A viewer's copy of the 2D map: first the whole map in chunks, then only the changes.

replica = MapReplica()
while replica.apply(bus.call(MAP_CHANGES, replica.request(), 5)):
    pass  # until up to date; repeat after each MAP2D_ACK
replica.occupancy()
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import UNKNOWN, inflated

MOST_TILE_CELLS = 1024

Place = tuple[int, int]  # row, column of a tile


@dataclass(frozen=True)
class Piece:
    """Arrays [n, n] of one tile: rows along y upwards, columns along x; heights in metres, 0
    without an obstacle."""

    occupancy: NDArray[np.int8]
    searched: NDArray[np.bool_]
    top_m: NDArray[np.float32]
    bottom_m: NDArray[np.float32]


class MapReplica:
    """Tiles of the map by place. `version`, `frontiers` and `robot` belong to the last complete
    update."""

    def __init__(self, *, layers: bool = False, tiles_at_once: int = 0) -> None:
        self.map_id = ""
        self.version = 0
        self.cell_m = 0.0
        self.tile_cells = 0
        self.pieces: dict[Place, Piece] = {}
        self.values: dict[str, dict[Place, NDArray[np.float32]]] = {}
        self.frontiers: tuple[pb.Frontier, ...] = ()
        self.robot: pb.Pose2 | None = None
        self.context_id = ""
        self._layers, self._at_once = layers, tiles_at_once
        self._next = pb.MapCursor()

    def request(self) -> pb.MapChangesRequest:
        """Next request for changes."""
        return pb.MapChangesRequest(
            map_id=self.map_id, after=self._next, most_tiles=self._at_once, layers=self._layers
        )

    def apply(self, changes: pb.MapChanges) -> bool:
        """Apply the reply to `request`. Returns True if further changes are pending.

        Raises InvalidInput for a damaged tile.
        """
        if changes.tile_cells == 0:  # no map yet
            return False
        if changes.tile_cells > MOST_TILE_CELLS:
            raise InvalidInput(f"tiles of {changes.tile_cells} cells are too large")
        if changes.map_id != self.map_id:
            self.pieces.clear()
            self.values.clear()
            self.map_id = changes.map_id
        if changes.context_id != self.context_id:
            self.values.clear()
            self.context_id = changes.context_id
        self.cell_m, self.tile_cells = changes.cell_m, changes.tile_cells
        for tile in changes.tiles:
            place = (tile.row, tile.column)
            if tile.HasField("ground"):
                self.pieces[place] = self._piece(tile.ground)
            else:
                value = self._unpacked(tile.value, "<f2").astype(np.float32)
                self.values.setdefault(tile.layer, {})[place] = value
        for name in self.values.keys() - set(changes.layers):
            del self.values[name]
        self._next.CopyFrom(changes.next)
        if not changes.more:
            self.version, self.frontiers = changes.version, tuple(changes.frontiers)
            self.robot = changes.robot if changes.HasField("robot") else None
        return changes.more

    def occupancy(self) -> tuple[NDArray[np.int8], tuple[float, float]]:
        """Occupancy [rows, columns] of all tiles, and world x, y (m) of its lower-left corner."""
        n = self.tile_cells
        if not self.pieces:
            return np.zeros((0, 0), np.int8), (0.0, 0.0)
        places = np.array(list(self.pieces))
        row, column = places.min(axis=0)
        rows, columns = places.max(axis=0) - (row, column) + 1
        out = np.full((rows * n, columns * n), UNKNOWN, np.int8)
        for (r, c), piece in self.pieces.items():
            y, x = (r - row) * n, (c - column) * n
            out[y : y + n, x : x + n] = piece.occupancy
        return out, (float(column * n * self.cell_m), float(row * n * self.cell_m))

    def _piece(self, ground: pb.GroundTile) -> Piece:
        mm = np.float32(0.001)
        return Piece(
            self._unpacked(ground.occupancy, "<i1").astype(np.int8),
            self._unpacked(ground.searched, "<u1") > 0,
            self._unpacked(ground.top_mm, "<u2").astype(np.float32) * mm,
            self._unpacked(ground.bottom_mm, "<u2").astype(np.float32) * mm,
        )

    def _unpacked(self, data: bytes, dtype: str) -> NDArray:
        return inflated(data, dtype, (self.tile_cells, self.tile_cells), "a tile of the map")
