"""The black box: what its recordings hold, and their limits."""

from __future__ import annotations

import io
import json
import os
import threading
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from google.protobuf.message import Message
from helios_core import proto as pb
from helios_core.codec import frame_to_proto
from helios_core.geometry import Pinhole
from helios_core.recording_format import channel_of
from helios_core.topics import CONTEXT, FRAME, KEYFRAME, OBSERVATION, TASK
from helios_core.types import Frame, FrameId
from helios_core.viewing.entry import Entry
from helios_gateway.faults import black_box
from helios_gateway.faults.black_box import BlackBox
from helios_gateway.faults.box_file import METADATA, compressed, mcap_bytes
from helios_gateway.faults.fault_files import LIST_NAME, FaultFiles, RecordingNote
from helios_gateway.faults.fault_monitor import FaultMonitor
from helios_gateway.faults.findings import DOWN_S, LATE_S
from helios_gateway.faults.life_cycle import Fault, FaultState, Finding
from mcap.reader import make_reader

from tests.support import wait_until

SAVED_WITHIN_S = 20.0


def frame(seq: int, keyframe: bool = True, pixels: tuple[int, int] = (48, 64)) -> pb.Frame:
    rng = np.random.default_rng(seq)
    height, width = pixels
    return frame_to_proto(
        Frame(
            FrameId("boot", 0, seq),
            1_000 + seq,
            keyframe,
            rng.integers(0, 255, (height, width, 3), np.uint8),
            rng.uniform(0.5, 4.0, pixels).astype(np.float32),
            Pinhole(50.0, 50.0, width / 2, height / 2, width, height),
            np.eye(4),
            np.eye(4),
        )
    )


def task(message: str) -> pb.Task:
    return pb.Task(id="c0ffee", state="running", message=message)


class Read:
    """A recording: its messages by channel, and its metadata."""

    def __init__(self, data: bytes) -> None:
        reader = make_reader(io.BytesIO(data))
        rows = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
        self.times = [time for _, time, _ in rows]
        self.topics = Counter(topic for topic, _, _ in rows)
        self.data = {topic: data for topic, _, data in rows}  # the last one
        self.first = {topic: data for topic, _, data in reversed(rows)}
        (self.about,) = (m.metadata for m in reader.iter_metadata() if m.name == METADATA)


