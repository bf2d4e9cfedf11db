"""Immutable published tiles of the map, each encoded at most once.

A version of the map shares all unchanged tiles with the version before. So the cost of publishing
depends on the area that a view changed, and a viewer needs only the tiles newer than its version.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from helios_core import proto as pb
from helios_core.map_snapshot import OCCUPIED, UNKNOWN, inflated
from numpy.typing import NDArray

from helios_map2d.grid import TILE, Box, GridSpec, Tile
from helios_map2d.layers.occupancy import OccupancyLayer
from helios_map2d.layers.value_layers import ValueLayer

SHAPE = (TILE, TILE)
HIGHEST_M = 65.0  # heights are sent as uint16 millimetres


@dataclass(frozen=True, eq=False)
class GroundTile:
    """Occupancy, searched area and stored evidence of one tile.

    Arrays [TILE, TILE], read-only. `version` is the map version in which the published content of
    the tile last changed; `revision` the one in which any of its data last changed.
    """

    place: Tile
    version: int
    revision: int
    occupancy: NDArray[np.int8]
    searched: NDArray[np.uint8]
    z_low_m: NDArray[np.float32]
    z_high_m: NDArray[np.float32]
    evidence: NDArray[np.uint8]
    floor_seen: NDArray[np.uint8]

    @cached_property
    def top_mm(self) -> NDArray[np.uint16]:
        """Highest obstacle in millimetres, 0 without one."""
        return in_mm(np.where(self.occupancy == OCCUPIED, self.z_high_m, 0))

    @cached_property
    def message(self) -> pb.GroundTile:
        """Message of the tile; heights in millimetres, 0 without an obstacle."""
        return pb.GroundTile(
            occupancy=packed(self.occupancy),
            searched=packed(self.searched),
            bottom_mm=packed(in_mm(np.where(self.occupancy == OCCUPIED, self.z_low_m, 0))),
            top_mm=packed(self.top_mm),
        )

    @cached_property
    def kept(self) -> bytes:
        """Complete tile for files: a serialised `KeptMap` of this tile alone. Serialised messages
        laid end to end read as one message."""
        tile = pb.KeptTile(
            row=self.place[0],
            column=self.place[1],
            occupancy=packed(self.occupancy),
            searched=packed(self.searched),
            z_low_m=packed(self.z_low_m.astype("<f4")),
            evidence=packed(self.evidence),
            z_high_m=packed(self.z_high_m.astype("<f4")),
            floor_seen=packed(self.floor_seen),
        )
        return pb.KeptMap(ground=[tile]).SerializeToString()


@dataclass(frozen=True, eq=False)
class ValueTile:
    """One value layer over one tile: float32 [TILE, TILE], read-only, 0 in unseen cells."""

    place: Tile
    layer: str
    version: int
    value: NDArray[np.float32]
    confidence: NDArray[np.float32]

    @cached_property
    def message(self) -> bytes:
        """Value for messages: packed float16."""
        return packed(self.value.astype("<f2"))

    @cached_property
    def kept(self) -> bytes:
        """Tile for files: a serialised `KeptMap` of this tile alone."""
        tile = pb.KeptValues(
            row=self.place[0],
            column=self.place[1],
            layer=self.layer,
            value=packed(self.value.astype("<f4")),
            confidence=packed(self.confidence.astype("<f4")),
        )
        return pb.KeptMap(values=[tile]).SerializeToString()


Ground = Mapping[Tile, GroundTile]
Values = Mapping[Tile, ValueTile]


def ground_tile(
    layer: OccupancyLayer,
    searched: NDArray[np.uint8],
    place: Tile,
    version: int,
    revision: int,
    same_view: GroundTile | None = None,
    same_heights: GroundTile | None = None,
) -> GroundTile:
    """Present ground tile. `same_view`, `same_heights`: an earlier tile whose occupancy and
    searched area, or whose heights, are unchanged and are shared."""
    row, column = place[0] * TILE - layer.grid.corner[0], place[1] * TILE - layer.grid.corner[1]
    at = slice(row, row + TILE), slice(column, column + TILE)
    if same_view is None:
        occupancy, looked = frozen(layer.occupancy[at]), frozen(searched[at])
    else:
        occupancy, looked = same_view.occupancy, same_view.searched
    if same_heights is None:
        low_m, high_m = frozen(layer.z_low_m[at]), frozen(layer.z_high_m[at])
    else:
        low_m, high_m = same_heights.z_low_m, same_heights.z_high_m
    return GroundTile(
        place,
        version,
        revision,
        occupancy,
        looked,
        low_m,
        high_m,
        frozen(layer.evidence[at]),
        frozen(layer.floor_seen[at]),
    )


def value_tile(
    layer: ValueLayer, name: str, grid: GridSpec, place: Tile, version: int
) -> ValueTile:
    """Present tile of a value layer."""
    at = grid.to_local(Box.of_tile(place)).slices
    return ValueTile(place, name, version, frozen(layer.value[at]), frozen(layer.confidence[at]))


def read_ground(message: pb.KeptTile, version: int) -> GroundTile:
    """Tile that `GroundTile.kept` wrote. Raises InvalidInput if it is damaged."""
    return GroundTile(
        (message.row, message.column),
        version,
        version,
        unpacked(message.occupancy, "<i1"),
        unpacked(message.searched, "<u1"),
        unpacked(message.z_low_m, "<f4"),
        unpacked(message.z_high_m, "<f4"),
        unpacked(message.evidence, "<u1"),
        unpacked(message.floor_seen, "<u1"),
    )


def read_values(message: pb.KeptValues, version: int) -> ValueTile:
    """Tile that `ValueTile.kept` wrote. Raises InvalidInput if it is damaged."""
    return ValueTile(
        (message.row, message.column),
        message.layer,
        version,
        unpacked(message.value, "<f4"),
        unpacked(message.confidence, "<f4"),
    )


def assembled(tiles: Iterable[tuple[Tile, NDArray]], grid: GridSpec, fill: float = 0) -> NDArray:
    """Read-only array over `grid`, assembled from the arrays of tiles; `fill` where there is no
    tile."""
    parts = list(tiles)
    dtype = parts[0][1].dtype if parts else np.dtype(np.float32)
    out = np.full(grid.shape, fill, dtype)
    whole = grid.to_world(grid.whole)
    for tile, array in parts:
        box = Box.of_tile(tile)
        common = box.intersection(whole)
        if not common.empty:
            inner = common.moved(-box.row_lo, -box.column_lo)
            out[grid.to_local(common).slices] = array[inner.slices]
    out.flags.writeable = False
    return out


def cut_up(array: NDArray, grid: GridSpec, fill: float = 0) -> dict[Tile, NDArray]:
    """Read-only tiles of an array over `grid`."""
    whole = grid.to_world(grid.whole)
    out = {}
    for tile in whole.tiles:
        box = Box.of_tile(tile)
        common = box.intersection(whole)
        part = np.full(SHAPE, fill, array.dtype)
        inner = common.moved(-box.row_lo, -box.column_lo).slices
        part[inner] = array[grid.to_local(common).slices]
        part.flags.writeable = False
        out[tile] = part
    return out


def occupancy_of(ground: Ground, grid: GridSpec) -> NDArray[np.int8]:
    """Occupancy over `grid`."""
    parts = [(t, g.occupancy) for t, g in ground.items()]
    return assembled(parts, grid, UNKNOWN).astype(np.int8, copy=False)


def in_mm(heights_m: NDArray) -> NDArray:
    return np.rint(np.clip(heights_m, 0, HIGHEST_M) * 1000).astype("<u2")


def packed(array: NDArray) -> bytes:
    return zlib.compress(np.ascontiguousarray(array).tobytes(), 1)


def stored(array: NDArray) -> bytes:
    """Like `packed`, but without compression: a zlib stream that is larger and far faster."""
    return zlib.compress(np.ascontiguousarray(array).tobytes(), 0)


def unpacked(data: bytes, dtype: str) -> NDArray:
    """Array of a tile; never unpacks more than that. Raises InvalidInput for other data."""
    return inflated(data, dtype, SHAPE, "a tile of the map")


def frozen(array: NDArray) -> NDArray:
    """Contiguous read-only copy."""
    copy = array.copy()
    copy.setflags(write=False)
    return copy
