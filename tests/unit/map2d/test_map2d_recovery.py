"""The autosaved 2D map: what a killed service restores, and what it reports."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helios_core import proto as pb
from helios_core.map_autosave import AutosavedFile
from helios_core.map_snapshot import decode_snapshot
from helios_core.topics import MAP_CHANGES, PICTURE, RELOCALISATION, RESET_MAP2D, SNAPSHOT
from helios_core.viewing.newest_map import newest_snapshot
from helios_map2d.files import persistence
from helios_map2d.files.map_file import FILE_NAME, encode_map
from helios_map2d.snapshots.snapshot import MapSnapshot
from map2d_kept import assert_same_state, load, saved, state_of, walked
from map2d_rig import Rig


def autosave_flags(tmp_path: Path) -> tuple[str, ...]:
    return "--state-dir", str(tmp_path), "--keep-period-s", "3600"


def autosaved_file(rig: Rig) -> AutosavedFile:
    found = rig.service._keeping._kept
    assert found is not None
    return found


def test_a_killed_service_restores_its_map_when_the_robot_is_still_in_the_same_world(
    tmp_path: Path,
) -> None:
    rig = walked(*autosave_flags(tmp_path))
    assert autosaved_file(rig).write()
    assert not autosaved_file(rig).write()  # nothing has changed
    before = rig.snapshot()
    again = Rig(*autosave_flags(tmp_path))  # the first service is never closed, as after a kill
    assert again.snapshot().cell_m == 0  # the robot may be in another world
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
    )  # above every version that the killed service may have published
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
    assert again.health.state == ("ready", "")  # the map has changed since


def test_an_unchanged_map_is_not_encoded_again_for_the_next_autosave(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoded: list[int] = []

    def counted(published: MapSnapshot, *args: Any) -> bytes:
        encoded.append(published.version)
        return encode_map(published, *args)

    monkeypatch.setattr(persistence, "encode_map", counted)
    rig = Rig(*autosave_flags(tmp_path))
    rig.say_epoch("boot")
    assert not autosaved_file(rig).write()  # there is no map
    rig.settle()
    assert autosaved_file(rig).write()
    for _ in range(3):
        assert not autosaved_file(rig).write()
    first = rig.snapshot().version
    assert encoded == [first]
    rig.keyframe(rig.walk.frame(2.0, 1.5, 0.1))
    assert autosaved_file(rig).write()
    assert encoded == [first, rig.snapshot().version]
    rig.bus.call(RESET_MAP2D, pb.Empty(), 5)
    assert not autosaved_file(rig).write()


def test_an_autosaved_map_of_another_world_is_not_used(tmp_path: Path) -> None:
    rig = walked(*autosave_flags(tmp_path))
    rig.service.close()
    again = Rig(*autosave_flags(tmp_path))
    again.say_epoch("another boot")
    assert again.snapshot().cell_m == 0
    assert "has other coordinates than the robot has now" in again.health.state[1]
    frame = again.walk.frame(2.0, 1.5, 0.0)
    again.keyframe(replace(frame, id=replace(frame.id, robot_boot_id="another boot")))
    assert again.snapshot().version > rig.snapshot().version
    # The note stays for now: a glance would miss a brief one.
    assert "has other coordinates than the robot has now" in again.health.state[1]
    again.search("first")
    again.observe(replace(frame, id=replace(frame.id, robot_boot_id="another boot")), "first")
    assert again.acks[-1].accepted, again.acks[-1].reason
    said = again.health.state[1]
    assert said == "a stored map is not in use until the robot has found its place in it"


@pytest.mark.parametrize("supersede", ["load", "reset"])
@pytest.mark.parametrize("boot", ["boot", "another boot"])
def test_health_stops_mentioning_an_autosaved_map_after_a_load_or_reset(
    tmp_path: Path, boot: str, supersede: str
) -> None:
    rig = walked(*autosave_flags(tmp_path))
    rig.service.close()
    again = Rig(*autosave_flags(tmp_path))
    again.say_epoch(boot)
    assert again.health.state[1]
    if supersede == "load":
        load(again, saved(rig, "map"))
    else:
        again.bus.call(RESET_MAP2D, pb.Empty(), 5)
    assert again.health.state == ("ready", "")


@pytest.mark.parametrize("damage", ["cut", "changed", "foreign", "empty"])
def test_a_damaged_autosaved_map_is_moved_aside_and_reported(tmp_path: Path, damage: str) -> None:
    rig = walked(*autosave_flags(tmp_path))
    rig.service.close()
    path = tmp_path / FILE_NAME
    data = path.read_bytes()
    bad = {
        "cut": data[:-100],
        "changed": data[:-5] + b"12345",
        "foreign": b"\x7fELF" * 100,
        "empty": b"",
    }[damage]
    path.write_bytes(bad)
    again = Rig(*autosave_flags(tmp_path))
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


def test_an_unwritable_state_folder_is_reported_and_the_service_continues(
    tmp_path: Path,
) -> None:
    (tmp_path / "file").write_text("no directory")
    rig = walked(*autosave_flags(tmp_path / "file"))
    assert not autosaved_file(rig).write()
    assert "cannot be" in rig.health.state[1]
    rig.keyframe(rig.walk.frame(2.0, 1.5, 0.1))
    assert rig.acks[-1].accepted


def test_a_frame_of_the_same_world_restores_an_autosaved_map_before_any_robot_state(
    tmp_path: Path,
) -> None:
    rig = walked(*autosave_flags(tmp_path))
    rig.service.close()
    again = Rig(*autosave_flags(tmp_path))
    again.keyframe(rig.walk.frame(2.0, 1.5, 0.1))
    assert again.acks[-1].accepted
    assert again.snapshot().occupied_m2 >= 0.9 * rig.snapshot().occupied_m2


@pytest.mark.parametrize("kind", ["map", "npz", "ros"])
def test_a_loaded_map_is_published_at_once_with_the_robots_reported_pose(
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


def test_loading_a_map_during_a_run_keeps_the_robot_pose_of_the_newest_frame() -> None:
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


def test_a_loaded_map_without_any_frame_yet_survives_a_kill(tmp_path: Path) -> None:
    rig = Rig(*autosave_flags(tmp_path))
    rig.say_epoch("boot", at=(1.0, 0.5, 0.0))
    load(rig, saved(walked(), "ros"))
    assert autosaved_file(rig).write()
    again = Rig(*autosave_flags(tmp_path))
    again.say_epoch("boot", at=(1.2, 0.5, 0.0))
    assert again.snapshot().occupancy == rig.snapshot().occupancy
    assert again.snapshot().robot.x_m == pytest.approx(1.2)
    again.keyframe(again.walk.frame(2.0, 1.5, 0.0))
    assert again.acks[-1].accepted


def test_a_reset_map_is_not_restored_after_a_kill(tmp_path: Path) -> None:
    rig = walked(*autosave_flags(tmp_path))
    assert autosaved_file(rig).write()
    rig.bus.call(RESET_MAP2D, pb.Empty(), 5)
    again = Rig(*autosave_flags(tmp_path))
    again.say_epoch("boot")
    assert again.snapshot().cell_m == 0


def test_a_client_with_a_version_of_an_earlier_process_gets_the_whole_map() -> None:
    rig = walked()
    assert rig.snapshot(if_newer=rig.snapshot().version).unchanged
    assert not rig.snapshot(if_newer=10**6).unchanged


def test_a_client_gets_the_whole_map_of_a_new_process_that_has_reached_the_same_version() -> None:
    before, other = walked().snapshot(), walked()
    assert other.snapshot().version == before.version
    newest = newest_snapshot(
        lambda request: other.bus.call(SNAPSHOT, request, 5), before.version, before.map_id
    )
    assert newest == other.snapshot()
    assert newest.map_id != before.map_id


def test_a_reset_and_a_load_are_announced_after_the_map_has_changed() -> None:
    """Recorders and viewers then poll the map."""
    rig = walked()
    files, announced = saved(rig, "map"), []
    rig.bus.subscribe(RELOCALISATION, lambda _: announced.append(rig.snapshot().width > 0))
    announced.clear()
    rig.bus.call(RESET_MAP2D, pb.Empty(), 5)
    assert announced == [False]
    load(rig, files)
    assert announced == [False, True]


def test_a_running_search_uses_the_views_of_a_loaded_map() -> None:
    rig, other = walked(), Rig()
    other.scorer.serve(other.bus)
    other.say_epoch("another boot")
    other.search("tea", {"pick": "a teapot"})
    load(other, saved(rig, "map"))
    rig.scorer.serve(rig.bus)
    rig.search("tea", {"pick": "a teapot"})
    assert rig.snapshot().values["pick"] == other.snapshot().values["pick"]
    assert decode_snapshot(other.snapshot()).values["pick"].max() > 0
