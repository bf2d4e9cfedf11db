"""Stored objects of another world: kept apart until relocalised, then part of the present map."""

from __future__ import annotations

import errno
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import context_to_proto, observation_to_proto, state_to_proto
from helios_core.geometry import Matrix, se2_to_se3
from helios_core.health import Health
from helios_core.map_autosave import WriteOutcome
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import (
    CONTEXT,
    LOAD_OBJECTS,
    OBJECTS,
    OBSERVATION,
    RELOCALISATION,
    RESET_OBJECTS,
    RETIRE,
    ROBOT_STATE,
    SAVE_OBJECTS,
    STORED_OBJECTS,
)
from helios_core.types import FrameId, RobotState
from helios_objectmap import persistence
from helios_objectmap.epochs import EpochMaps
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.service import FILE_NAME, ObjectMapService
from objectmap_scene import CONTEXT as SOUGHT
from objectmap_scene import ROOM, SETTINGS, looking_at, mug_at, observe

MUG = (1.2, 0.0, 0.8)
SCENE = (*ROOM, mug_at(1.2, 0.0))
T_NOW_HOME = se2_to_se3(3.0, -2.0, math.pi / 2)
VIEWS = [(0.0, 0.0), (0.1, 0.3), (0.2, -0.3)]


class Robot:
    """An object map, and the robot that it listens to."""

    def __init__(self, boot: str, folder: Path | None = None, evidence: str = "views") -> None:
        hub = MemoryHub()
        self.boot, self.bus, self.health = boot, MemoryBus(hub), Health()
        kept = SETTINGS.model_copy(
            update={"state_dir": folder, "save_every_s": 3600.0, "evidence": evidence}
        )
        self.service = ObjectMapService(MemoryBus(hub), kept, self.health)
        self.tells(boot)
        self.bus.publish(CONTEXT, context_to_proto(SOUGHT))

    def tells(self, boot: str) -> None:
        """The robot reports its world, in which its next frames are."""
        self.boot = boot
        self.bus.publish(ROBOT_STATE, state_to_proto(RobotState(np.eye(4), robot_boot_id=boot)))

    def sees_nothing(self) -> None:
        """One frame in which the detector finds nothing."""
        self.see(np.eye(4), VIEWS[:1], called={})

    def see(
        self,
        T_now_home: Matrix,
        views: list[tuple[float, float]] = VIEWS,
        called: dict[int, str] | None = None,
    ) -> Robot:
        for seq, (x, y) in enumerate(views):
            seen = observe(SCENE, looking_at(x, y, MUG), seq=seq + 1, called=called)
            frame = replace(
                seen.frame,
                id=replace(seen.frame.id, robot_boot_id=self.boot),
                T_world_cam=T_now_home @ seen.frame.T_world_cam,
                T_world_base=T_now_home @ seen.frame.T_world_base,
            )
            self.bus.publish(OBSERVATION, observation_to_proto(replace(seen, frame=frame)))
        return self

    def objects(self) -> list[pb.ObjectInstance]:
        return list(self.bus.call(OBJECTS, pb.ObjectsRequest(), 5.0).objects)

    def mugs(self) -> list[pb.ObjectInstance]:
        return [o for o in self.objects() if o.class_name == "mug"]

    def stored(self) -> pb.StoredObjectsReply:
        return self.bus.call(STORED_OBJECTS, pb.Empty(), 5.0)

    def saved(self) -> bytes:
        return self.bus.call(SAVE_OBJECTS, pb.Empty(), 5.0).data

    def load(self, data: bytes, same_frame: bool = False) -> pb.ObjectMapLoaded:
        file = pb.ObjectMapFile(data=data, same_frame=same_frame)
        return self.bus.call(LOAD_OBJECTS, file, 5.0)

    def is_told(self, state: str, stored: str = "monday") -> None:
        """map2d publishes the place of the stored map."""
        place = pb.Relocalisation(
            state=state,
            stored=pb.WorldName(robot_boot_id=stored),
            present=pb.WorldName(robot_boot_id=self.boot),
        )
        if state != "unknown":
            x, y = T_NOW_HOME[:2, 3]
            place.T_present_stored.CopyFrom(pb.Pose2(x_m=x, y_m=y, yaw_rad=math.pi / 2))
        self.bus.publish(RELOCALISATION, place)


