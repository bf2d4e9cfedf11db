"""A robot that starts anew and says that its origin is the same: the map goes on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from helios_core.types import Frame
from map2d_house import House
from map2d_kept import state_of

ORIGIN = "kitchen-2026"


def seen(house: House, boot: str, origin: str, epoch: int = 0, yaw: float = 0.0) -> Frame:
    """What the robot sees after that start; the numbers of its frames go on."""
    frame = house.walk.frame(2.0, 1.5, yaw)
    id = replace(frame.id, robot_boot_id=boot, world_epoch=epoch)
    return replace(frame, id=id, origin_id=origin)


def walked(*flags: str, origin: str = ORIGIN) -> House:
    house = House(*flags)
    house.say_epoch("monday", origin=origin)
    house.search("first")
    for yaw in range(6):
        house.keyframe(seen(house, "monday", origin, yaw=float(yaw)))
    assert all(ack.accepted for ack in house.acks)
    return house


def kept(folder: Path) -> tuple[str, ...]:
    return "--state-dir", str(folder), "--keep-period-s", "3600"


@pytest.mark.parametrize("told_first", [True, False])
def test_the_map_goes_on_after_a_start_with_the_same_origin(told_first: bool) -> None:
    house = walked()
    before, map_id = house.snapshot(), state_of(house).map_id
    if told_first:
        house.say_epoch("tuesday", origin=ORIGIN, at=(3.0, 1.0, 0.5))
        told = house.snapshot()
        assert (told.robot.x_m, told.id.robot_boot_id) == (3.0, "")
        assert told.occupied_m2 == before.occupied_m2
    house.keyframe(seen(house, "tuesday", ORIGIN))
    after = house.snapshot()
    assert house.acks[-1].accepted, house.acks[-1].reason
    assert (state_of(house).map_id, after.id.robot_boot_id) == (map_id, "tuesday")
    assert after.explored_m2 >= before.explored_m2
    assert after.version > before.version
    assert after.map_id == before.map_id == map_id
    assert house.snapshot(if_newer=after.version).map_id == map_id


@pytest.mark.parametrize(
    ("before", "after", "epoch"),
    [(ORIGIN, "garage", 0), ("", "", 0), (ORIGIN, "", 0), ("", ORIGIN, 0), (ORIGIN, ORIGIN, 1)],
)
def test_another_origin_or_none_or_a_jump_begins_a_new_map(
    before: str, after: str, epoch: int
) -> None:
    house = walked(origin=before)
    old, map_id = house.snapshot(), state_of(house).map_id
    house.say_epoch("tuesday", world_epoch=epoch, origin=after)
    house.keyframe(seen(house, "tuesday", after, epoch=epoch))
    assert house.acks[-1].accepted
    assert state_of(house).map_id != map_id == old.map_id
    assert house.snapshot().map_id == state_of(house).map_id
    assert house.snapshot().explored_m2 < old.explored_m2


def test_a_robot_may_be_carried_between_its_starts() -> None:
    house = walked("--most-leap-m", "0.5")
    house.say_epoch("tuesday", origin=ORIGIN, at=(3.2, 1.5, 0.0))
    frame = house.walk.frame(3.2, 1.5, 0.0)
    id = replace(frame.id, robot_boot_id="tuesday")
    house.keyframe(replace(frame, id=id, origin_id=ORIGIN))
    assert house.acks[-1].accepted, house.acks[-1].reason


def test_a_late_frame_of_an_earlier_start_is_refused_and_changes_nothing() -> None:
    house = walked()
    late = seen(house, "monday", ORIGIN)
    house.say_epoch("tuesday", origin=ORIGIN)
    house.keyframe(seen(house, "tuesday", ORIGIN))
    before = house.snapshot()
    house.keyframe(late)
    assert not house.acks[-1].accepted
    assert "an earlier start of the robot" in house.acks[-1].reason
    assert house.snapshot() == before


def test_each_number_of_jumps_from_an_origin_has_its_own_map() -> None:
    house = walked()
    old = state_of(house).map_id
    house.say_epoch("monday", world_epoch=1, origin=ORIGIN)
    house.keyframe(seen(house, "monday", ORIGIN, epoch=1))
    jumped = state_of(house).map_id
    house.keyframe(seen(house, "tuesday", ORIGIN, epoch=0))
    assert house.acks[-1].accepted, house.acks[-1].reason
    assert state_of(house).map_id == old
    house.say_epoch("tuesday", world_epoch=1, origin=ORIGIN)
    house.keyframe(seen(house, "tuesday", ORIGIN, epoch=1))
    assert state_of(house).map_id == jumped


def test_a_kept_map_comes_back_by_itself_where_the_origin_is_the_same(tmp_path: Path) -> None:
    house = walked(*kept(tmp_path))
    house.service.close()
    again = House(*kept(tmp_path))
    again.say_epoch("tuesday", origin=ORIGIN, at=(1.0, 0.5, 0.0))
    one, other = state_of(house).published, state_of(again).published
    assert (one.occupancy == other.occupancy).all()
    assert_same_memory(house, again)
    assert "was restored" in again.health.state[1]
    assert again.snapshot().robot.x_m == pytest.approx(1.0)
    again.keyframe(seen(again, "tuesday", ORIGIN))
    assert again.acks[-1].accepted
    assert again.health.state == ("ready", "")
    again.service.close()
    third = House(*kept(tmp_path))
    third.say_epoch("wednesday", origin=ORIGIN)
    assert third.snapshot().occupied_m2 > 0


def assert_same_memory(one: House, other: House) -> None:
    views = [[v.id for v in state_of(house).memory.snapshot()] for house in (one, other)]
    assert views[0] == views[1]


def test_a_kept_map_of_another_origin_is_said_to_be_put_aside(tmp_path: Path) -> None:
    house = walked(*kept(tmp_path))
    house.service.close()
    again = House(*kept(tmp_path))
    again.say_epoch("monday", origin="garage")
    assert again.snapshot().cell_m == 0
    assert "is of another world and is not used" in again.health.state[1]
