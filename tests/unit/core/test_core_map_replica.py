"""A replica of the map stays whole, whatever changes come. `tests/unit/map2d` has the service."""

from __future__ import annotations

import zlib
from collections.abc import Iterable

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.map_replica import MapReplica

N = 4


def tile(row: int, column: int, n: int = N, value: int = 0) -> pb.MapTile:
    """Ground tile with one occupancy in all its cells."""
    cells = n * n
    return pb.MapTile(
        row=row,
        column=column,
        ground=pb.GroundTile(
            occupancy=zlib.compress(bytes([value]) * cells),
            searched=zlib.compress(bytes(cells)),
            top_mm=zlib.compress(bytes(2 * cells)),
            bottom_mm=zlib.compress(bytes(2 * cells)),
        ),
    )


def changes(
    tiles: Iterable[pb.MapTile],
    version: int = 1,
    n: int = N,
    map_id: str = "a",
    cell_m: float = 0.1,
) -> pb.MapChanges:
    return pb.MapChanges(
        map_id=map_id,
        version=version,
        tile_cells=n,
        cell_m=cell_m,
        tiles=tiles,
        next=pb.MapCursor(version=version),
        layers=["pick"],
        context_id=f"search in {map_id}",
    )


def whole() -> MapReplica:
    """Replica of a map of two tiles and a layer."""
    replica = MapReplica(layers=True)
    values = pb.MapTile(layer="pick", value=zlib.compress(np.ones((N, N), "<f2").tobytes()))
    assert not replica.apply(changes([tile(0, 0), tile(0, 1, value=100), values]))
    return replica


def test_tiles_of_another_size_replace_the_map_and_are_asked_for_anew() -> None:
    replica = whole()
    assert replica.request().after.version == 1
    assert replica.apply(changes([tile(0, 1, 2 * N)], 2, 2 * N))  # only what has changed since
    assert replica.request().after == pb.MapCursor()
    assert replica.occupancy()[0].size == 0
    assert not replica.apply(changes([tile(0, 0, 2 * N), tile(0, 1, 2 * N)], 2, 2 * N))
    assert replica.occupancy()[0].shape == (2 * N, 4 * N)
    assert replica.version == 2


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (changes([tile(0, 2), tile(2**30, 0)], 2), "at most 64 million cells"),
        (changes([tile(0, 2), tile(0, -(2**30))], 2), "at most 64 million cells"),
        (changes([tile(0, 2), tile(1, 0, 2 * N)], 2), "a tile of the map is no 4x4 array"),
        (
            changes([tile(0, 2), pb.MapTile(layer="pick", value=b"no zlib")], 2, map_id="b"),
            "is corrupt",
        ),
        (changes([], 2, n=5000), "tiles of 5000x5000 .*; wanted at most 1024 cells a side"),
        (changes([], 2, cell_m=float("nan")), "cells of nan m; wanted .* above 0 m: run one"),
    ],
)
def test_refused_changes_leave_the_replica_as_it_was(bad: pb.MapChanges, said: str) -> None:
    replica, other = whole(), whole()
    with pytest.raises(InvalidInput, match=said):
        replica.apply(bad)
    assert replica.request() == other.request()
    assert (replica.version, replica.tile_cells, replica.cell_m) == (1, N, 0.1)
    assert replica.context_id == "search in a"
    assert set(replica.values) == {"pick"}
    assert np.array_equal(replica.occupancy()[0], other.occupancy()[0])


def test_another_map_may_lie_anywhere() -> None:
    replica = whole()
    assert not replica.apply(changes([tile(2**30, 7)], map_id="b"))
    assert list(replica.pieces) == [(2**30, 7)]
    assert replica.values == {}