@pytest.fixture(scope="module")
def monday() -> Robot:
    return Robot("monday").see(np.eye(4))


def centre(thing: pb.ObjectInstance) -> list[float]:
    return [thing.center_m.x, thing.center_m.y, thing.center_m.z]


def test_objects_of_another_world_are_not_in_the_map_before_they_are_relocalised(
    monday: Robot,
) -> None:
    today = Robot("tuesday")
    assert today.load(monday.saved()).stored
    for state in ("unknown", "tentative"):
        today.is_told(state)
        assert not today.objects()
        reply = today.stored()
        assert reply.relocalisation.state == state
        assert {o.class_name for o in reply.objects} >= {"mug"}
    assert "stored objects are not in use" in today.service._said


@pytest.mark.parametrize("evidence", ["views", "hindsight"])
def test_relocalised_objects_join_the_present_map_in_its_frame(evidence: str) -> None:
    before = Robot("monday", evidence=evidence).see(np.eye(4))
    (old,) = before.mugs()
    today = Robot("tuesday", evidence=evidence)
    today.load(before.saved())
    today.see(T_NOW_HOME, [(0.3, 0.1)])
    assert not any(o.relocalised for o in today.objects())
    today.is_told("relocalised")
    (mug,) = today.mugs()  # one instance, although both maps have Gaussians of it
    assert mug.relocalised
    expected = T_NOW_HOME @ [*centre(old), 1.0]
    assert centre(mug) == pytest.approx(expected[:3].tolist(), abs=0.05)
    assert mug.views >= old.views
    assert mug.gaussians > old.gaussians
    assert not today.stored().objects


def test_the_stored_map_waits_for_the_first_frame_of_the_world(monday: Robot) -> None:
    today = Robot("tuesday")
    today.load(monday.saved())
    today.is_told("relocalised")
    assert not today.objects()
    today.see(T_NOW_HOME, VIEWS[:1])
    assert any(o.relocalised for o in today.mugs())


@pytest.mark.parametrize("wrong", ["stored", "present"])
def test_the_place_of_another_map_is_not_used(monday: Robot, wrong: str) -> None:
    today = Robot("tuesday").see(T_NOW_HOME, VIEWS[:1])
    today.load(monday.saved())
    if wrong == "present":
        today.boot = "wednesday"
    today.is_told("relocalised", "sunday" if wrong == "stored" else "monday")
    assert not any(o.relocalised for o in today.objects())
    assert today.stored().relocalisation.state == "unknown"


@pytest.mark.parametrize("x_m", [math.nan, math.inf, 1e9])
def test_a_place_that_is_not_finite_or_too_far_away_changes_nothing(
    monday: Robot, x_m: float
) -> None:
    today = Robot("tuesday")
    today.load(monday.saved())
    place = pb.Relocalisation(
        state="relocalised",
        stored=pb.WorldName(robot_boot_id="monday"),
        present=pb.WorldName(robot_boot_id="tuesday"),
        T_present_stored=pb.Pose2(x_m=x_m),
    )
    today.bus.publish(RELOCALISATION, place)
    today.see(T_NOW_HOME)
    assert not any(o.relocalised for o in today.objects())
    assert len(today.mugs()) == 1
    assert today.stored().objects


