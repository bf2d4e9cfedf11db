"""A recording as a source: its content, order and timing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import frame_from_proto
from helios_core.errors import InvalidInput
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import EndOfRecording, Observe
from helios_core.topics import CONTEXT, KEYFRAME, OBSERVATION, ROBOT_STATE
from helios_replay import ReplayDriver
from helios_replay.format_detection import mcap_files, open_source
from helios_replay.mcap_recording import Recording
from helios_replay.replay_source import PlaybackRange

from tests.support import wait_until
from tests.unit.recorder.recorder_bus import CONTEXT_ID, Recorded, context, description, frame
from tests.unit.replay.replay_recorded import record


def test_keyframes_are_played_as_they_were_sent(recording: tuple[Path, list[pb.Frame]]) -> None:
    path, sent = recording
    source = open_source(path)
    assert len(source.shots) == len(sent)
    for i, message in enumerate(sent):
        picture = source.read(i)
        assert picture.recorded == message
        np.testing.assert_array_equal(picture.color, frame_from_proto(message).color)
        assert source.shots[i].stamp_ns == frame_from_proto(message).stamp_ns


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_recordings_of_every_compression_are_played(compression: str, tmp_path: Path) -> None:
    path, sent = record(tmp_path, compression=compression)
    assert open_source(path).read(2).recorded == sent[2]


def test_the_robot_is_the_recorded_one_and_cannot_act(
    recording: tuple[Path, list[pb.Frame]],
) -> None:
    robot = open_source(recording[0]).describe()
    assert (robot.name, robot.footprint_radius_m) == ("tiny", description().footprint_radius_m)
    assert (robot.can_move, robot.can_pick, robot.can_place) == (False, False, False)
    assert robot.recorded
    driver = ReplayDriver(recording[0])
    assert driver.state().robot_boot_id == "boot"
    driver.capture()
    assert driver.state().robot_boot_id == "boot"


def test_search_contexts_and_the_held_object_come_with_their_keyframes(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    recorded.robot()
    recorded.bus.publish(CONTEXT, context("one"))
    recorded.look(0, "one")
    recorded.bus.publish(ROBOT_STATE, pb.RobotState(held="cup"))
    recorded.look(1, "two")  # answered for a context that the recorder gets later
    recorded.bus.publish(CONTEXT, context("two"))
    recorded.look(2, "two")
    recorded.close()
    source = Recording(sorted(tmp_path.glob("*.mcap")), PlaybackRange())
    assert [[c.id for c in source.contexts_before(i)] for i in range(3)] == [["one"], ["two"], []]
    assert [source.state_after(i).held for i in range(-1, 3)] == ["", "cup", "cup", "cup"]
    part = Recording(sorted(tmp_path.glob("*.mcap")), PlaybackRange(from_s=source.shots[2].time_s))
    assert [c.id for c in part.contexts_before(0)] == ["one", "two"]


def test_the_driver_publishes_the_recorded_search_contexts_if_enabled(
    recording: tuple[Path, list[pb.Frame]],
) -> None:
    bus = MemoryBus(MemoryHub())
    heard: list[str] = []
    bus.subscribe(CONTEXT, lambda message: heard.append(message.id))
    ReplayDriver(recording[0], bus=bus).capture()
    assert heard == []
    ReplayDriver(recording[0], bus=bus, contexts=True).capture()
    assert heard == [context().id]


def test_keyframes_before_the_first_search_context_are_marked(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    recorded.robot()
    for seq in (0, 1):
        recorded.bus.publish(KEYFRAME, frame(seq))
    recorded.bus.publish(CONTEXT, context())
    recorded.look(2)
    recorded.close()
    bus = MemoryBus(MemoryHub())
    driver = ReplayDriver(tmp_path, bus=bus, contexts=True)
    assert [driver.capture().searching for _ in range(3)] == [False, False, True]
    later = ReplayDriver(tmp_path, limit=2)  # another process publishes the context
    assert [later.capture().searching for _ in range(2)] == [True, True]


@pytest.mark.parametrize("stated_first", [True, False])
def test_the_held_object_changes_at_the_same_keyframe_as_in_the_recording(
    stated_first: bool, tmp_path: Path
) -> None:
    """Before the keyframe if the robot published it before the answer; else after it."""
    recorded = Recorded(tmp_path)
    recorded.robot()
    recorded.bus.publish(CONTEXT, context())
    recorded.look(0)
    message, empty = frame(1), pb.RobotState(held="")
    recorded.bus.publish(ROBOT_STATE, pb.RobotState(held="cup"))
    recorded.bus.publish(KEYFRAME, message)
    if stated_first:
        recorded.bus.publish(ROBOT_STATE, empty)
    recorded.bus.publish(OBSERVATION, pb.Observation(frame=message, context_id=CONTEXT_ID))
    recorded.bus.publish(ROBOT_STATE, empty)
    recorded.close()
    bus = MemoryBus(MemoryHub())
    heard: list[pb.RobotState] = []
    bus.subscribe(ROBOT_STATE, heard.append)
    driver = ReplayDriver(tmp_path, bus=bus, contexts=True)
    driver.capture()
    assert driver.state().held == "cup"
    driver.capture()
    assert [(s.held, s.robot_boot_id) for s in heard] == ([("", "boot")] if stated_first else [])
    assert driver.state().held == ""


def test_a_playback_range_selects_a_part_of_a_recording(
    recording: tuple[Path, list[pb.Frame]],
) -> None:
    path, sent = recording
    times_s = [shot.time_s for shot in open_source(path).shots]
    part = open_source(path, PlaybackRange(from_s=times_s[1], to_s=times_s[2]))
    assert [part.read(i).recorded for i in range(len(part.shots))] == sent[1:3]
    assert len(open_source(path, PlaybackRange(limit=2)).shots) == 2
    with pytest.raises(InvalidInput, match="no frame from 1e"):
        open_source(path, PlaybackRange(from_s=1e9))


class FakeClock:
    """A clock that advances only in `wait`."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s

    def wait(self, seconds: float) -> None:
        assert seconds >= 0
        self.now_s += seconds


