"""The frames that a replay counts and the result files that it writes."""

from __future__ import annotations

import errno
import json
import math
import zlib
from pathlib import Path

import numpy as np
import pytest
from helios_client.replay.frame_answers import FrameAcks
from helios_client.replay.results import Results, collect, stage_medians_ms
from helios_client.supervision.service_table import ServiceTable
from helios_core import proto as pb
from helios_core.errors import InvalidInput, Unavailable
from helios_core.keyframe_acks import MapPart
from helios_core.map_snapshot import decode_snapshot
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import MAP2D_ACK, OBJECTMAP_ACK, OBJECTS, PICTURE, ROBOT_STATE, SNAPSHOT


def ack(part: str, seq: int, accepted: bool = True, update_ms: float = 5.0) -> pb.Ack:
    return pb.Ack(
        service="objectmap" if part == "objects" else "map2d",
        part=part,
        id=pb.FrameId(robot_boot_id="b", seq=seq),
        accepted=accepted,
        update_ms=update_ms,
        reason="" if accepted else "another search context",
    )


def test_a_frame_counts_after_all_map_parts_have_answered() -> None:
    acks = FrameAcks()
    for part in list(MapPart)[:-1]:
        acks.note_ack(ack(part, 1))
    assert acks.frames == 0
    acks.note_ack(ack(MapPart.OBJECTS, 1))
    acks.note_ack(ack(MapPart.OBJECTS, 1))
    assert acks.frames == 1


def test_a_frame_that_the_detector_refused_is_finished_by_its_occupancy_ack() -> None:
    acks = FrameAcks()
    acks.note_ack(ack("occupancy", 1))
    done = ack("observation", 1)
    done.accepted = True
    acks.note_detector(done)  # the maps have not answered yet
    assert acks.finished_frames == 0
    refused = ack("observation", 1)
    refused.service, refused.accepted, refused.reason = "detector", False, "no model"
    acks.note_detector(refused)
    assert acks.finished_frames == acks.frames == 1
    assert acks.refusals == {"detector: no model": 1}


def test_a_frame_with_only_an_occupancy_ack_is_finished_when_the_next_begins() -> None:
    acks = FrameAcks()
    assert (acks.finished_frames, acks.occupancy_frames) == (0, 0)
    acks.note_ack(ack("occupancy", 1))
    assert (acks.finished_frames, acks.occupancy_frames) == (0, 1)
    acks.note_ack(ack("occupancy", 2))
    assert (acks.finished_frames, acks.occupancy_frames) == (1, 2)
    for part in MapPart:
        acks.note_ack(ack(part, 2))
    assert (acks.finished_frames, acks.occupancy_frames, acks.frames) == (2, 2, 1)


def test_refusals_are_counted_with_their_reason_and_not_timed() -> None:
    acks = FrameAcks()
    acks.note_ack(ack("objects", 1, accepted=False, update_ms=99))
    assert acks.refusals == {"objectmap: another search context": 1}
    assert acks.median_ms() == {}


def test_stage_times_are_medians_of_acks_and_of_service_metrics() -> None:
    acks, service_table = FrameAcks(), ServiceTable()
    for seq, ms in enumerate((1.0, 9.0, 2.0)):
        acks.note_ack(ack("occupancy", seq, update_ms=ms))
    metrics = {"detect_ms_median": 31.5, "keyframes": 3.0}
    service_table.on_status(pb.ServiceStatus(service="detector", state="ready", metrics=metrics))
    stages = stage_medians_ms(acks, service_table)
    assert (stages["occupancy"], stages["detect"]) == (2.0, 31.5)
    assert "keyframes" not in stages


def test_results_are_collected_from_the_services_and_written(tmp_path: Path) -> None:
    hub = MemoryHub()
    maps, client = MemoryBus(hub, "robot"), MemoryBus(hub, "robot")
    cup = pb.ObjectInstance(
        id=3,
        class_name="cup",
        center_m=pb.Vector3(x=1.8, y=0.7, z=0.8),
        score=0.6,
        probabilities={"cup": 0.8, "other": 0.2},
    )
    worse = pb.ObjectInstance(id=2, class_name="cup", score=0.1)
    cells = np.array([[0, 100, -1]], np.int8)
    snapshot = pb.MapSnapshot(
        version=4, cell_m=0.05, width=3, height=1, occupancy=zlib.compress(cells.tobytes())
    )
    maps.serve(OBJECTS, lambda _: pb.ObjectsReply(objects=[worse, cup]))
    maps.serve(PICTURE, lambda request: pb.PictureReply(png=request.layer.encode()))
    maps.serve(SNAPSHOT, lambda _: snapshot)
    acks = FrameAcks()
    acks.listen(client)
    for part, topic in (("occupancy", MAP2D_ACK), ("value", MAP2D_ACK), ("objects", OBJECTMAP_ACK)):
        maps.publish(topic, ack(part, 1))
    maps.publish(ROBOT_STATE, pb.RobotState(finished=True))
    assert acks.finished
    collect(client, acks, ServiceTable(), frames=1, wall_s=2.5).write(tmp_path)
    objects = json.loads((tmp_path / "objects.json").read_text())
    assert [o["id"] for o in objects] == [3, 2]
    assert objects[0]["class"] == "cup"
    assert objects[0]["probabilities"] == {"cup": 0.8, "other": 0.2}
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["frames"], summary["keyframes"], summary["wall_s"]) == (1, 1, 2.5)
    assert summary["ms_per_frame"]["value"] == 5.0
    np.testing.assert_array_equal(np.load(tmp_path / "occupancy.npz")["occupancy"], cells)
    assert (tmp_path / "occupancy.png").read_bytes() == b"occupancy"


def results(score: float = 0.6, **summary: object) -> Results:
    found = {
        "id": 1,
        "class": "cup",
        "center_m": [0.0, math.nan, 1.0],
        "size_m": [0.1] * 3,
        "score": score,
        "uncertainty": 0.1,
        "views": 2,
    }
    snapshot = pb.MapSnapshot(version=1, cell_m=0.05, width=0, height=0)
    return Results([found], b"png", decode_snapshot(snapshot), summary)


def test_result_files_are_valid_json_with_non_finite_numbers_as_null(tmp_path: Path) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    results(score=math.inf, wall_s=math.nan, frames=3).write(tmp_path)
    read = [
        json.loads((tmp_path / name).read_text(), parse_constant=refuse)
        for name in ("objects.json", "summary.json")
    ]
    assert (read[0][0]["score"], read[0][0]["center_m"]) == (None, [0.0, None, 1.0])
    assert read[1] == {"wall_s": None, "frames": 3}


def test_a_full_disk_is_reported_and_keeps_the_previous_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results(frames=1).write(tmp_path)

    def full(path: Path, data: bytes) -> None:
        path.touch()  # only an empty file fits
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InvalidInput, match=r"objects.json cannot be written: No space.*--out"):
        results(frames=2).write(tmp_path)
    assert json.loads((tmp_path / "objects.json").read_text())[0]["id"] == 1
    assert json.loads((tmp_path / "summary.json").read_text()) == {"frames": 1}
    assert len(list(tmp_path.iterdir())) == 4


def test_a_missing_map_service_is_an_error() -> None:
    with pytest.raises(Unavailable):
        collect(MemoryBus(MemoryHub(), "robot"), FrameAcks(), ServiceTable(), 1, 1.0)
