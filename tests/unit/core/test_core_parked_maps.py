"""Parked maps of earlier worlds, as both map services keep them."""

from __future__ import annotations

from helios_core.parked_maps import MOST_PARKED, ParkedMaps
from helios_core.types import WorldId


def world(n: int) -> WorldId:
    return WorldId("boot", n, "")


def test_a_parked_map_can_be_taken_back_once_and_its_world_is_no_longer_over() -> None:
    maps: ParkedMaps[str] = ParkedMaps()
    maps.park(world(1), "first")
    assert maps.is_over(world(1))
    assert maps.take_back(world(1)) == "first"
    assert not maps.is_over(world(1))
    assert maps.take_back(world(1)) is None


def test_the_oldest_of_too_many_maps_is_dropped_and_its_world_stays_over() -> None:
    maps: ParkedMaps[str] = ParkedMaps()
    for n in range(MOST_PARKED + 1):
        maps.park(world(n), f"map {n}")
    assert maps.by_world().keys() == {world(n) for n in range(1, MOST_PARKED + 1)}
    assert maps.is_over(world(0))
    assert maps.take_back(world(0)) is None


def test_putting_a_map_replaces_the_one_of_its_world_and_ends_no_world() -> None:
    maps: ParkedMaps[str] = ParkedMaps()
    maps.park(world(1), "seen")
    loaded = "loaded"
    maps.put(world(1), loaded)
    maps.put(world(2), "other")
    assert maps.by_world() == {world(1): loaded, world(2): "other"}
    assert maps.world_of(loaded) == world(1)
    assert not maps.is_over(world(2))


def test_the_worlds_of_cleared_maps_stay_over() -> None:
    maps: ParkedMaps[str] = ParkedMaps()
    maps.park(world(1), "map")
    maps.clear()
    assert maps.take_back(world(2)) is None
    assert maps.is_over(world(1))
    assert maps.world_of("map") is None
