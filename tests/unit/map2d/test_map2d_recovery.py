"""The map that is kept from crashes: what a killed service knows again, and what it says."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from helios_core import proto as pb
from helios_core.map_autosave import AutosavedFile
from helios_core.map_snapshot import decode_snapshot
from helios_core.topics import MAP_CHANGES, PICTURE, RESET_MAP2D
from helios_map2d.files.map_file import FILE_NAME
from map2d_kept import assert_same_state, load, saved, state_of, walked
from map2d_rig import Rig


def kept(tmp_path: Path) -> tuple[str, ...]:
    return "--state-dir", str(tmp_path), "--keep-period-s", "3600"


def persistence(rig: Rig) -> AutosavedFile:
    found = rig.service._keeping._kept
    assert found is not None
    return found


def test_a_killed_service_goes_on_with_its_map_when_the_robot_is_still_in_its_world(
    tmp_path: Path,
) -> None:
    rig = walked(*kept(tmp_path))
    assert persistence(rig).write()
    assert not persistence(rig).write()  # nothing has changed
    before = rig.snapshot()
    again = Rig(*kept(tmp_path))  # the first one is never closed: it was killed
    assert again.snapshot().cell_m == 0  # it may be another world
    assert again.health.state == ("ready", "")
    again.say_epoch("boot")
    assert_same_state(state_of(rig), state_of(again))
    reported = again.snapshot()
    assert (reported.id, reported.robot, reported.occupancy) == (
        before.id,
        before.robot,
        before.occupancy,
    )
    assert (
        reported.version > before.version + 1000
    )  # higher than any that the dead one may have told
    said = again.health.state[1]
    newest = state_of(rig).published.frame_id
    assert newest is not None
    assert re.search(
        r"was restored as it was written at \d{4}(-\d\d){2} \d\d(:\d\d){2}: \d+ m² known, 12 views",
        said,
    )
    assert said.endswith(f"frames up to number {newest.seq}")
    again.search("first")
    assert_same_state(state_of(rig), state_of(again))
    assert again.health.state == ("ready", said)
    again.keyframe(rig.walk.frame(2.0, 1.5, 0.1))
    assert again.acks[-1].accepted
    assert again.health.state == ("ready", "")  # it is another map now


def test_a_kept_map_of_another_world_is_not_used(tmp_path: Path) -> None:
    rig = walked(*kept(tmp_path))
    rig.service.close()
    again = Rig(*kept(tmp_path))
    again.say_epoch("another boot")
    assert again.snapshot().cell_m == 0
    assert "is of another world and is not used" in again.health.state[1]
    frame = again.walk.frame(2.0, 1.5, 0.0)
    again.keyframe(replace(frame, id=replace(frame.id, robot_boot_id="another boot")))
    assert again.snapshot().version > rig.snapshot().version
    assert "is of another world and is not used" in again.health.state[1]  # a glance would miss it
    again.search("first")
    again.observe(replace(frame, id=replace(frame.id, robot_boot_id="another boot")), "first")
    assert again.acks[-1].accepted, again.acks[-1].reason
    assert again.health.state == ("ready", "")  # as the object map says it


@pytest.mark.parametrize("supersede", ["load", "reset"])
@pytest.mark.parametrize("boot", ["boot", "another boot"])
def test_what_is_said_of_a_kept_map_ends_with_it(tmp_path: Path, boot: str, supersede: str) -> None:
    rig = walked(*kept(tmp_path))
    rig.service.close()
    again = Rig(*kept(tmp_path))
    again.say_epoch(boot)
    assert again.health.state[1]
    if supersede == "load":
        load(again, saved(rig, "map"))
    else:
        again.bus.call(RESET_MAP2D, pb.Empty(), 5)
    assert again.health.state == ("ready", "")


@pytest.mark.parametrize("damage", ["cut", "changed", "foreign", "empty"])
def test_a_damaged_kept_map_is_put_aside_and_reported(tmp_path: Path, damage: str) -> None:
    rig = walked(*kept(tmp_path))
    rig.service.close()
    path = tmp_path / FILE_NAME
    data = path.read_bytes()
    bad = {"cut": data[:-100], "changed": data[:-5] + b"12345", "foreign": b"\x7fELF" * 100,
           "empty": b""}[damage]  # fmt: skip
    path.write_bytes(bad)
    again = Rig(*kept(tmp_path))
    state, reason = again.health.state
    assert state == "ready"
    assert "put aside as" in reason
    (aside,) = tmp_path.glob("*.refused-*")
    assert aside.read_bytes() == bad
    again.say_epoch("boot")
    again.keyframe(again.walk.frame(2.0, 1.5, 0.0))
    assert again.acks[-1].accepted
    again.service.close()
    assert path.read_bytes().startswith(b"helios map2d")


def test_a_state_directory_that_cannot_be_written_is_reported_and_ends_nothing(
    tmp_path: Path,
) -> None:
    (tmp_path / "file").write_text("no directory")
    rig = walked(*kept(tmp_path / "file"))
    assert not persistence(rig).write()
    assert "cannot be" in rig.health.state[1]
    rig.keyframe(rig.walk.frame(2.0, 1.5, 0.1))
    assert rig.acks[-1].accepted


def test_a_frame_of_its_world_brings_a_kept_map_back_before_the_robot_says_where_it_is(
    tmp_path: Path,
) -> None:
    rig = walked(*kept(tmp_path))
    rig.service.close()
    again = Rig(*kept(tmp_path))
    again.keyframe(rig.walk.frame(2.0, 1.5, 0.1))
    assert again.acks[-1].accepted
    assert again.snapshot().occupied_m2 >= 0.9 * rig.snapshot().occupied_m2


@pytest.mark.parametrize("kind", ["map", "npz", "ros"])
def test_a_loaded_map_is_reported_at_once_with_the_robot_where_it_says_that_it_is(
    kind: str,
) -> None:
    rig, other = walked(), Rig()
    other.say_epoch("another boot", at=(1.0, 0.5, 0.3))
    load(other, saved(rig, kind))
    reported, before = decode_snapshot(other.snapshot()), decode_snapshot(rig.snapshot())
    assert reported.robot_pose == pytest.approx((1.0, 0.5, 0.3))
    assert reported.frame_id.robot_boot_id == ""  # no frame of this world yet
    assert reported.occupied_m2 == pytest.approx(before.occupied_m2)
    assert reported.origin_m == pytest.approx(before.origin_m)
    assert (reported.occupancy == before.occupancy).all()
    assert reported.frontiers
    changes = other.bus.call(MAP_CHANGES, pb.MapChangesRequest(), 5)
    assert (changes.robot.x_m, len(changes.tiles) > 0) == (1.0, True)
    assert other.bus.call(PICTURE, pb.PictureRequest(), 5).png


def test_a_map_that_is_loaded_in_mid_run_leaves_the_robot_where_its_newest_frame_says() -> None:
    rig = walked()
    files = saved(rig, "map")
    rig.keyframe(rig.walk.frame(2.3, 1.2, 0.5))
    before, newest = rig.snapshot(), rig.acks[-1].id.seq
    load(rig, files)
    after = rig.snapshot()
    assert (after.robot, after.id) == (before.robot, before.id)
    assert after.version > before.version
    rig.keyframe(rig.walk.frame(2.3, 1.2, 0.7))
    assert rig.acks[-1].accepted
    assert rig.snapshot().id.seq > newest


def test_a_loaded_map_that_no_frame_has_come_to_yet_survives_a_kill(tmp_path: Path) -> None:
    rig = Rig(*kept(tmp_path))
    rig.say_epoch("boot", at=(1.0, 0.5, 0.0))
    load(rig, saved(walked(), "ros"))
    assert persistence(rig).write()
    again = Rig(*kept(tmp_path))
    again.say_epoch("boot", at=(1.2, 0.5, 0.0))
    assert again.snapshot().occupancy == rig.snapshot().occupancy
    assert again.snapshot().robot.x_m == pytest.approx(1.2)
    again.keyframe(again.walk.frame(2.0, 1.5, 0.0))
    assert again.acks[-1].accepted


def test_what_was_forgotten_on_purpose_does_not_come_back_after_a_kill(tmp_path: Path) -> None:
    rig = walked(*kept(tmp_path))
    assert persistence(rig).write()
    rig.bus.call(RESET_MAP2D, pb.Empty(), 5)
    again = Rig(*kept(tmp_path))
    again.say_epoch("boot")
    assert again.snapshot().cell_m == 0


def test_who_knows_a_version_of_an_earlier_process_is_told_the_whole_map() -> None:
    rig = walked()
    assert rig.snapshot(if_newer=rig.snapshot().version).unchanged
    assert not rig.snapshot(if_newer=10**6).unchanged


def test_a_search_that_is_under_way_learns_from_the_views_of_a_loaded_map() -> None:
    rig, other = walked(), Rig()
    other.scorer.serve(other.bus)
    other.say_epoch("another boot")
    other.search("tea", {"pick": "a teapot"})
    load(other, saved(rig, "map"))
    rig.scorer.serve(rig.bus)
    rig.search("tea", {"pick": "a teapot"})
    assert rig.snapshot().values["pick"] == other.snapshot().values["pick"]
    assert decode_snapshot(other.snapshot()).values["pick"].max() > 0
