"""Damaged recordings: intact chunks are played, and lost chunks are reported."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from helios_client.replay.input_checks import examine
from helios_client.replay.run import PlaybackOptions, ReplayJob
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.recording_format import KEYFRAME_CHANNELS
from helios_core.types import Role, SearchClass, SearchContext
from helios_recorder.mcap_writer import RecordingFile
from helios_replay.format_detection import open_source
from helios_replay.mcap_damage import read_summary
from helios_replay.mcap_file import McapFile
from helios_replay.mcap_index import read_index
from helios_replay.mcap_recording import Recording
from helios_replay.recorded_detector import RecordedDetector
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC
from rich.console import Console

from tests.unit.replay.replay_recorded import record

FRAMES = 8
SEARCH = SearchContext("s", (SearchClass("box", Role.OBJECT, 0.5),))
Chunks = list[range]  # the byte range of each


@pytest.fixture(scope="module", params=["zstd", "lz4", "none"])
def tour(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[pb.Frame]]:
    folder = tmp_path_factory.mktemp("tour")
    return record(folder, FRAMES, chunk_mb=0.03, compression=request.param)


def chunks_of(path: Path) -> Chunks:
    data = path.read_bytes()
    summary = read_summary(lambda at, size: data[at : at + size], len(data))
    assert summary is not None
    return [
        range(c.chunk_start_offset, c.chunk_start_offset + c.chunk_length) for c in summary.chunks
    ]


def keyframe_chunks(path: Path) -> list[set[int]]:
    """For each keyframe, the start offsets of the chunks that hold its messages."""
    out: list[set[int]] = []
    for found in McapFile(path).walk():
        if found.topic == KEYFRAME_CHANNELS.head:
            out.append(set())
        if found.topic in (
            KEYFRAME_CHANNELS.head,
            KEYFRAME_CHANNELS.color,
            KEYFRAME_CHANNELS.depth,
        ):
            out[-1].add(found.place.chunk)
    return out


def damaged(path: Path, places: Sequence[int], out: Path, flip: int = 0xFF) -> Path:
    data = bytearray(path.read_bytes())
    for place in places:
        data[place] ^= flip
    out.write_bytes(data)
    return out


def played(path: Path, sent: Sequence[pb.Frame]) -> set[int]:
    """The numbers of the keyframes that are played; checks that each is as sent, in order."""
    source = open_source(path)
    came = [source.read(i).recorded for i in range(len(source.shots))]
    by_number = {frame.id.seq: frame for frame in sent}
    numbers = [frame.id.seq for frame in came if frame is not None]
    assert came == [by_number[number] for number in numbers]
    assert numbers == sorted(numbers)
    return set(numbers)


def whole(path: Path, sent: Sequence[pb.Frame], places: Sequence[int]) -> set[int]:
    """The numbers of the keyframes in chunks that hold none of these bytes."""
    hit = {c.start for c in chunks_of(path) if any(place in c for place in places)}
    its = zip(sent, keyframe_chunks(path), strict=True)
    return {frame.id.seq for frame, chunks in its if not chunks & hit}


def test_a_chunk_that_claims_to_reach_into_the_next_one_loses_itself_alone(
    tour: tuple[Path, list[pb.Frame]], tmp_path: Path
) -> None:
    path, sent = tour
    for place in range(3):
        length_byte = chunks_of(path)[0].start + 1 + place
        for bit in (0, 3, 7):
            broken = damaged(path, [length_byte], tmp_path / "long.mcap", 1 << bit)
            assert played(broken, sent) >= whole(path, sent, [length_byte])


@settings(max_examples=60, deadline=None)
@given(data=st.data(), flip=st.integers(1, 255))
def test_all_keyframes_in_intact_chunks_are_played(
    data: st.DataObject,
    flip: int,
    tour: tuple[Path, list[pb.Frame]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    path, sent = tour
    size, chunks = path.stat().st_size, chunks_of(path)
    places = data.draw(
        st.lists(st.integers(len(MCAP0_MAGIC), size - 1), min_size=1, max_size=4, unique=True)
    )
    broken = damaged(path, places, tmp_path_factory.getbasetemp() / "flipped.mcap", flip)
    # Channels are declared in the chunks, between them, and in the summary at the end.
    undeclared = len(places) > 1 and min(places) < chunks[-1].stop <= max(places)
    wanted = set() if undeclared else whole(path, sent, places)
    try:
        came = played(broken, sent)
    except InvalidInput:
        assert not wanted
        return
    assert came >= wanted
    index = read_index([broken])
    assert len(came) == FRAMES or index.lost or index.cut


def killed(path: Path, out: Path) -> Path:
    """The file of a killed recorder: without the records after its last chunk."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    last = max(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
    end = last.chunk_start_offset + last.chunk_length + last.message_index_length
    out.write_bytes(path.read_bytes()[:end])
    return out