def test_a_stored_map_whose_addition_fails_is_tried_once(
    monday: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    today = Robot("tuesday")
    today.load(monday.saved())
    tries: list[int] = []

    def fails(*_: object) -> int:
        tries.append(1)
        raise MemoryError

    monkeypatch.setattr(ObjectMap, "add_stored", fails)
    today.is_told("relocalised")
    today.see(T_NOW_HOME)
    assert len(tries) == 1
    assert today.stored().objects


def test_names_of_a_stored_map_without_gaussians_come_with_it() -> None:
    before, here = ObjectMap(SETTINGS), ObjectMap(SETTINGS)
    before.set_context(SOUGHT)
    assert here.add_stored(before.content(), T_NOW_HOME) == 0
    assert here.content().roles == before.content().roles != {}


def test_an_observation_that_is_sent_twice_counts_once() -> None:
    once, twice = Robot("monday").see(np.eye(4)), Robot("monday")
    for view in VIEWS:
        twice.see(np.eye(4), VIEWS[: VIEWS.index(view) + 1])
    assert [m.views for m in twice.mugs()] == [m.views for m in once.mugs()]
    assert [m.score for m in twice.mugs()] == [m.score for m in once.mugs()]


def test_a_map_without_gaussians_comes_back_with_its_world() -> None:
    maps = EpochMaps(SETTINGS)
    home, away = (
        replace(observe(SCENE, looking_at(0.0, 0.0, MUG)).frame, id=FrameId(boot, 0, 1))
        for boot in ("monday", "tuesday")
    )
    maps.set_robot_world(home.world, "monday")
    empty = maps.map_for(home)
    assert maps.map_for(away) is not empty
    assert maps.map_for(home) is empty


def test_the_newest_frame_is_that_of_the_map_and_never_an_older_one(monday: Robot) -> None:
    robot = Robot("tuesday")
    robot.see(np.eye(4))
    assert robot.service._maps.newest == FrameId("tuesday", 0, 3)
    robot.service._maps.note_update(FrameId("tuesday", 0, 2))
    assert robot.service._maps.newest == FrameId("tuesday", 0, 3)
    robot.bus.call(RESET_OBJECTS, pb.Empty(), 5.0)
    assert robot.service._maps.newest is None


def test_a_relocalised_object_can_be_picked(monday: Robot) -> None:
    today = Robot("tuesday").see(T_NOW_HOME, VIEWS[:1])
    today.load(monday.saved())
    today.is_told("relocalised")
    (mug,) = today.mugs()
    assert today.bus.call(RETIRE, pb.RetireRequest(object_id=mug.id), 5.0).retired_gaussians > 0
    assert not today.mugs()


def test_the_objects_of_an_earlier_process_wait_on_the_disk(tmp_path: Path, monday: Robot) -> None:
    (tmp_path / FILE_NAME).write_bytes(monday.saved())
    first = Robot("tuesday", tmp_path).see(T_NOW_HOME, VIEWS[:1])
    first.service.close()
    assert (tmp_path / f"stored-{FILE_NAME}").exists()
    again = Robot("tuesday", tmp_path)
    assert again.stored().objects
    again.see(T_NOW_HOME, VIEWS[:1])
    again.is_told("relocalised")
    assert any(o.relocalised for o in again.mugs())
    assert not (tmp_path / f"stored-{FILE_NAME}").exists()


def test_a_reset_forgets_the_stored_objects(tmp_path: Path, monday: Robot) -> None:
    today = Robot("tuesday", tmp_path)
    today.load(monday.saved())
    today.bus.call(RESET_OBJECTS, pb.Empty(), 5.0)
    assert not today.stored().objects
    today.is_told("relocalised")
    assert not today.objects()


def stored_worlds(robot: Robot) -> list[str]:
    """Starts of the robot whose maps are stored, the newest first."""
    return [world.robot_boot_id for world in robot.service._stored._maps]


@pytest.mark.parametrize("change", ["stored", "used", "reset"])
def test_a_load_that_is_undone_brings_the_stored_maps_back(
    tmp_path: Path, monday: Robot, change: str
) -> None:
    """The gateway undoes it if map2d refuses its part of the file."""
    (tmp_path / FILE_NAME).write_bytes(monday.saved())
    Robot("sunday", tmp_path).see(T_NOW_HOME, VIEWS[:1]).service.close()
    today = Robot("tuesday", tmp_path).see(T_NOW_HOME, VIEWS[:1])
    assert stored_worlds(today) == ["sunday", "monday"]
    before, known = today.saved(), today.objects()
    if change == "reset":
        today.bus.call(RESET_OBJECTS, pb.Empty(), 5.0)
    else:
        other = Robot("friday").see(np.eye(4), VIEWS[:1]).saved()
        assert today.load(other, same_frame=change == "used").stored == (change == "stored")
    assert stored_worlds(today) == (["friday"] if change == "stored" else [])
    today.load(before, same_frame=True)
    assert stored_worlds(today) == ["sunday", "monday"]
    assert today.objects() == known
    again = Robot("tuesday", tmp_path)
    assert stored_worlds(again) == ["sunday", "monday"]
    again.is_told("unknown", "monday")
    assert again.stored().objects


def test_a_map_that_is_stored_is_decoded_once_and_written_while_the_map_answers(
    tmp_path: Path, monday: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    today = Robot("tuesday", tmp_path).see(T_NOW_HOME, VIEWS[:1])
    lock, read, locked = today.service._lock, persistence.read, []

    def noted(*args: Any) -> Any:
        locked.append(("read", lock.locked()))
        return read(*args)

    def write(path: Path, data: bytes) -> None:
        locked.append(("written", lock.locked()))

    monkeypatch.setattr(persistence, "read", noted)
    monkeypatch.setattr("helios_core.stored_map_file.write_file", write)
    assert today.load(monday.saved()).stored
    assert locked == [("read", False), ("written", False)]


def test_a_load_after_the_map_was_saved_again_forgets_the_stored_maps(monday: Robot) -> None:
    today = Robot("tuesday").see(T_NOW_HOME, VIEWS[:1])
    today.load(monday.saved())
    today.load(Robot("friday").see(np.eye(4), VIEWS[:1]).saved())
    assert stored_worlds(today) == ["friday"]
    today.load(today.saved(), same_frame=True)
    assert stored_worlds(today) == []


def test_the_objects_of_two_earlier_processes_wait_for_the_place_of_either(
    tmp_path: Path, monday: Robot
) -> None:
    """map2d keeps the map of an earlier process, or the one before if that is small."""
    (tmp_path / FILE_NAME).write_bytes(monday.saved())
    Robot("tuesday", tmp_path).see(T_NOW_HOME, VIEWS[:1]).service.close()
    today = Robot("wednesday", tmp_path).see(T_NOW_HOME, VIEWS[:1])
    today.is_told("unknown", "monday")
    assert today.stored().relocalisation.stored.robot_boot_id == "monday"
    today.is_told("unknown", "tuesday")
    assert today.stored().relocalisation.stored.robot_boot_id == "tuesday"
    today.is_told("relocalised", "monday")
    assert any(o.relocalised for o in today.mugs())
    assert not today.stored().objects


def test_the_older_of_two_stored_maps_survives_a_crash_after_the_newest_was_stored(
    tmp_path: Path, monday: Robot
) -> None:
    """The process dies before its first save, so the same map is put aside again."""
    (tmp_path / FILE_NAME).write_bytes(monday.saved())
    Robot("tuesday", tmp_path).see(T_NOW_HOME, VIEWS[:1]).service.close()
    kept = (tmp_path / FILE_NAME).read_bytes()
    for day in ("wednesday", "thursday"):
        Robot(day, tmp_path).see(T_NOW_HOME, VIEWS[:1])  # never saves
        assert (tmp_path / FILE_NAME).read_bytes() == kept
    today = Robot("friday", tmp_path).see(T_NOW_HOME, VIEWS[:1])
    today.is_told("unknown", "monday")
    assert today.stored().relocalisation.stored.robot_boot_id == "monday"
    assert today.stored().objects


def test_a_stored_map_that_goes_on_stays_on_the_disk_until_the_next_save(
    tmp_path: Path, monday: Robot
) -> None:
    stored = tmp_path / f"stored-{FILE_NAME}"
    stored.write_bytes(monday.saved())
    again = Robot("monday", tmp_path)
    assert again.mugs()
    assert stored.exists()
    kept = again.service._kept
    assert kept is not None
    assert kept.write()
    kept.write()
    assert not stored.exists()
    later = Robot("monday", tmp_path)
    assert later.mugs()
    assert not later.stored().objects


def test_a_stored_map_waits_for_a_frame_of_its_world_while_the_map_is_of_another(
    tmp_path: Path, monday: Robot
) -> None:
    """The robot tells its world before the first frame of it arrives."""
    stored = tmp_path / f"stored-{FILE_NAME}"
    stored.write_bytes(monday.saved())
    robot = Robot("sunday", tmp_path)
    robot.sees_nothing()
    robot.tells("monday")
    assert not robot.objects()
    assert robot.stored().objects
    robot.see(np.eye(4), VIEWS[:1])
    assert [o.id for o in robot.mugs()] == [o.id for o in monday.mugs()]
    assert not robot.stored().objects


def test_a_restored_map_of_another_world_keeps_the_stored_map_of_the_robots_world(
    tmp_path: Path, monday: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No frame has changed the restored map, because the only one of its world failed."""
    sunday = Robot("sunday").see(np.eye(4))
    (tmp_path / FILE_NAME).write_bytes(sunday.saved())
    (tmp_path / f"stored-{FILE_NAME}").write_bytes(monday.saved())
    robot = Robot("sunday", tmp_path)
    with monkeypatch.context() as broken:
        broken.setattr(ObjectMap, "update", lambda *_: 1 / 0)
        robot.see(np.eye(4), VIEWS[:1])
    assert robot.mugs()
    robot.tells("monday")
    assert robot.stored().objects
    robot.see(np.eye(4), VIEWS[:1])
    assert [o.id for o in robot.mugs()] == [o.id for o in monday.mugs()]


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    """The map of the service cannot be written until the patch is undone."""

    def no_room(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "no space left on the device")

    with monkeypatch.context() as patch:
        patch.setattr("helios_core.map_autosave.write_file", no_room)
        yield patch


@pytest.mark.parametrize("saved_by", ["the periodic save", "the end of the process"])
def test_the_file_of_a_relocalised_map_stays_while_the_disk_is_full(
    tmp_path: Path, monday: Robot, full_disk: pytest.MonkeyPatch, saved_by: str
) -> None:
    stored = tmp_path / f"stored-{FILE_NAME}"
    stored.write_bytes(monday.saved())
    today = Robot("tuesday", tmp_path).see(T_NOW_HOME, VIEWS[:1])
    today.is_told("relocalised")
    assert any(o.relocalised for o in today.mugs())
    assert stored.exists()
    full_disk.undo()
    kept = today.service._kept
    assert kept is not None
    if saved_by == "the periodic save":
        assert kept.write()
        kept.write()
    else:
        today.service.close()
    assert not stored.exists()
    again = Robot("tuesday", tmp_path)
    assert again.mugs() == today.mugs()


def test_a_stored_map_that_no_disk_had_room_for_is_written_with_a_later_save(
    tmp_path: Path, monday: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Until then its only file is that of the present map, which must stay."""

    def no_room(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "no space left on the device")

    stored, data = tmp_path / f"stored-{FILE_NAME}", monday.saved()
    (tmp_path / FILE_NAME).write_bytes(data)
    today = Robot("tuesday", tmp_path)
    today.service.warm_up()
    kept = today.service._kept
    assert kept is not None
    with monkeypatch.context() as full:
        full.setattr("helios_core.stored_map_file.write_file", no_room)
        today.see(T_NOW_HOME, VIEWS[:1])
        assert kept.write() is WriteOutcome.FAILED
    assert "no space left on the device; make room there" in today.health.state[1]
    assert (tmp_path / FILE_NAME).read_bytes() == data
    assert not stored.exists()
    assert kept.write()
    assert "no space left" not in today.health.state[1]
    assert stored.read_bytes() == data
    assert (tmp_path / FILE_NAME).read_bytes() != data


def test_stored_objects_that_cannot_be_used_are_told_and_stop_no_observation(
    tmp_path: Path, monday: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / FILE_NAME).write_bytes(monday.saved())
    today = Robot("tuesday", tmp_path)
    today.service.warm_up()
    today.see(T_NOW_HOME, VIEWS[:1])
    monkeypatch.setattr(ObjectMap, "add_stored", lambda *_: 1 / 0)
    today.is_told("relocalised", "monday")
    assert "stored objects cannot be used" in today.health.state[1]
    accepted = today.health.metrics()["observations_accepted"]
    today.see(T_NOW_HOME, VIEWS[1:2])
    assert today.health.metrics()["observations_accepted"] == accepted + 1
    today.service.close()
    assert (tmp_path / f"stored-{FILE_NAME}").exists()