class Saved:
    """Receiver of finished recordings."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}

    def __call__(self, name: str, data: bytes) -> None:
        self.files[name] = data

    def read(self, name: str) -> Read:
        wait_until(lambda: name in self.files, SAVED_WITHIN_S, "the recording is written")
        return Read(self.files[name])


@pytest.fixture
def saved(monkeypatch: pytest.MonkeyPatch) -> Saved:
    monkeypatch.setattr(black_box, "AFTER_S", 0.3)
    return Saved()


@pytest.fixture
def box(saved: Saved) -> Iterator[BlackBox]:
    box = BlackBox(saved)
    yield box
    box.close()


def taken(box: BlackBox) -> None:
    """Wait until the box has taken all messages."""
    wait_until(lambda: not box._queue.bytes, 60, "all messages are taken")


def test_a_recording_holds_what_came_before_and_after(box: BlackBox, saved: Saved) -> None:
    box.put(channel_of(CONTEXT), pb.SearchContext(id="c"))
    box.put(channel_of(KEYFRAME), frame(1))
    box.put(channel_of(TASK), task("before"))
    taken(box)
    name = box.record("a.mcap", {"fault": "detector-degraded"})
    box.put(channel_of(TASK), task("after"))
    found = saved.read(name)
    assert found.topics["/planner/task"] == 2
    assert found.topics["/camera/keyframe/color"] == 1
    assert found.topics["/camera/keyframe/depth"] == 1
    assert pb.Task.FromString(found.data["/planner/task"]).message == "after"
    assert found.about == {"fault": "detector-degraded"}
    assert found.times == sorted(found.times)


def test_faults_close_to_each_other_share_a_recording(box: BlackBox, saved: Saved) -> None:
    first = box.record("a.mcap", {"fault": "a"})
    assert box.record("b.mcap", {"fault": "b"}) == first
    saved.read(first)
    assert box.record("c.mcap", {"fault": "c"}) == "c.mcap"
    saved.read("c.mcap")


def test_a_recording_of_endless_faults_ends(
    box: BlackBox, saved: Saved, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(black_box, "LONGEST_S", 0.5)
    name = box.record("a.mcap", {})
    wait_until(lambda: box.record("b.mcap", {}) == "b.mcap", SAVED_WITHIN_S, "the first has ended")
    saved.read(name)


def test_images_are_thinned_and_keyframes_come_first(box: BlackBox, saved: Saved) -> None:
    for seq in range(10):
        box.put(channel_of(FRAME), frame(seq, keyframe=False))
        box.put(channel_of(KEYFRAME), frame(seq))
    found = saved.read(box.record("a.mcap", {}))
    assert found.topics["/camera/keyframe/color"] == 1
    assert found.topics["/camera/color"] <= 1


def test_an_observation_is_kept_without_its_pixels(box: BlackBox, saved: Saved) -> None:
    whole = pb.Observation(frame=frame(3), context_id="c", detector="d")
    whole.detections.add(class_name="mug", score=0.5)
    before = whole.SerializeToString()
    box.put(channel_of(OBSERVATION), whole)
    taken(box)
    kept = pb.Observation.FromString(
        saved.read(box.record("a.mcap", {})).data["/detector/observation"]
    )
    assert whole.SerializeToString() == before  # others use it, too
    assert kept.frame.id == whole.frame.id
    assert not kept.frame.raw_color.data
    assert [d.class_name for d in kept.detections] == ["mug"]


def test_a_context_from_before_the_ring_is_still_in_the_recording(
    box: BlackBox, saved: Saved, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(black_box, "RING_BYTES", 3_000)
    box.put(channel_of(CONTEXT), pb.SearchContext(id="old"))
    for number in range(40):
        box.put("/bridge/ack", pb.Ack(service="x" * 50, version=number))
    taken(box)
    found = saved.read(box.record("a.mcap", {}))
    assert found.topics["/bridge/ack"] < 40
    assert pb.SearchContext.FromString(found.first["/planner/context"]).id == "old"


def test_a_recording_is_limited_and_says_what_it_leaves_out(
    box: BlackBox, saved: Saved, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(black_box, "RECORDING_BYTES", 5_000)
    name = box.record("a.mcap", {})
    for number in range(100):
        box.put("/bridge/ack", pb.Ack(service="x" * 50, version=number))
    found = saved.read(name)
    assert 0 < found.topics["/bridge/ack"] < 100
    assert int(found.about["left_out"]) == 100 - found.topics["/bridge/ack"]


def test_large_messages_wait_compressed_and_come_back_whole() -> None:
    message: Message = pb.Preview(jpeg=bytes(200_000))
    kept = compressed(Entry("/detector/preview", message), 7)
    assert kept.size < 20_000
    found = Read(mcap_bytes([kept], {}))
    assert found.data["/detector/preview"] == message.SerializeToString()


def test_the_ring_reaches_back_to_before_the_slowest_confirmed_fault() -> None:
    ring, second = black_box._Ring(), 10**9
    for k in range(100):
        ring.add(compressed(Entry("/detector/preview", pb.Preview(jpeg=b"x")), k * second))
    kept_s = (99 * second - ring.content()[0].log_time_ns) / second
    assert black_box.BEFORE_S + DOWN_S == kept_s == 30


# --- files -------------------------------------------------------------------------------------
def note(number: int, size: int = 100) -> RecordingNote:
    return RecordingNote(f"20260101T0000{number:02d}Z-map2d-down.mcap", float(number), bytes=size)


def test_the_oldest_recordings_are_removed(tmp_path: Path) -> None:
    files = FaultFiles(tmp_path, 250)
    notes = [note(number) for number in range(5)]
    for one in notes:
        assert files.save(one.name, bytes(100))
    kept = files.shorten(notes)
    assert kept == notes[-2:]
    assert sorted(p.name for p in tmp_path.iterdir()) == [n.name for n in kept]


def test_the_newest_recording_stays_even_if_it_is_too_large(tmp_path: Path) -> None:
    assert FaultFiles(tmp_path, 1).shorten([note(1), note(2, 10_000)]) == [note(2, 10_000)]


def test_recordings_leave_room_on_a_small_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = SimpleNamespace(free=500)
    monkeypatch.setattr("helios_gateway.faults.fault_files.shutil.disk_usage", lambda _: usage)
    files = FaultFiles(tmp_path, 10_000)
    notes = [note(number) for number in range(5)]
    assert files.shorten(notes) == notes[-2:]  # a quarter of 500 + 500
    assert files.shorten(notes, 100) == notes[-1:]
    assert not files.save(note(6).name, bytes(126))
    assert files.save(note(6).name, bytes(125))


def test_a_clock_that_jumps_back_makes_no_new_recording_the_oldest(tmp_path: Path) -> None:
    before, after = note(50), note(1)  # made an hour later, by a clock that was set back
    assert FaultFiles(tmp_path, 150).shorten([before, after]) == [after]


@pytest.mark.parametrize("name", ["../x.mcap", "faults.json", "20260101T000000Z-a/b.mcap", ""])
def test_no_other_file_is_read(tmp_path: Path, name: str) -> None:
    (tmp_path / LIST_NAME).write_text("{}")
    (tmp_path.parent / "x.mcap").write_text("")
    assert FaultFiles(tmp_path, 1).path(name) is None


@pytest.mark.parametrize("content", ["", "{", "[]", '{"faults": [{}], "recordings": []}'])
def test_a_damaged_list_begins_anew(tmp_path: Path, content: str) -> None:
    (tmp_path / LIST_NAME).write_text(content)
    assert FaultFiles(tmp_path, 1).read() == ([], [])


@pytest.mark.parametrize(
    "content", [None, "", "[]", '{"recordings": 5}', '{"recordings": [7, {"name": 5}]}']
)
def test_recordings_without_an_entry_are_listed_and_removed_like_all_others(
    tmp_path: Path, content: str | None
) -> None:
    files = FaultFiles(tmp_path, 250)
    for number in (2, 1, 3):
        assert files.save(note(number).name, bytes(100))
        os.utime(tmp_path / note(number).name, (number, number))
    if content is not None:
        (tmp_path / LIST_NAME).write_text(content)
    (tmp_path / "mug.mcap").write_bytes(b"not one of them")
    _, notes = files.read()
    assert notes == [note(1), note(2), note(3)]
    assert files.shorten(notes, 100) == [note(3)]
    left = {path.name for path in tmp_path.iterdir()} - {LIST_NAME}
    assert left == {"mug.mcap", note(3).name}


def test_entries_are_read_one_by_one_and_sizes_from_the_files(tmp_path: Path) -> None:
    files = FaultFiles(tmp_path, 1e9)
    known = replace(note(5, 0), faults=("map2d-down",))  # the gateway ended before it knew the size
    fault = Fault("map2d-down", "map2d", "down", "error", "it is gone", FaultState.CONFIRMED)
    files.write([fault], [known, note(6), note(7)])
    stored = json.loads((tmp_path / LIST_NAME).read_text())
    del stored["faults"][0]["since_s"]  # an older gateway did not know it
    stored["faults"] += [{"id": "half"}, {**stored["faults"][0], "state": "unheard of"}]
    stored["recordings"][1]["made_s"] = "today"
    (tmp_path / LIST_NAME).write_text(json.dumps(stored))
    for number, size in ((5, 100), (6, 200), (7, 0)):  # a power cut emptied the last one
        assert files.save(note(number).name, bytes(size))
    os.utime(tmp_path / note(6).name, (60, 60))
    faults, notes = files.read()
    assert faults == [fault]
    assert notes == [replace(note(6, 200), made_s=60.0), replace(known, bytes=100)]
    assert files.path(note(7).name) is None


# --- the monitor -------------------------------------------------------------------------------
class Clock:
    now_s = 1_000_000.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def told() -> list[Fault]:
    return []


def monitor(folder: Path | None, told: list[Fault], clock: Clock) -> FaultMonitor:
    return FaultMonitor(folder, 1e9, told.append, clock)


def failed(clock: Clock, id: str = "c0ffee") -> pb.Task:
    return pb.Task(id=id, state="failed", cause="stuck", message="no way", ended_s=clock.now_s)


def recorded(faults: FaultMonitor, task_id: str) -> dict[str, Any]:
    (name,) = faults.recordings_of(task_id)
    wait_until(lambda: faults.path(name), SAVED_WITHIN_S, "the recording is written")
    wait_until(lambda: faults.recordings()[0].bytes, SAVED_WITHIN_S, "its size is known")
    path = faults.path(name)
    assert path is not None
    return Read(path.read_bytes()).about


def test_a_failed_task_names_its_recording_at_once(
    saved: Saved, tmp_path: Path, told: list[Fault]
) -> None:
    clock = Clock()
    faults = monitor(tmp_path, told, clock)
    faults.on_task(failed(clock))
    faults.on_task(failed(clock))  # the planner publishes it again
    assert [(f.id, f.state, f.count) for f in told] == [("task-stuck", "confirmed", 1)]
    assert recorded(faults, "c0ffee")["task"] == "c0ffee"
    assert faults.recordings_of("other") == []
    faults.on_task(pb.Task(id="b", state="succeeded", ended_s=clock.now_s))
    assert told[-1].state == "cleared"
    faults.close()


def test_faults_can_be_read_while_the_disk_is_slow(
    saved: Saved, tmp_path: Path, told: list[Fault], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go_on = threading.Event(), threading.Event()

    def slow(path: Path, data: bytes | str, sync: bool) -> None:
        if path.name == LIST_NAME:
            begun.set()
            assert go_on.wait(20)
        path.write_bytes(data.encode() if isinstance(data, str) else data)

    monkeypatch.setattr("helios_gateway.faults.fault_files.write_file", slow)
    clock = Clock()
    faults = monitor(tmp_path, told, clock)
    with ThreadPoolExecutor(2) as people:
        try:
            told_of_it = people.submit(faults.on_task, failed(clock))
            assert begun.wait(SAVED_WITHIN_S)
            assert [f.id for f in people.submit(faults.faults).result(20)] == ["task-stuck"]
            assert len(people.submit(faults.recordings).result(20)) == 1
        finally:
            go_on.set()
        told_of_it.result(20)
    recorded(faults, "c0ffee")
    faults.close()


def test_the_next_gateway_knows_faults_and_recordings(
    saved: Saved, tmp_path: Path, told: list[Fault]
) -> None:
    clock = Clock()
    first = monitor(tmp_path, told, clock)
    first.on_task(failed(clock))
    recorded(first, "c0ffee")
    first.close()
    second = monitor(tmp_path, told, clock)
    second.on_task(failed(clock))  # told again to the new subscriber
    assert [(f.id, f.count) for f in second.faults()] == [("task-stuck", 1)]
    assert second.recordings() == first.recordings()
    second.close()
    clock.now_s += 100.0
    third = monitor(None, told, clock)
    third.on_task(pb.Task(id="old", state="failed", ended_s=clock.now_s - 2 * LATE_S))
    assert not third.faults()


def test_a_confirmed_fault_is_recorded_and_a_short_one_is_not(
    saved: Saved, tmp_path: Path, told: list[Fault]
) -> None:
    clock = Clock()
    faults = monitor(tmp_path, told, clock)
    faults.observe([Finding("map2d", "degraded", "the disk is full", "warning")])
    assert not faults.recordings()
    clock.now_s += 10.0
    faults.observe([Finding("map2d", "degraded", "the disk is full", "warning")])
    (made,) = faults.recordings()
    assert made.faults == ("map2d-degraded",)
    assert made.name.endswith("Z-map2d-degraded.mcap")
    assert json.loads((tmp_path / LIST_NAME).read_text())["faults"][0]["state"] == "confirmed"
    faults.close()


def test_a_restart_that_two_supervisors_alternate_with_is_one_occurrence(
    told: list[Fault],
) -> None:
    faults = monitor(None, told, Clock())
    for restarts in (0, 1, 1, 1):
        faults.on_supervisor(supervised("bridge", restarts))
        faults.on_supervisor(supervised("map2d", 3))
    assert [(f.id, f.count) for f in faults.faults()] == [("bridge-restarted", 1)]


def test_the_recording_of_a_process_with_any_name_is_kept_and_can_be_read(
    saved: Saved, tmp_path: Path, told: list[Fault]
) -> None:
    faults = monitor(tmp_path, told, Clock())
    for restarts in (0, 1):
        faults.on_supervisor(supervised("My_driver/v2", restarts))
    (note,) = faults.recordings()
    assert note.name.endswith("Z-my-driver-v2-restarted.mcap")
    wait_until(lambda: faults.path(note.name), SAVED_WITHIN_S, "the recording is written")
    wait_until(lambda: faults.recordings()[0].bytes, SAVED_WITHIN_S, "its size is known")
    faults.close()
    again = monitor(tmp_path, told, Clock())
    assert [n.name for n in again.recordings()] == [note.name]
    again.close()


def supervised(name: str, restarts: int) -> pb.SupervisorStatus:
    return pb.SupervisorStatus(processes=[pb.ProcessStatus(name=name, restarts=restarts)])


def test_a_full_disk_does_not_stop_the_monitor(
    saved: Saved, tmp_path: Path, told: list[Fault]
) -> None:
    folder = tmp_path / "file"
    folder.write_text("")  # no folder can be made there
    clock = Clock()
    faults = monitor(folder, told, clock)
    faults.on_task(failed(clock))
    wait_until(lambda: not faults.recordings(), SAVED_WITHIN_S, "the lost recording is forgotten")
    assert [f.id for f in faults.faults()] == ["task-stuck"]
    faults.close()
