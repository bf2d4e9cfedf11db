"""A stored map of another world: sought in the present frame, and taken over once it is found."""

from __future__ import annotations

import errno
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import frame_to_proto
from helios_core.errors import Unavailable
from helios_core.geometry import Matrix, invert, se2_to_se3
from helios_core.map_autosave import WriteOutcome
from helios_core.map_snapshot import OCCUPIED, UNKNOWN, decode_snapshot
from helios_core.topics import FRAME, RECALL, RELOCALISATION, RESET_MAP2D
from helios_core.types import Frame
from map2d_kept import load, saved
from map2d_rig import Rig
from map2d_scene import Block, Walk, chair, room, table

HOME = [
    *room(6.0, 5.0),
    *table(1.2, 1.0, 1.4, 0.9),
    *chair(2.3, 4.2),
    *table(5.2, 3.4, 0.7, 1.6),
    Block((3.0, 0.0, 0.0), (3.1, 1.6, 2.5)),
    Block((0.0, 3.2, 0.0), (0.6, 4.6, 1.2)),
    Block((4.2, 0.0, 0.0), (5.6, 0.5, 0.9)),
]
OTHER = [*room(4.0, 7.0), *table(2.0, 5.0, 1.6, 0.7), Block((0.0, 1.0, 0.0), (1.5, 1.2, 2.5))]
T_NOW_HOME = se2_to_se3(4.0, -7.0, 2.2)  # the present frame: turned, and shifted by metres
WAIT_S = 60.0


def in_frame(frame: Frame, T_now_home: Matrix, boot: str) -> Frame:
    """The frame as a robot with another origin reports it."""
    return replace(
        frame,
        id=replace(frame.id, robot_boot_id=boot),
        T_world_cam=T_now_home @ frame.T_world_cam,
        T_world_base=T_now_home @ frame.T_world_base,
    )


def look(
    rig: Rig,
    places: Iterable[tuple[float, float]],
    blocks: Sequence[Block],
    boot: str,
    T_now_home: Matrix,
    most: int = 12,
) -> None:
    """Look around at places, at most `most` frames at each; wait for each attempt that becomes
    due."""
    rig.walk = Walk(list(blocks), seq=rig.walk.seq)
    for x, y in places:
        for frame in rig.walk.look_around(x, y)[:most]:
            rig.keyframe(in_frame(frame, T_now_home, boot))
            assert rig.service.places_settled(WAIT_S)


@pytest.fixture(scope="module")
def home_file() -> list[pb.Map2DFile]:
    """Map of the home."""
    first = Rig()
    first.scorer.serve(first.bus)
    first.say_epoch("monday")
    first.search("first")
    look(first, [(2.0, 2.2), (4.5, 2.0), (1.5, 4.0), (4.0, 4.2)], HOME, "monday", np.eye(4))
    seen = in_frame(first.walk.frame(2.0, 2.2, 0.0), np.eye(4), "monday")
    first.observe(seen, "first", {"pick": 0.3})
    return saved(first, "map")


def started(*flags: str) -> tuple[Rig, list[pb.Relocalisation]]:
    """A robot that started elsewhere, and what is published about its place."""
    rig, told = Rig(*flags), []
    rig.bus.subscribe(RELOCALISATION, told.append)
    rig.say_epoch("tuesday")
    rig.search("second")
    return rig, told


def test_a_loaded_map_is_used_once_the_robot_has_found_its_place(
    home_file: list[pb.Map2DFile],
) -> None:
    rig, told = started()
    assert load(rig, home_file, same_frame=False).stored
    assert told[-1].state == "unknown"
    assert rig.snapshot().cell_m == 0  # nothing of the stored map is in use
    assert "not in use until the robot has found its place" in rig.health.state[1]
    look(rig, [(4.2, 2.5), (3.9, 3.4)], HOME, "tuesday", T_NOW_HOME)
    states = [t.state for t in told if t.state not in ("", "unknown")]
    assert states == ["tentative", "relocalised"]
    place = told[-1]
    assert place.state == "relocalised"
    T = place.T_present_stored
    error = invert(T_NOW_HOME) @ se2_to_se3(T.x_m, T.y_m, T.yaw_rad)
    assert np.hypot(*error[:2, 3]) < 0.1
    assert abs(math.atan2(error[1, 0], error[0, 0])) < math.radians(2)
    # The robot never saw the corner behind the wall, but the map knows it.
    view = decode_snapshot(rig.snapshot())
    column, row = (np.array((T_NOW_HOME @ [1.2, 2.2, 0, 1])[:2]) - view.origin_m) / view.cell_m
    assert view.occupancy[int(row), int(column)] not in (UNKNOWN, OCCUPIED)
    assert "stored map" not in rig.health.state[1]


