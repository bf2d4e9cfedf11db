"""A viewer's copy of the 2D map: first the whole map in chunks, then only the changes.

    replica = MapReplica()
    while replica.apply(bus.call(MAP_CHANGES, replica.request(), 5)):
        pass  # until up to date; repeat after each MAP2D_ACK
    replica.occupancy()

A replica is for one thread.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import MAX_CELLS, UNKNOWN, inflated

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

        Raises InvalidInput for a damaged tile, and for a map of too many cells; the replica is then
        unchanged.
        """
        n, cell_m = changes.tile_cells, changes.cell_m
        if n == 0:  # no map yet
            return False
        if n > MOST_TILE_CELLS or not (math.isfinite(cell_m) and cell_m > 0):
            raise InvalidInput(
                f"the map has tiles of {n}x{n} cells of {cell_m} m; wanted at most "
                f"{MOST_TILE_CELLS} cells a side, above 0 m: run one version of HELIOS everywhere"
            )
        is_same = changes.map_id == self.map_id
        resized = is_same and self.tile_cells > 0 and (n, cell_m) != (self.tile_cells, self.cell_m)
        if resized:  # the reply holds only the changes of a map that is not held any more
            self._empty()
            return True
        places = [(tile.row, tile.column) for tile in changes.tiles]
        _check_extent([*(self.pieces if is_same else ()), *places], n)
        grounds = {
            place: _piece(tile.ground, n)
            for place, tile in zip(places, changes.tiles, strict=True)
            if tile.HasField("ground")
        }
        values = [
            (tile.layer, place, _unpacked(tile.value, "<f2", n).astype(np.float32))
            for place, tile in zip(places, changes.tiles, strict=True)
            if not tile.HasField("ground")
        ]
        if not is_same:
            self._empty()
        if changes.context_id != self.context_id:
            self.values.clear()
        self.map_id, self.context_id = changes.map_id, changes.context_id
        self.cell_m, self.tile_cells = cell_m, n
        self.pieces.update(grounds)
        for layer, place, value in values:
            self.values.setdefault(layer, {})[place] = value
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

    def _empty(self) -> None:
        """Discard all tiles; the next request is for the whole map."""
        self.pieces.clear()
        self.values.clear()
        self.tile_cells = 0
        self._next.Clear()


def _check_extent(places: Sequence[Place], n: int) -> None:
    """Raise InvalidInput if the box around tiles of n x n cells has more than MAX_CELLS cells."""
    rows, columns = zip(*places, strict=True) if places else ((0,), (0,))
    height, width = ((max(side) - min(side) + 1) * n for side in (rows, columns))
    if height * width > MAX_CELLS:
        raise InvalidInput(
            f"the map would be {width}x{height} cells with tiles in rows {min(rows)} to "
            f"{max(rows)} and columns {min(columns)} to {max(columns)}; wanted at most "
            f"{MAX_CELLS // 10**6} million cells: reset the map, or see who sends such tiles"
        )


def _piece(ground: pb.GroundTile, n: int) -> Piece:
    """Piece of n x n cells. Raises InvalidInput if it is damaged."""
    mm = np.float32(0.001)
    return Piece(
        _unpacked(ground.occupancy, "<i1", n).astype(np.int8),
        _unpacked(ground.searched, "<u1", n) > 0,
        _unpacked(ground.top_mm, "<u2", n).astype(np.float32) * mm,
        _unpacked(ground.bottom_mm, "<u2", n).astype(np.float32) * mm,
    )


def _unpacked(data: bytes, dtype: str, n: int) -> NDArray:
    return inflated(data, dtype, (n, n), "a tile of the map")
