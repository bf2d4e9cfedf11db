"""A viewer gets the whole map once, in chunks, and then only what changed."""

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
from map2d_house import House
from map2d_kept import state_of


def follow(house: House, mirror: MapReplica) -> int:
    """Bring a mirror up to date; how many tiles that took."""
    taken = 0
    while True:
        changes = house.bus.call(MAP_CHANGES, mirror.request(), 5)
        taken += len(changes.tiles)
        if not mirror.apply(changes):
            return taken


def assert_same(house: House, mirror: MapReplica) -> None:
    whole = decode_snapshot(house.snapshot())
    got, origin_m = mirror.occupancy()
    row, column = (round((a - b) / whole.cell_m)
                   for a, b in zip(whole.origin_m[::-1], origin_m[::-1], strict=True))  # fmt: skip
    rows, columns = whole.shape
    part = got[row : row + rows, column : column + columns]
    np.testing.assert_array_equal(part, whole.occupancy)
    assert (got != -1).sum() == (whole.occupancy != -1).sum()
    assert mirror.version == whole.version
    assert {f.id for f in mirror.frontiers} == {f.id for f in whole.frontiers}
    for name, layer in whole.values.items():
        seen = sum(float(v.sum()) for v in mirror.values.get(name, {}).values())
        assert seen == pytest.approx(float(layer.sum()), rel=1e-3)


def test_a_late_viewer_gets_the_whole_in_chunks_and_then_only_changes() -> None:
    house = House()
    house.settle()
    mirror = MapReplica(layers=True, tiles_at_once=3)
    whole = follow(house, mirror)
    assert whole > 6
    assert_same(house, mirror)
    assert follow(house, mirror) == 0
    frame = house.walk.frame(2.0, 1.5, 0.0)
    house.walk.blocks = house.walk.blocks[:4]  # the table is gone
    house.keyframe(house.walk.frame(2.0, 1.5, math.pi / 4))
    house.observe(frame, "first")
    assert 0 < follow(house, mirror) < whole
    assert_same(house, mirror)


def test_a_map_that_changes_while_it_is_read_is_read_right() -> None:
    house = House()
    house.search("first")
    mirror = MapReplica(layers=True, tiles_at_once=2)
    for frame in house.walk.look_around(2.0, 1.5):
        house.keyframe(frame)
        house.observe(frame, "first")
        mirror.apply(house.bus.call(MAP_CHANGES, mirror.request(), 5))
    follow(house, mirror)
    assert_same(house, mirror)


def test_another_search_and_another_map_are_noticed() -> None:
    house = House()
    house.settle()
    mirror = MapReplica(layers=True)
    follow(house, mirror)
    assert set(mirror.values) == {"pick", "place"}
    house.search("second", {"third": "a sofa"})
    follow(house, mirror)
    assert not mirror.values
    assert_same(house, mirror)
    house.bus.call(RESET_MAP2D, pb.Empty(), 5)
    house.keyframe(house.walk.frame(2.0, 1.5, 0.0))
    follow(house, mirror)
    assert_same(house, mirror)


def test_a_tile_is_encoded_once_whatever_the_number_of_viewers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    house = House()
    house.settle()
    packed, calls = tiles.packed, []
    monkeypatch.setattr(tiles, "packed", lambda array: (calls.append(1), packed(array))[1])
    follow(house, MapReplica(layers=True))
    first = len(calls)
    assert first > 0
    for _ in range(5):
        follow(house, MapReplica(layers=True))
    assert len(calls) == first


def test_the_whole_snapshot_is_encoded_once_too(monkeypatch: pytest.MonkeyPatch) -> None:
    from helios_map2d.snapshots import messages

    house = House()
    house.settle()
    packed, calls = messages.packed, []
    monkeypatch.setattr(messages, "packed", lambda array: (calls.append(1), packed(array))[1])
    house.snapshot()
    first = len(calls)
    for _ in range(5):
        house.snapshot()
    assert len(calls) == first > 0


def test_before_the_first_keyframe_there_is_nothing_to_mirror() -> None:
    house, mirror = House(), MapReplica()
    assert follow(house, mirror) == 0
    assert mirror.occupancy()[0].size == 0


def test_the_lowest_obstacles_heights_travel_with_the_whole_and_with_the_changes() -> None:
    """Those who plan over and under things ask for them; nobody in HELIOS does."""
    house = House()
    house.settle()
    mirror = MapReplica()
    follow(house, mirror)
    published = state_of(house).published
    whole = np.frombuffer(zlib.decompress(house.snapshot().bottom_mm), "<u2")
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