def test_stream_frames_start_no_attempt_to_relocalise(home_file: list[pb.Map2DFile]) -> None:
    rig, told = started("--integrate-stream")
    load(rig, home_file, same_frame=False)
    rig.walk = Walk(HOME)
    for frame in rig.walk.look_around(4.2, 2.5):
        rig.bus.publish(FRAME, frame_to_proto(in_frame(frame, T_NOW_HOME, "tuesday")))
    assert rig.service.places_settled(WAIT_S)
    assert told[-1].attempts == 0
    assert rig.health.metrics()["stream_frames"] == 12


def test_past_views_of_a_stored_map_are_searched_once_it_is_relocalised(
    home_file: list[pb.Map2DFile],
) -> None:
    rig, _ = started()
    rig.scorer.serve(rig.bus)
    load(rig, home_file, same_frame=False)
    asked = pb.RecallRequest(prompt="a teapot", most_places=5)
    look(rig, [(4.2, 2.5)], HOME, "tuesday", T_NOW_HOME, most=3)
    with pytest.raises(Unavailable, match="no view has been kept"):
        rig.bus.call(RECALL, asked, 5)
    look(rig, [(3.9, 3.4), (2.2, 2.4)], HOME, "tuesday", T_NOW_HOME)
    found = rig.bus.call(RECALL, asked, 5)
    assert found.views == 1
    at = T_NOW_HOME @ [2.0, 2.2, 0.0, 1.0]
    camera = found.places[0].camera
    assert (camera.x_m, camera.y_m) == pytest.approx(at[:2].tolist(), abs=0.1)


def test_in_another_home_the_stored_map_stays_unknown(home_file: list[pb.Map2DFile]) -> None:
    rig, told = started()
    load(rig, home_file, same_frame=False)
    look(rig, [(2.0, 3.0), (2.5, 5.9)], OTHER, "tuesday", T_NOW_HOME)
    assert told[-1].attempts == 8
    assert {t.state for t in told} == {"", "unknown"}
    assert told[-1].reason


def test_the_map_of_an_earlier_process_is_sought_and_survives_on_the_disk(
    tmp_path: Path, home_file: list[pb.Map2DFile]
) -> None:
    (tmp_path / "map2d.map").write_bytes(home_file[0].data)
    flags = ("--state-dir", str(tmp_path), "--keep-period-s", "3600")
    rig, told = started(*flags)
    assert told[-1].state == "unknown"
    look(rig, [(4.2, 2.5)], HOME, "tuesday", T_NOW_HOME, most=3)
    rig.service.close()  # before the place is confirmed
    assert (tmp_path / "stored-map2d.map").read_bytes() == home_file[0].data
    later, told = started(*flags)  # goes on in the same world
    assert told[-1].state == "unknown"
    look(later, [(3.9, 3.4), (2.2, 2.4)], HOME, "tuesday", T_NOW_HOME)
    assert told[-1].state == "relocalised"
    assert not (tmp_path / "stored-map2d.map").exists()


def test_a_stored_map_that_no_disk_had_room_for_is_written_with_a_later_save(
    tmp_path: Path, home_file: list[pb.Map2DFile], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Until then its only file is that of the present map, which must stay."""

    def no_room(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "no space left on the device")

    present, stored = tmp_path / "map2d.map", tmp_path / "stored-map2d.map"
    present.write_bytes(home_file[0].data)
    with monkeypatch.context() as full:
        full.setattr("helios_core.stored_map_file.write_file", no_room)
        rig, _ = started("--state-dir", str(tmp_path), "--keep-period-s", "3600")
        look(rig, [(4.2, 2.5)], HOME, "tuesday", T_NOW_HOME, most=1)
        kept = rig.service._keeping._kept
        assert kept is not None
        assert kept.write() is WriteOutcome.FAILED
    assert "no space left on the device; make room there" in rig.health.state[1]
    assert present.read_bytes() == home_file[0].data
    assert not stored.exists()
    assert kept.write()
    assert "no space left" not in rig.health.state[1]
    assert stored.read_bytes() == home_file[0].data
    assert present.read_bytes() != home_file[0].data


def test_a_map_of_the_present_world_replaces_at_once(home_file: list[pb.Map2DFile]) -> None:
    rig = Rig()
    rig.say_epoch("monday")
    assert not load(rig, home_file, same_frame=False).stored
    assert rig.snapshot().occupied_m2 > 1


def test_a_reset_forgets_the_stored_map(home_file: list[pb.Map2DFile]) -> None:
    rig, told = started()
    load(rig, home_file, same_frame=False)
    rig.bus.call(RESET_MAP2D, pb.Empty(), 5)
    assert told[-1].state == ""
    assert rig.health.state == ("ready", "")
