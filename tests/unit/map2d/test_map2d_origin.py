"""A robot that restarts with the same origin id continues its 2D map."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from helios_core.types import Frame
from helios_map2d.layers.parameters import MapRules
from map2d_kept import state_of
from map2d_rig import Rig

ORIGIN = "kitchen-2026"


def frame_after_start(rig: Rig, boot: str, origin: str, epoch: int = 0, yaw: float = 0.0) -> Frame:
    """A frame of that start of the robot; frame numbers continue across starts."""
    frame = rig.walk.frame(2.0, 1.5, yaw)
    id = replace(frame.id, robot_boot_id=boot, world_epoch=epoch)
    return replace(frame, id=id, origin_id=origin)


def rig_with_map(*flags: str, origin: str = ORIGIN) -> Rig:
    rig = Rig(*flags)
    rig.say_epoch("monday", origin=origin)
    rig.search("first")
    for yaw in range(6):
        rig.keyframe(frame_after_start(rig, "monday", origin, yaw=float(yaw)))
    assert all(ack.accepted for ack in rig.acks)
    return rig


def autosave_flags(folder: Path) -> tuple[str, ...]:
    return "--state-dir", str(folder), "--keep-period-s", "3600"


@pytest.mark.parametrize("stated_first", [True, False])
def test_the_map_continues_after_a_restart_with_the_same_origin_id(stated_first: bool) -> None:
    rig = rig_with_map()
    before, map_id = rig.snapshot(), state_of(rig).map_id
    if stated_first:
        rig.say_epoch("tuesday", origin=ORIGIN, at=(3.0, 1.0, 0.5))
        reported = rig.snapshot()
        assert (reported.robot.x_m, reported.id.robot_boot_id) == (3.0, "")
        assert reported.occupied_m2 == before.occupied_m2
    rig.keyframe(frame_after_start(rig, "tuesday", ORIGIN))
    after = rig.snapshot()
    assert rig.acks[-1].accepted, rig.acks[-1].reason
    assert (state_of(rig).map_id, after.id.robot_boot_id) == (map_id, "tuesday")
    assert after.explored_m2 >= before.explored_m2
    assert after.version > before.version
    assert after.map_id == before.map_id == map_id
    assert rig.snapshot(if_newer=after.version).map_id == map_id


@pytest.mark.parametrize(
    ("before", "after", "epoch"),
    [(ORIGIN, "garage", 0), ("", "", 0), (ORIGIN, "", 0), ("", ORIGIN, 0), (ORIGIN, ORIGIN, 1)],
)
def test_another_or_no_origin_id_or_a_new_world_epoch_starts_a_new_map(
    before: str, after: str, epoch: int
) -> None:
    rig = rig_with_map(origin=before)
    old, map_id = rig.snapshot(), state_of(rig).map_id
    rig.say_epoch("tuesday", world_epoch=epoch, origin=after)
    rig.keyframe(frame_after_start(rig, "tuesday", after, epoch=epoch))
    assert rig.acks[-1].accepted
    assert state_of(rig).map_id != map_id == old.map_id
    assert rig.snapshot().map_id == state_of(rig).map_id
    assert rig.snapshot().explored_m2 < old.explored_m2


def test_a_robot_may_be_moved_while_it_is_off() -> None:
    rig = rig_with_map()
    far_m = 1.5 + 2 * MapRules().most_leap_m
    rig.say_epoch("tuesday", origin=ORIGIN, at=(far_m, 1.5, 0.0))
    frame = rig.walk.frame(far_m, 1.5, 0.0)
    id = replace(frame.id, robot_boot_id="tuesday")
    rig.keyframe(replace(frame, id=id, origin_id=ORIGIN))
    assert rig.acks[-1].accepted, rig.acks[-1].reason


def test_a_late_frame_of_an_earlier_start_is_refused_and_changes_nothing() -> None:
    rig = rig_with_map()
    late = frame_after_start(rig, "monday", ORIGIN)
    rig.say_epoch("tuesday", origin=ORIGIN)
    rig.keyframe(frame_after_start(rig, "tuesday", ORIGIN))
    before = rig.snapshot()
    rig.keyframe(late)
    assert not rig.acks[-1].accepted
    assert "an earlier start of the robot" in rig.acks[-1].reason
    assert rig.snapshot() == before


def test_views_count_after_a_restart_although_the_frame_numbers_begin_again() -> None:
    rig = rig_with_map()
    first = frame_after_start(rig, "monday", ORIGIN)
    again = frame_after_start(rig, "tuesday", ORIGIN, yaw=3.0)
    again = replace(again, id=replace(again.id, seq=first.id.seq))
    rig.observe(first, "first", {"pick": 0.3})
    rig.say_epoch("tuesday", origin=ORIGIN)
    rig.keyframe(again)
    before = rig.snapshot().values["pick"]
    rig.observe(again, "first", {"pick": 0.6})
    assert rig.acks[-1].accepted, rig.acks[-1].reason
    assert rig.snapshot().values["pick"] != before
    assert [view.id for view in state_of(rig).memory.snapshot()] == [first.id, again.id]
    version = rig.snapshot().version
    rig.observe(again, "first", {"pick": 0.6})
    assert rig.snapshot().version == version  # the same view counts once


def test_each_world_epoch_of_an_origin_has_its_own_map() -> None:
    rig = rig_with_map()
    old = state_of(rig).map_id
    rig.say_epoch("monday", world_epoch=1, origin=ORIGIN)
    rig.keyframe(frame_after_start(rig, "monday", ORIGIN, epoch=1))
    jumped = state_of(rig).map_id
    rig.keyframe(frame_after_start(rig, "tuesday", ORIGIN, epoch=0))
    assert rig.acks[-1].accepted, rig.acks[-1].reason
    assert state_of(rig).map_id == old
    rig.say_epoch("tuesday", world_epoch=1, origin=ORIGIN)
    rig.keyframe(frame_after_start(rig, "tuesday", ORIGIN, epoch=1))
    assert state_of(rig).map_id == jumped


def test_an_autosaved_map_is_restored_when_the_origin_id_is_the_same(tmp_path: Path) -> None:
    rig = rig_with_map(*autosave_flags(tmp_path))
    rig.service.close()
    again = Rig(*autosave_flags(tmp_path))
    again.say_epoch("tuesday", origin=ORIGIN, at=(1.0, 0.5, 0.0))
    one, other = state_of(rig).published, state_of(again).published
    assert (one.occupancy == other.occupancy).all()
    assert_same_memory(rig, again)
    assert "was restored" in again.health.state[1]
    assert again.snapshot().robot.x_m == pytest.approx(1.0)
    again.keyframe(frame_after_start(again, "tuesday", ORIGIN))
    assert again.acks[-1].accepted
    assert again.health.state == ("ready", "")
    again.service.close()
    third = Rig(*autosave_flags(tmp_path))
    third.say_epoch("wednesday", origin=ORIGIN)
    assert third.snapshot().occupied_m2 > 0


def assert_same_memory(one: Rig, other: Rig) -> None:
    views = [[v.id for v in state_of(rig).memory.snapshot()] for rig in (one, other)]
    assert views[0] == views[1]


def test_an_autosaved_map_of_another_origin_is_reported_as_unused(tmp_path: Path) -> None:
    rig = rig_with_map(*autosave_flags(tmp_path))
    rig.service.close()
    again = Rig(*autosave_flags(tmp_path))
    again.say_epoch("monday", origin="garage")
    assert again.snapshot().cell_m == 0
    assert "has other coordinates than the robot has now" in again.health.state[1]


@pytest.mark.parametrize("restarts", [True, False])
def test_a_robot_that_returns_to_an_earlier_origin_goes_on_with_its_stored_map(
    tmp_path: Path, restarts: bool
) -> None:
    flags = autosave_flags(tmp_path)
    home = rig_with_map(*flags)
    home.service.close()
    garage = Rig(*flags)
    garage.say_epoch("tuesday", origin="garage")
    for yaw in range(6):
        garage.keyframe(frame_after_start(garage, "tuesday", "garage", yaw=float(yaw)))
    assert "until the robot has found its place" in garage.health.state[1]
    back = garage
    if restarts:
        garage.service.close()
        back = Rig(*flags)
    back.say_epoch("wednesday", origin=ORIGIN)
    back.keyframe(frame_after_start(back, "wednesday", ORIGIN))
    assert_same_memory(home, back)
    assert back.snapshot().occupied_m2 == pytest.approx(home.snapshot().occupied_m2, rel=0.1)
    back.service.close()
    kept = Rig(*flags)
    kept.say_epoch("thursday", origin=ORIGIN)
    assert kept.snapshot().occupied_m2 > 0
    assert ("stored map" in kept.health.state[1]) is restarts  # the garage's
