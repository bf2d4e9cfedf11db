"""The recorded detector: the same answers, and the same retirements after the same frames."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import (
    CONTEXT,
    KEYFRAME,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    OBSERVATION,
    RETIRE,
    RETIRED,
)
from helios_replay.format_detection import open_source
from helios_replay.recorded_detector import RecordedDetector

from tests.unit.recorder.recorder_bus import CONTEXT_ID, Recorded, context, frame


class Played:
    """The recorded detector on a bus with a stub object map that notes what it receives."""

    def __init__(self, folder: Path) -> None:
        self.hub = MemoryHub()
        self.bus = MemoryBus(self.hub)
        self.reported: list[str] = []
        self.refused: list[str] = []
        self.observations: list[pb.Observation] = []
        self.bus.subscribe(OBSERVATION, self._observe)
        self.bus.subscribe(MAP2D_ACK, self._note_refusal)
        self.bus.subscribe(OBJECTMAP_ACK, self._note_refusal)
        self.bus.serve(RETIRE, self._retire)
        self.detector = RecordedDetector(MemoryBus(self.hub), folder, Health())

    def show(self, message: pb.Frame) -> None:
        self.bus.publish(KEYFRAME, message)

    def _observe(self, observation: pb.Observation) -> None:
        self.observations.append(observation)
        self.reported.append(f"saw {observation.frame.id.seq}")
        ack = pb.Ack(service="objectmap", part="objects", id=observation.frame.id, accepted=True)
        self.bus.publish(OBJECTMAP_ACK, ack)

    def _retire(self, request: pb.RetireRequest) -> pb.RetireReply:
        self.reported.append(f"retired {request.object_id}")
        return pb.RetireReply()

    def _note_refusal(self, ack: pb.Ack) -> None:
        if not ack.accepted:
            self.refused.append(f"{ack.service}/{ack.part} {ack.id.seq}")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Keyframes 0 to 3; object 7 retired after 1, object 8 after 3; 2 was never answered."""
    recorded = Recorded(tmp_path)
    recorded.robot()
    recorded.bus.publish(CONTEXT, context())
    for seq in (0, 1):
        recorded.look(seq)
    recorded.bus.publish(KEYFRAME, frame(2))
    after = frame(1).id  # published late: the recorder has the next frame already
    recorded.bus.publish(RETIRED, pb.Retired(request=pb.RetireRequest(object_id=7), after=after))
    recorded.look(3)
    after = frame(3).id
    recorded.bus.publish(RETIRED, pb.Retired(request=pb.RetireRequest(object_id=8), after=after))
    recorded.close()
    return tmp_path


def test_answers_and_retirements_come_in_the_recorded_order(folder: Path) -> None:
    played = Played(folder)
    for seq in range(4):
        played.show(frame(seq))
    assert played.reported == ["saw 0", "saw 1", "retired 7", "saw 3", "retired 8"]


def test_an_answer_holds_the_recorded_detections_and_the_replayed_frame(folder: Path) -> None:
    played = Played(folder)
    played.show(frame(1))
    (answer,) = played.observations
    assert answer.frame == frame(1)
    assert answer.context_id == CONTEXT_ID
    assert [d.class_name for d in answer.detections] == ["cup"]


def test_a_keyframe_without_a_recorded_answer_is_refused_for_both_maps(folder: Path) -> None:
    played = Played(folder)
    played.show(frame(2))
    assert sorted(played.refused) == ["map2d/value 2", "objectmap/objects 2"]


def test_retirements_before_the_first_played_keyframe_are_skipped(folder: Path) -> None:
    played = Played(folder)
    played.show(frame(3))
    assert played.reported == ["saw 3", "retired 8"]


def test_frames_outside_the_recording_are_refused(folder: Path) -> None:
    played = Played(folder)
    played.show(frame(99))
    assert played.reported == []
    assert len(played.refused) == 2


def test_a_recording_without_answers_needs_a_detector(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    recorded.robot()
    recorded.bus.publish(KEYFRAME, frame(0))
    recorded.close()
    assert len(open_source(tmp_path).shots) == 1
    with pytest.raises(InvalidInput, match="--detector onnx:FILE"):
        RecordedDetector(MemoryBus(MemoryHub()), tmp_path, Health())
