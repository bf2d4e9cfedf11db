"""The recorder at its limits: full queue, missing frames, slow or full disk."""

from __future__ import annotations

import errno
import itertools
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from helios_core import proto as pb
from helios_core.topics import FRAME, KEYFRAME
from helios_core.viewing.message_queue import MessageQueue
from helios_recorder import mcap_writer as file_module
from helios_recorder import recording_thread as recording_module
from helios_recorder.mcap_writer import DiskFull
from helios_recorder.recording_thread import Recording
from helios_recorder.service import Gaps
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from tests.support import wait_until
from tests.unit.recorder.recorder_bus import Recorded, frame


def test_a_full_queue_drops_stream_frames_first_and_never_blocks() -> None:
    inbox = MessageQueue(limit_bytes=10 * frame(0).ByteSize())
    streams = [inbox.put("/s", frame(0, keyframe=False), droppable=True) for _ in range(20)]
    keyframes = [inbox.put("/k", frame(0), droppable=False) for _ in range(20)]
    assert sum(streams) == 5
    assert sum(keyframes) == 4 or sum(keyframes) == 5
    assert not inbox.put("/k", frame(0), droppable=False)


@pytest.mark.parametrize("step_ns", [1_000_000, 0, -1_000_000])
def test_log_times_rise_strictly(step_ns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock may advance, stand still or go back."""
    clock = itertools.count(10**15, step_ns)
    monkeypatch.setattr(time, "monotonic_ns", lambda: next(clock))
    inbox = MessageQueue(1e6)
    for _ in range(200):
        inbox.put("/t", pb.Empty(), droppable=False)
    times = [item.log_time_ns for _ in range(200) if (item := inbox.take(0))]
    assert len(times) == 200
    assert all(b > a for a, b in itertools.pairwise(times))


def test_dropped_frames_are_counted_and_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate_is_shut = True
    step = Recording._step

    def slow(self: Recording, item: Any) -> None:
        wait_until(lambda: not gate_is_shut, 60, "the disk wakes up")
        step(self, item)

    monkeypatch.setattr(Recording, "_step", slow)
    recorded = Recorded(tmp_path, queue_mb=10 * frame(0).ByteSize() / 1e6)
    for seq in range(30):
        recorded.bus.publish(FRAME, frame(seq, keyframe=False))
    recorded.bus.publish(KEYFRAME, frame(30))
    gate_is_shut = False
    wait_until(lambda: "dropped" in recorded.health.state[1], 60, "it says so")
    recorded.close()
    metrics = recorded.health.metrics()
    assert 20 <= metrics["dropped_frames"] <= 26
    assert metrics["missed_frames"] == 0
    assert metrics["messages"] == 31 - metrics["dropped_frames"]


@given(st.lists(st.integers(0, 60), min_size=1, unique=True))
def test_gaps_counts_the_missing_sequence_numbers(numbers: list[int]) -> None:
    """Two threads may deliver them in any order."""
    gaps = Gaps()
    missing = 0
    for seq in numbers:
        missing = gaps.add(pb.FrameId(robot_boot_id="b", seq=seq))
    assert missing == max(numbers) - min(numbers) + 1 - len(numbers)


def test_a_restart_of_the_bridge_counts_no_missing_frames() -> None:
    gaps = Gaps()
    for seq in (1, 2, 4, 1_000_000, 1_000_001):
        missing = gaps.add(pb.FrameId(robot_boot_id="b", seq=seq))
    assert missing == 1


def test_a_full_disk_is_reported_and_the_recording_continues_when_space_is_free(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = False
    check = file_module._check_room

    def room(*args: Any) -> None:
        if full:
            raise OSError(errno.ENOSPC, "No space left on device")
        check(*args)

    monkeypatch.setattr(file_module, "_check_room", room)
    recorded = Recorded(tmp_path, flush_s=0.01, retry_s=0.1)
    recorded.tour(2)
    wait_until(lambda: recorded.health.state[0] == "ready", 60, "it records")
    file = recorded.service.recording._file
    assert file is not None
    full = True
    wait_until(lambda: recorded.health.state[0] == "degraded", 60, "the full disk is said")
    said = recorded.health.state[1]
    assert "the disk is full" in said
    assert str(tmp_path) in said
    assert file._stream.closed
    recorded.look(2)  # does not block
    wait_until(
        lambda: recorded.health.metrics().get("dropped_while_stopped", 0) >= 2, 60, "it is counted"
    )
    full = False
    wait_until(lambda: recorded.health.state[0] == "ready", 60, "it records again")
    recorded.look(3)
    recorded.close()
    assert len(list(tmp_path.glob("*.mcap"))) >= 2


def test_a_disk_that_becomes_full_ends_the_file_with_its_index_and_loses_no_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = False

    def room(folder: Path, *_: object) -> None:
        if full:
            raise DiskFull(f"{folder} has 499 MB left and 500 are kept free")

    monkeypatch.setattr(file_module, "_check_room", room)
    recorded = Recorded(tmp_path, flush_s=0.01, retry_s=1000.0)
    recorded.tour(3)
    wait_until(lambda: recorded.health.metrics().get("messages", 0) == 9, 60, "all is taken")
    full = True
    wait_until(lambda: recorded.health.state[0] == "degraded", 60, "the full disk is said")
    (file,) = tmp_path.glob("*.mcap")
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count >= 9
    assert recorded.health.metrics().get("dropped_while_stopped", 0) == 0
    recorded.close()


def test_a_written_message_is_not_counted_as_lost_when_the_disk_becomes_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same holds if there is no space for the index."""

    def room(*_: object) -> None:
        if recorded.health.metrics().get("messages", 0) == 3:
            raise DiskFull("no room")

    def no_room(_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    recorded = Recorded(tmp_path, flush_s=1e-9, chunk_mb=64, retry_s=1000.0)
    monkeypatch.setattr(file_module, "_check_room", room)
    monkeypatch.setattr(file_module.RecordingFile, "finish", no_room)
    recorded.robot()
    recorded.look(0, keyframe=False)
    wait_until(lambda: recorded.health.state[0] == "degraded", 60, "the full disk is said")
    assert recorded.health.metrics().get("dropped_while_stopped", 0) == 0
    recorded.close()


def test_messages_that_a_full_disk_did_not_take_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A chunk that waits to be written is lost, too."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    recorded = Recorded(tmp_path, flush_s=1000.0, chunk_mb=64, retry_s=1000.0)
    recorded.tour(3)
    wait_until(lambda: recorded.health.metrics().get("messages", 0) == 9, 60, "all is taken")
    monkeypatch.setattr(file_module.RecordingFile, "write", full)
    recorded.look(3)
    wait_until(lambda: recorded.health.state[0] == "degraded", 60, "the full disk is said")
    wait_until(
        lambda: recorded.health.metrics()["dropped_while_stopped"] == 11, 60, "all is counted"
    )
    recorded.close()


def test_messages_that_a_slow_disk_did_not_take_by_the_end_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    awake = threading.Event()
    monkeypatch.setattr(recording_module, "CLOSE_WITHIN_S", 0.05)
    monkeypatch.setattr(Recording, "_step", lambda *_: awake.wait(20))
    recorded = Recorded(tmp_path)
    recorded.tour(2)
    recorded.close()
    awake.set()
    assert "are lost" in caplog.text


def test_too_little_disk_space_at_the_start_is_reported(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, min_free_mb=1e12)
    wait_until(lambda: recorded.health.state[0] == "degraded", 60, "it is said")
    recorded.close()
    assert "kept free" in recorded.health.state[1]
    assert list(tmp_path.glob("*.mcap")) == []


def test_an_output_folder_that_cannot_be_created_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    recorded = Recorded(tmp_path / "file" / "recordings")
    wait_until(lambda: recorded.health.state[0] == "degraded", 60, "it is said")
    recorded.close()
    said = recorded.health.state[1]
    assert f"{tmp_path}/file/recordings is no folder" in said
    assert "make room" not in said


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_disk_that_takes_no_byte_leaves_no_empty_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """/dev/full takes no byte, like a full disk."""
    opened = Path.open

    def full(path: Path, mode: str = "r", *args: Any) -> Any:
        if path.suffix == ".mcap" and "b" in mode:
            path.touch()
            return opened(Path("/dev/full"), "wb")
        return opened(path, mode, *args)

    monkeypatch.setattr(Path, "open", full)
    recorded = Recorded(tmp_path, retry_s=0.05)
    wait_until(lambda: recorded.health.state[0] == "degraded", 60, "it is said")
    recorded.robot()
    wait_until(
        lambda: recorded.health.metrics().get("dropped_while_stopped", 0) >= 2, 60, "it is counted"
    )
    recorded.close()
    assert recorded.health.metrics()["dropped_while_stopped"] == 2  # robot() publishes two messages
    assert "the disk is full" in recorded.health.state[1]
    assert list(tmp_path.iterdir()) == []
    assert recorded.service.recording._files == 0  # an unwritten file takes no number
