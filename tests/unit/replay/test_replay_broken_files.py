"""Truncated, foreign and malicious files are played as far as they are intact, or refused."""

from __future__ import annotations

import contextlib
import re
import struct
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import pytest
from helios_core import proto as pb
from helios_core.errors import HeliosError, InvalidInput
from helios_core.recording_format import KEYFRAME_CHANNELS
from helios_replay.format_detection import open_source
from helios_replay.mcap_file import LARGEST_CHUNK, McapFile
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from tests.unit.recorder.recorder_bus import frame
from tests.unit.replay.replay_recorded import record


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 1))
def test_a_truncated_file_plays_up_to_the_cut(
    share: float,
    recording: tuple[Path, list[pb.Frame]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    path, sent = recording
    data = path.read_bytes()
    cut = tmp_path_factory.getbasetemp() / "cut.mcap"
    cut.write_bytes(data[: int(share * len(data))])
    try:
        source = open_source(cut)
    except InvalidInput:
        return  # no intact keyframe is left
    came = [source.read(i).recorded for i in range(len(source.shots))]
    assert came == sent[: len(came)]
    assert came
    assert len(came) == len(sent) or getattr(source, "cut", "")


def test_at_least_half_of_the_keyframes_of_a_file_cut_at_75_percent_are_read(
    recording: tuple[Path, list[pb.Frame]], tmp_path: Path
) -> None:
    path, sent = recording
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[: int(path.stat().st_size * 0.75)])
    assert len(open_source(cut).shots) >= len(sent) // 2


@settings(max_examples=150, deadline=None)
@given(at=st.floats(0, 1), junk=st.binary(min_size=1, max_size=12))
def test_junk_bytes_in_a_file_raise_only_typed_errors(
    at: float,
    junk: bytes,
    recording: tuple[Path, list[pb.Frame]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    data = bytearray(recording[0].read_bytes())
    start = int(at * (len(data) - len(junk)))
    data[start : start + len(junk)] = junk
    path = tmp_path_factory.getbasetemp() / "junk.mcap"
    path.write_bytes(bytes(data))
    with contextlib.suppress(HeliosError):
        source = open_source(path)
        for i in range(len(source.shots)):
            source.read(i)


def test_a_chunk_with_a_wrong_checksum_is_not_played(tmp_path: Path) -> None:
    path, _ = record(tmp_path, compression="none")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    file = McapFile(path)
    list(file.walk())
    assert file.cut == ""
    assert ["checksum" in lost.why for lost in file.lost] == [True]


def written(path: Path, write: Callable[[Writer], None]) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start()
        write(writer)
        writer.finish()
    return path


def foreign(writer: Writer) -> None:
    schema = writer.register_schema("std_msgs/String", "jsonschema", b"{}")
    channel = writer.register_channel("/chatter", "json", schema)
    writer.add_message(channel, 1, b"{}", 1)


def of_ros(writer: Writer) -> None:
    schema = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"")
    channel = writer.register_channel("/camera", "cdr", schema)
    writer.add_message(channel, 1, b"", 1)


def no_description(writer: Writer) -> None:
    names = {
        KEYFRAME_CHANNELS.head: "helios.v1.Frame",
        KEYFRAME_CHANNELS.color: "foxglove.CompressedImage",
        KEYFRAME_CHANNELS.depth: "foxglove.RawImage",
    }
    data = frame(0).SerializeToString()
    for topic, name in names.items():
        schema = writer.register_schema(name, "protobuf", b"")
        writer.add_message(writer.register_channel(topic, "protobuf", schema), 1, data, 1)


def no_pixels(writer: Writer) -> None:
    schema = writer.register_schema("helios.v1.Frame", "protobuf", b"")
    channel = writer.register_channel(KEYFRAME_CHANNELS.head, "protobuf", schema)
    writer.add_message(channel, 1, b"", 1)


def no_protobuf(writer: Writer) -> None:
    schema = writer.register_schema("helios.v1.Frame", "protobuf", b"")
    channel = writer.register_channel(KEYFRAME_CHANNELS.head, "protobuf", schema)
    writer.add_message(channel, 1, b"\xff\xff\xff", 1)


def nothing(_: Writer) -> None:
    pass


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (foreign, "/chatter"),
        (of_ros, "ROS 2 bag"),
        (no_description, "which robot"),
        (no_pixels, "pixels"),
        (no_protobuf, "helios.v1.Frame"),
        (nothing, "empty"),
    ],
)
def test_an_unplayable_file_is_refused_in_one_sentence(
    write: Callable[[Writer], None], words: str, tmp_path: Path
) -> None:
    path = written(tmp_path / "x.mcap", write)
    with pytest.raises(InvalidInput, match=words) as error:
        open_source(path)
    assert "\n" not in error.value.message
    assert str(path) in error.value.message


@pytest.mark.parametrize("data", [b"", b"not an mcap at all", b"\x89MCAP0\r\n"])
def test_a_file_that_is_no_mcap_is_refused(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    with pytest.raises(InvalidInput, match=r"no MCAP|no keyframe"):
        open_source(path)


def chunk(claimed: int, packed: bytes, compression: bytes) -> bytes:
    body = struct.pack("<QQQI", 0, 0, claimed, 0)
    body += struct.pack("<I", len(compression)) + compression
    body += struct.pack("<Q", len(packed)) + packed
    return b"\x89MCAP0\r\n" + struct.pack("<BQ", 0x06, len(body)) + body


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"\x89MCAP0\r\n" + struct.pack("<BQ", 0x03, 2**63), "more than the file has"),
        (
            b"\x89MCAP0\r\n" + struct.pack("<BQ", 0x06, 2**64 - 1) + b"x" * 100,
            "more than the file has",
        ),
        (chunk(2**62, b"x", b"zstd"), "are read"),
        (chunk(100, lz4.frame.compress(bytes(50_000_000)), b"lz4"), "another size"),
        (chunk(LARGEST_CHUNK + 1, b"", b"lz4"), f"{LARGEST_CHUNK} are read"),
        (chunk(10, b"0123456789", b"bzip2"), "bzip2"),
        (chunk(10, b"0123456789", b""), "."),
    ],
)
def test_records_with_false_sizes_or_unknown_compression_are_not_read(
    data: bytes, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    file = McapFile(path)
    assert list(file.walk()) == []
    assert re.search(words, "; ".join([file.cut, *(lost.why for lost in file.lost)]))
    with pytest.raises(InvalidInput, match="no keyframe"):
        open_source(path)
