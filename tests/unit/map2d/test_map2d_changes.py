"""A client gets the whole map once, in chunks, and then only changes."""

from __future__ import annotations

import math
import zlib

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.map_replica import MapReplica
from helios_core.map_snapshot import OCCUPIED, decode_snapshot
from helios_core.topics import MAP_CHANGES, RESET_MAP2D
from helios_map2d.snapshots import tiles
from map2d_kept import state_of
from map2d_rig import Rig


def follow(rig: Rig, mirror: MapReplica) -> int:
    """Update a replica and return the number of tiles received."""
    taken = 0
    while True:
        changes = rig.bus.call(MAP_CHANGES, mirror.request(), 5)
        taken += len(changes.tiles)
        if not mirror.apply(changes):
            return taken


def assert_same(rig: Rig, mirror: MapReplica) -> None:
    whole = decode_snapshot(rig.snapshot())
    got, origin_m = mirror.occupancy()
    row, column = (
        round((a - b) / whole.cell_m)
        for a, b in zip(whole.origin_m[::-1], origin_m[::-1], strict=True)
    )
    rows, columns = whole.shape
    part = got[row : row + rows, column : column + columns]
    np.testing.assert_array_equal(part, whole.occupancy)
    assert (got != -1).sum() == (whole.occupancy != -1).sum()
    assert mirror.version == whole.version
    assert {f.id for f in mirror.frontiers} == {f.id for f in whole.frontiers}
    for name, layer in whole.values.items():
        seen = sum(float(v.sum()) for v in mirror.values.get(name, {}).values())
        assert seen == pytest.approx(float(layer.sum()), rel=1e-3)


def test_a_late_client_gets_the_whole_map_in_chunks_and_then_only_changes() -> None:
    rig = Rig()
    rig.settle()
    mirror = MapReplica(layers=True, tiles_at_once=3)
    whole = follow(rig, mirror)
    assert whole > 6
    assert_same(rig, mirror)
    assert follow(rig, mirror) == 0
    frame = rig.walk.frame(2.0, 1.5, 0.0)
    rig.walk.blocks = rig.walk.blocks[:4]  # the table is gone
    rig.keyframe(rig.walk.frame(2.0, 1.5, math.pi / 4))
    rig.observe(frame, "first")
    assert 0 < follow(rig, mirror) < whole
    assert_same(rig, mirror)


def test_a_map_that_changes_during_a_transfer_is_received_correctly() -> None:
    rig = Rig()
    rig.search("first")
    mirror = MapReplica(layers=True, tiles_at_once=2)
    for frame in rig.walk.look_around(2.0, 1.5):
        rig.keyframe(frame)
        rig.observe(frame, "first")
        mirror.apply(rig.bus.call(MAP_CHANGES, mirror.request(), 5))
    follow(rig, mirror)
    assert_same(rig, mirror)


def test_a_replica_follows_a_new_search_and_a_new_map() -> None:
    rig = Rig()
    rig.settle()
    mirror = MapReplica(layers=True)
    follow(rig, mirror)
    assert set(mirror.values) == {"pick", "place"}
    rig.search("second", {"third": "a sofa"})
    follow(rig, mirror)
    assert not mirror.values
    assert_same(rig, mirror)
    rig.bus.call(RESET_MAP2D, pb.Empty(), 5)
    rig.keyframe(rig.walk.frame(2.0, 1.5, 0.0))
    follow(rig, mirror)
    assert_same(rig, mirror)


def test_a_tile_is_encoded_once_for_any_number_of_clients(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig()
    rig.settle()
    packed, calls = tiles.packed, []
    monkeypatch.setattr(tiles, "packed", lambda array: (calls.append(1), packed(array))[1])
    follow(rig, MapReplica(layers=True))
    first = len(calls)
    assert first > 0
    for _ in range(5):
        follow(rig, MapReplica(layers=True))
    assert len(calls) == first


def test_the_whole_snapshot_is_encoded_once_for_any_number_of_clients(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from helios_map2d.snapshots import messages

    rig = Rig()
    rig.settle()
    packed, calls = messages.packed, []
    monkeypatch.setattr(messages, "packed", lambda array: (calls.append(1), packed(array))[1])
    rig.snapshot()
    first = len(calls)
    for _ in range(5):
        rig.snapshot()
    assert len(calls) == first > 0


def test_a_replica_is_empty_before_the_first_keyframe() -> None:
    rig, mirror = Rig(), MapReplica()
    assert follow(rig, mirror) == 0
    assert mirror.occupancy()[0].size == 0


def test_bottom_heights_of_obstacles_are_in_the_snapshot_and_in_the_changes() -> None:
    """Clients that plan over and under obstacles use them; no HELIOS service does."""
    rig = Rig()
    rig.settle()
    mirror = MapReplica()
    follow(rig, mirror)
    published = state_of(rig).published
    whole = np.frombuffer(zlib.decompress(rig.snapshot().bottom_mm), "<u2")
    low_mm = np.rint(published.z_low_m * 1000)
    np.testing.assert_array_equal(whole.reshape(published.grid.shape), low_mm)
    assert low_mm.max() > 500  # a table's top
    for place, tile in published.ground.items():
        there = tile.occupancy == OCCUPIED
        got = mirror.pieces[place].bottom_m
        np.testing.assert_allclose(got[there], tile.z_low_m[there], atol=0.00051)
        assert not got[~there].any()


def test_a_damaged_tile_is_refused() -> None:
    mirror = MapReplica()
    tile = pb.MapTile(ground=pb.GroundTile(occupancy=b"no zlib"))
    with pytest.raises(InvalidInput, match="tile of the map is corrupt"):
        mirror.apply(pb.MapChanges(tile_cells=64, cell_m=0.025, tiles=[tile]))