@pytest.mark.parametrize("rate", [0.0, 0.5, 1.0, 20.0])
def test_a_playback_rate_only_delays_the_frames(
    rate: float, recording: tuple[Path, list[pb.Frame]]
) -> None:
    path, sent = recording
    times_s = [shot.time_s for shot in open_source(path).shots]
    assert times_s[-1] > times_s[0]
    clock = FakeClock()
    driver = ReplayDriver(path, rate=rate, clock=clock, wait=clock.wait)
    for message, time_s in zip(sent, times_s, strict=True):
        assert driver.capture().recorded == message
        due_s = (time_s - times_s[0]) / rate if rate else 0.0
        assert clock.now_s - 1000.0 == pytest.approx(due_s, abs=1e-9)
    with pytest.raises(EndOfRecording):
        driver.capture()


def test_a_late_capture_does_not_wait(recording: tuple[Path, list[pb.Frame]]) -> None:
    clock = FakeClock()
    driver = ReplayDriver(recording[0], rate=1.0, clock=clock, wait=clock.wait)
    driver.capture()
    clock.now_s = late_s = clock.now_s + 1e6
    driver.capture()
    assert clock.now_s == late_s


def test_several_files_are_one_recording(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path, rotate_mb=0.03, flush_s=0.001)
    recorded.robot()
    recorded.bus.publish(CONTEXT, context())
    sent: list[pb.Frame] = []
    while len(list(tmp_path.glob("*.mcap"))) < 3:
        sent.append(recorded.look(len(sent)))
        wait_until(lambda: recorded.service.recording.inbox.bytes == 0, 60, "it is written")
    recorded.close()
    source = open_source(tmp_path)
    assert [source.read(i).recorded for i in range(len(source.shots))] == sent
    assert sum(len(source.contexts_before(i)) for i in range(len(sent))) == 1


def test_a_file_that_begins_without_a_message_repeats_the_context_of_the_one_before(
    tmp_path: Path,
) -> None:
    recorded = Recorded(tmp_path, rotate_mb=0.001, flush_s=0.001)
    recorded.robot()
    recorded.bus.publish(CONTEXT, context())
    recorded.look(0)
    wait_until(lambda: recorded.service.recording.inbox.bytes == 0, 60, "it is written")
    files = len(list(tmp_path.glob("*.mcap")))
    wait_until(lambda: len(list(tmp_path.glob("*.mcap"))) > files, 60, "an idle recorder goes on")
    recorded.look(1)
    recorded.close()
    source = open_source(tmp_path)
    assert len(source.shots) == 2
    assert [len(source.contexts_before(i)) for i in range(2)] == [1, 0]


def test_file_1000_is_sorted_after_file_999(tmp_path: Path) -> None:
    names = [f"20261121-120000-{n}.mcap" for n in ("998", "999", "1000")]
    for name in names:
        (tmp_path / name).write_bytes(b"x")
    assert [file.name for file in mcap_files(tmp_path)] == names


def test_an_empty_folder_named_like_a_recording_is_refused_by_name(tmp_path: Path) -> None:
    folder = tmp_path / "tour.mcap"
    folder.mkdir()
    with pytest.raises(InvalidInput, match=r"tour\.mcap"):
        open_source(folder)


def test_the_replay_driver_can_observe(recording: tuple[Path, list[pb.Frame]]) -> None:
    driver = ReplayDriver(recording[0])
    assert driver.act(Observe(), "a").succeeded
