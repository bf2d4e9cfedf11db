"""A robot that restarts with the same origin id continues its object map."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import context_to_proto, observation_to_proto, state_to_proto
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import (
    CONTEXT,
    LOAD_OBJECTS,
    OBJECTMAP_ACK,
    OBJECTS,
    OBSERVATION,
    RESET_OBJECTS,
    ROBOT_STATE,
    SAVE_OBJECTS,
)
from helios_core.types import RobotState
from helios_objectmap.service import FILE_NAME, ObjectMapService
from objectmap_scene import CONTEXT as SOUGHT
from objectmap_scene import ROOM, SETTINGS, looking_at, mug_at, observe

MUG_CENTER = (1.2, 0.0, 0.8)
SCENE = (*ROOM, mug_at(1.2, 0.0))
ORIGIN = "kitchen-2026"


class Rig:
    """A service that autosaves its map in a folder, and a robot with an origin id."""

    def __init__(self, folder: Path | None = None) -> None:
        hub = MemoryHub()
        self.bus, self.health = MemoryBus(hub), Health()
        self.acks: list[pb.Ack] = []
        self.bus.subscribe(OBJECTMAP_ACK, self.acks.append)
        kept = SETTINGS.model_copy(update={"state_dir": folder, "save_every_s": 3600.0})
        self.service = ObjectMapService(MemoryBus(hub), kept, self.health)
        self.service.warm_up()
        self.bus.publish(CONTEXT, context_to_proto(SOUGHT))
        self._seq = 0

    def say(self, boot: str, origin: str, epoch: int = 0) -> None:
        state = RobotState(np.eye(4), robot_boot_id=boot, origin_id=origin, world_epoch=epoch)
        self.bus.publish(ROBOT_STATE, state_to_proto(state))

    def see(self, boot: str, origin: str, epoch: int = 0, y: float = 0.0, scene=SCENE) -> pb.Ack:
        self._seq += 1
        o = observe(scene, looking_at(0.0, y, MUG_CENTER), seq=self._seq, epoch=epoch)
        id = replace(o.frame.id, robot_boot_id=boot)
        o = replace(o, frame=replace(o.frame, id=id, origin_id=origin))
        self.bus.publish(OBSERVATION, observation_to_proto(o))
        return self.acks[-1]

    def ids(self) -> list[int]:
        return [o.id for o in self.bus.call(OBJECTS, pb.ObjectsRequest(), 5.0).objects]


def rig_with_map(folder: Path | None = None, origin: str = ORIGIN) -> Rig:
    rig = Rig(folder)
    rig.say("monday", origin)
    for y in (0.0, 0.3, -0.3):
        assert rig.see("monday", origin, y=y).accepted
    assert rig.ids()
    return rig


@pytest.mark.parametrize("stated_first", [True, False])
def test_the_map_continues_after_a_restart_with_the_same_origin_id(stated_first: bool) -> None:
    rig = rig_with_map()
    before = rig.ids()
    if stated_first:
        rig.say("tuesday", ORIGIN)
        assert rig.ids() == before
    assert rig.see("tuesday", ORIGIN).accepted
    assert rig.ids() == before


@pytest.mark.parametrize(
    ("before", "after", "epoch"),
    [(ORIGIN, "garage", 0), ("", "", 0), (ORIGIN, "", 0), ("", ORIGIN, 0), (ORIGIN, ORIGIN, 1)],
)
def test_another_or_no_origin_id_or_a_new_world_epoch_starts_a_new_map(
    before: str, after: str, epoch: int
) -> None:
    rig = rig_with_map(origin=before)
    rig.say("tuesday", after, epoch)
    assert rig.see("tuesday", after, epoch, scene=ROOM).accepted
    reply = rig.bus.call(OBJECTS, pb.ObjectsRequest(class_names=["mug"]), 5.0)
    assert not reply.objects


def test_a_late_frame_of_an_earlier_start_is_refused() -> None:
    rig = rig_with_map()
    rig.say("tuesday", ORIGIN)
    assert rig.see("tuesday", ORIGIN).accepted
    late = rig.see("monday", ORIGIN)
    assert not late.accepted
    assert "an earlier start of the robot" in late.reason


def test_each_world_epoch_of_an_origin_has_its_own_map() -> None:
    rig = rig_with_map()
    before = rig.ids()
    rig.say("monday", ORIGIN, 1)
    assert rig.see("monday", ORIGIN, 1, scene=ROOM).accepted
    assert rig.see("tuesday", ORIGIN, 0).accepted
    assert rig.ids() == before


def test_an_autosaved_map_is_restored_when_the_origin_id_is_the_same(tmp_path: Path) -> None:
    first = rig_with_map(tmp_path)
    first.service.close()
    again = Rig(tmp_path)
    assert again.ids() == first.ids()
    again.say("tuesday", ORIGIN)
    assert again.ids() == first.ids()
    assert "the map was restored as it was written at 20" in again.health.state[1]
    assert again.see("tuesday", ORIGIN, y=0.2).accepted
    assert again.health.state == ("ready", "")
    assert not again.see("monday", ORIGIN).accepted
    again.service.close()
    third = Rig(tmp_path)
    third.say("wednesday", ORIGIN)
    assert third.ids() == first.ids()


def restarted_elsewhere(folder: Path) -> Rig:
    rig_with_map(folder).service.close()
    again = Rig(folder)
    assert "was restored" in again.health.state[1]
    again.say("tuesday", "garage")
    return again


def test_an_autosaved_map_of_another_world_is_reported_as_unused_until_a_new_map_starts(
    tmp_path: Path,
) -> None:
    again = restarted_elsewhere(tmp_path)
    assert not again.ids()
    said = again.health.state[1]
    assert "has other coordinates than the robot has now" in said
    assert "restored" not in said
    assert again.see("tuesday", "garage").accepted
    said = again.health.state[1]
    assert said == "stored objects are not in use until the robot has found its place"


def test_a_robot_state_of_another_world_right_after_the_map_was_read_is_reported(
    tmp_path: Path,
) -> None:
    """The robot's state can arrive between the reading of the map and the end of the start."""
    rig_with_map(tmp_path).service.close()
    said: list[str] = []

    class StateWhenRead(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if "Gaussians read" in record.getMessage():
                said.append(record.getMessage())
                state = RobotState(np.eye(4), robot_boot_id="tuesday", origin_id="garage")
                hub_bus.publish(ROBOT_STATE, state_to_proto(state))

    hub = MemoryHub()
    hub_bus, health = MemoryBus(hub), Health()
    handler, log = StateWhenRead(), logging.getLogger("helios_objectmap.service")
    was = log.level
    log.setLevel(logging.INFO)
    log.addHandler(handler)
    try:
        settings = SETTINGS.model_copy(update={"state_dir": tmp_path, "save_every_s": 3600.0})
        service = ObjectMapService(MemoryBus(hub), settings, health)
        service.warm_up()
    finally:
        log.removeHandler(handler)
        log.setLevel(was)
    assert said
    assert "has other coordinates than the robot has now" in health.state[1]


@pytest.mark.parametrize("elsewhere", [True, False])
@pytest.mark.parametrize("supersede", ["load", "reset"])
def test_health_stops_mentioning_an_autosaved_map_after_a_load_or_reset(
    tmp_path: Path, elsewhere: bool, supersede: str
) -> None:
    if elsewhere:
        again = restarted_elsewhere(tmp_path)
    else:
        rig_with_map(tmp_path).service.close()
        again = Rig(tmp_path)
    assert again.health.state[1]
    if supersede == "load":
        file = rig_with_map().bus.call(SAVE_OBJECTS, pb.Empty(), 5.0)
        file.same_frame = True
        again.bus.call(LOAD_OBJECTS, file, 5.0)
    else:
        again.bus.call(RESET_OBJECTS, pb.Empty(), 5.0)
    assert again.health.state == ("ready", "")


def test_a_reset_map_is_not_restored_after_a_kill(tmp_path: Path) -> None:
    first = rig_with_map(tmp_path)
    assert first.service._kept is not None
    assert first.service._kept.write()
    first.bus.call(RESET_OBJECTS, pb.Empty(), 5.0)
    assert not first.ids()
    assert not (tmp_path / FILE_NAME).exists()
    again = Rig(tmp_path)  # the first service is never closed, as after a kill
    again.say("monday", ORIGIN)
    assert not again.ids()