@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_a_file_without_an_index_is_played_except_for_its_damaged_chunks(
    data: st.DataObject,
    tour: tuple[Path, list[pb.Frame]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    path, sent = tour
    chunks = chunks_of(path)
    hit = data.draw(st.lists(st.sampled_from(chunks[1:-1]), max_size=3, unique=True))
    places = [chunk.stop - 5 for chunk in (chunks[0], *hit)]
    folder = tmp_path_factory.getbasetemp()
    broken = damaged(killed(path, folder / "killed.mcap"), places, folder / "flipped.mcap")
    assert played(broken, sent) == whole(path, sent, places)


def test_a_channel_that_is_declared_after_its_messages_is_read(tmp_path: Path) -> None:
    """Damage to the first chunk and to the declarations after it has this effect."""
    path, sent = record(tmp_path, FRAMES, chunk_mb=0.03)
    chunks = chunks_of(path)
    data = bytearray(killed(path, tmp_path / "killed.mcap").read_bytes())
    late = bytes(data[chunks[0].stop : chunks[1].start])
    data[chunks[0].start : chunks[1].start] = bytes(chunks[1].start - chunks[0].start)
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(data + late)
    assert played(broken, sent) >= whole(path, sent, chunks[0])


def test_a_file_with_lost_channel_declarations_is_refused_with_the_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RecordingFile, "_declare", lambda _: None)  # like older recorders
    path, _ = record(tmp_path, FRAMES, chunk_mb=0.03)
    chunks = chunks_of(path)
    broken = damaged(killed(path, tmp_path / "killed.mcap"), [chunks[0].stop - 5], tmp_path / "b")
    whole_chunks = len(chunks) - 1
    with pytest.raises(InvalidInput, match=rf"list of channels was lost.*{whole_chunks} whole"):
        open_source(broken.rename(tmp_path / "broken.mcap"))


@pytest.mark.parametrize("number", [0, 1, -1])
def test_a_lost_chunk_is_reported_with_its_size_and_time(
    number: int, tour: tuple[Path, list[pb.Frame]], tmp_path: Path
) -> None:
    path, _ = tour
    chunk = chunks_of(path)[number]
    source = open_source(damaged(path, [chunk.stop - 5], tmp_path / "broken.mcap"))
    assert isinstance(source, Recording)
    (lost,) = source.lost
    assert (lost.at, lost.chunks) == (chunk.start, 1)
    assert lost.size >= len(chunk)
    assert 0 <= lost.seconds < 5
    assert "checksum" in lost.why or "cannot be unpacked" in lost.why


def test_a_carried_camera_replaces_a_lost_robot_description(
    tour: tuple[Path, list[pb.Frame]], tmp_path: Path
) -> None:
    path, _ = tour
    first = chunks_of(path)[0]
    source = open_source(damaged(path, [first.stop - 5], tmp_path / "broken.mcap"))
    assert isinstance(source, Recording)
    assert "carries" in source.assumed
    robot = source.describe()
    assert not robot.can_move
    assert robot.camera == source.read(0).camera


def test_answers_to_a_lost_search_context_are_dropped(
    tour: tuple[Path, list[pb.Frame]], tmp_path: Path
) -> None:
    path, _ = tour
    first = chunks_of(path)[0]
    broken = damaged(path, [first.stop - 5], tmp_path / "broken.mcap")
    source = open_source(broken)
    assert not any(source.contexts_before(i) for i in range(len(source.shots)))
    assert not read_index([broken]).observations
    with pytest.raises(InvalidInput, match="--detector"):
        RecordedDetector(MemoryBus(MemoryHub()), broken, Health())


def test_a_file_without_an_intact_chunk_is_refused_with_the_cause(
    tour: tuple[Path, list[pb.Frame]], tmp_path: Path
) -> None:
    path, _ = tour
    broken = damaged(path, [c.stop - 5 for c in chunks_of(path)], tmp_path / "broken.mcap")
    with pytest.raises(InvalidInput, match=r"no keyframe.*the chunk at byte") as error:
        open_source(broken)
    assert "\n" not in error.value.message


def test_reading_a_completely_damaged_file_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_replay.mcap_file.MOST_DAMAGES", 5)
    body = struct.pack("<QQQI", 0, 0, 9, 1) + struct.pack("<I", 0) + struct.pack("<Q", 0)
    path = tmp_path / "x.mcap"
    path.write_bytes(MCAP0_MAGIC + (struct.pack("<BQ", 6, len(body)) + body) * 100)
    file = McapFile(path)
    assert list(file.walk()) == []
    assert "another size" in file.cut


def test_keyframes_after_a_false_length_are_played(
    tour: tuple[Path, list[pb.Frame]], tmp_path: Path
) -> None:
    """The false length is that of a chunk or of the index after it."""
    path, sent = tour
    chunks = chunks_of(path)
    for place in (chunks[1].start + 1, chunks[1].start + 3, chunks[1].stop + 1):
        broken = damaged(path, [place], tmp_path / "broken.mcap", flip=0x40)
        assert played(broken, sent) >= whole(path, sent, [place])


def test_a_strict_replay_refuses_a_truncated_recording(
    tour: tuple[Path, list[pb.Frame]], tmp_path: Path
) -> None:
    cut = tmp_path / "cut.mcap"
    data = tour[0].read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    screen = Console(quiet=True)
    job = ReplayJob(cut, SEARCH, "paint", tmp_path)
    assert examine(job, screen).frames < FRAMES
    strict = replace(job, playback=PlaybackOptions(strict=True))
    with pytest.raises(InvalidInput, match=r"is cut off.*without --strict"):
        examine(strict, screen)
