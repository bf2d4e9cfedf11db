"""The content of the files of a recording."""

from __future__ import annotations

from pathlib import Path

import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from helios_core import proto as pb
from helios_core.codec import frame_from_proto
from helios_core.recording_format import PROFILE, join_frame, split_frame
from helios_core.topics import CONTEXT, DECISION, PREVIEW, TASK, TOPICS, status_topic
from mcap.reader import make_reader
from mcap.records import Channel, Schema
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from tests.support import wait_until
from tests.unit.recorder.recorder_bus import Recorded, context, frame


def messages(path: Path) -> dict[str, list]:
    """All messages of a file, read with the schemas in the file as a third-party program does."""
    out: dict[str, list] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            out.setdefault(channel.topic, []).append(message)
    return out


def only_file(folder: Path) -> Path:
    (path,) = folder.glob("*.mcap")
    return path


def test_every_recorded_message_can_be_read_without_helios_code(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    recorded.tour(3)
    recorded.look(3, keyframe=False)
    recorded.bus.publish(TASK, pb.Task(id="t", state="running", message="looks for a cup"))
    recorded.bus.publish(DECISION, pb.Decision(task_id="t", why="it is near"))
    recorded.bus.publish(TASK, pb.Task(id="t", state="running", message="looks for a cup", steps=1))
    preview = pb.Preview(id=frame(2).id, jpeg=b"jpeg")
    preview.detections.add(class_name="cup", score=0.5).mask.width = 7
    recorded.bus.publish(PREVIEW, preview)
    recorded.bus.publish(status_topic("map2d"), pb.ServiceStatus(service="map2d", state="ready"))
    recorded.close()
    said = messages(only_file(tmp_path))
    assert [m.id.seq for m in said["/bridge/keyframe"]] == [0, 1, 2]
    assert [m.id.seq for m in said["/bridge/frame"]] == [3]
    assert {m.format for m in said["/camera/keyframe/color"]} == {"png"}
    assert [m.format for m in said["/camera/color"]] == ["jpeg"]
    assert {m.encoding for m in said["/camera/depth"]} == {"16UC1"}
    assert {(t.parent_frame_id, t.child_frame_id) for t in said["/tf"]} == {
        ("world", "base"),
        ("world", "camera"),
    }
    assert all(len(c.P) == 12 and len(c.K) == 9 for c in said["/camera/calibration"])
    assert [task.steps for task in said["/planner/task"]] == [0, 1]
    once = ["running : looks for a cup", "it is near"]  # though each step repeats it
    assert [log.message for log in said["/log"]] == once
    assert said["/planner/context"][0].classes[0].name == "cup"
    assert said["/map2d/status"][0].state == "ready"
    assert said["/detector/annotations"][0].texts[0].text == "cup 0.50"
    assert said["/detector/observation"][0].detections[0].class_name == "cup"


def test_a_recording_is_chunked_and_indexed_and_has_the_helios_profile(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, chunk_mb=0.02)
    recorded.tour(4)
    recorded.close()
    with only_file(tmp_path).open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == PROFILE
        summary = reader.get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) >= 4
    assert {c.compression for c in summary.chunk_indexes} == {"zstd"}
    assert summary.statistics is not None
    assert summary.statistics.message_count > 30


def test_declarations_between_chunks_equal_those_in_the_chunks(tmp_path: Path) -> None:
    """MCAP allows a schema or a channel to be repeated if it is the same."""
    recorded = Recorded(tmp_path, chunk_mb=0.02)
    recorded.tour(4)
    recorded.close()
    declared: dict[tuple[type, int], list[Schema | Channel]] = {}
    with only_file(tmp_path).open("rb") as file:
        for one in StreamReader(file, validate_crcs=True).records:
            if isinstance(one, Schema | Channel):
                declared.setdefault((type(one), one.id), []).append(one)
    assert len(declared) == 18
    for same in declared.values():
        assert len(same) >= 3  # in a chunk, between two, in the summary
        assert all(one == same[0] for one in same)


def test_every_topic_is_subscribed_except_the_ground_truth(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    keys = {s.key for s in recorded.hub.subscribers}
    recorded.close()
    assert {t.key("robot") for t in TOPICS} <= keys
    assert not any("truth" in key for key in keys)


def test_pixels_are_in_the_file_once(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    recorded.tour(1)
    recorded.close()
    (observation,) = messages(only_file(tmp_path))["/detector/observation"]
    assert observation.frame.raw_color.data == b""
    assert observation.frame.raw_depth.data == b""
    assert observation.frame.id.seq == 0


@pytest.mark.parametrize("seq", range(5))
def test_a_split_keyframe_is_joined_without_loss(seq: int) -> None:
    message = frame(seq)
    parts = split_frame(message, None)
    color = CompressedImage.FromString(parts.color.SerializeToString())
    depth = RawImage.FromString(parts.depth.SerializeToString())
    again = join_frame(parts.head, color, depth)
    assert again == message
    assert again.SerializeToString(deterministic=True) == message.SerializeToString(
        deterministic=True
    )


def test_the_depth_of_a_stream_frame_is_kept_without_loss() -> None:
    message = frame(0, keyframe=False)
    parts = split_frame(message, 90)
    assert parts.depth.data == message.raw_depth.data
    seen = frame_from_proto(join_frame(parts.head, parts.color, parts.depth))
    assert (seen.depth_m == frame_from_proto(message).depth_m).all()


def test_an_unreadable_frame_is_counted_and_the_next_frame_is_recorded(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    recorded.robot()
    broken = frame(0)
    broken.raw_color.data = b"short"
    from helios_core.topics import KEYFRAME

    recorded.bus.publish(KEYFRAME, broken)
    recorded.look(1)
    recorded.close()
    assert recorded.health.metrics()["unrecordable_messages"] == 1
    assert [m.id.seq for m in messages(only_file(tmp_path))["/bridge/keyframe"]] == [1]


def test_files_are_rotated_and_each_can_be_read_alone(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, rotate_mb=0.05, flush_s=0.001)
    recorded.robot()
    recorded.bus.publish(CONTEXT, context())
    seq = 0
    while len(list(tmp_path.glob("*.mcap"))) < 3:
        recorded.look(seq)
        seq += 1
        wait_until(lambda: recorded.service.recording.inbox.bytes == 0, 60, "it is written")
    recorded.close()
    files = sorted(tmp_path.glob("*.mcap"))
    assert all(path.stat().st_size < 200_000 for path in files)
    came = [m.id.seq for path in files for m in messages(path).get("/bridge/keyframe", [])]
    assert came == list(range(seq))
    for path in files:
        said = messages(path)
        assert said["/bridge/description"]
        assert said["/planner/context"][0].id == context().id


def test_a_file_is_rotated_at_its_maximum_age(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, rotate_min=1e-4, flush_s=0.001)
    recorded.robot()
    wait_until(lambda: len(list(tmp_path.glob("*.mcap"))) >= 3, 60, "the file is followed")
    recorded.close()
