"""Recovery of damaged MCAP files: the summary, if intact, and the search for the next chunk."""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer
from mcap.writer import MCAP0_MAGIC

Read = Callable[[int, int], bytes]  # offset, size -> exactly that many bytes; raises otherwise

LARGEST_SUMMARY = 64_000_000  # bytes
RECORD = struct.Struct("<BQ")  # opcode, length
_FOOTER_SIZE = RECORD.size + 20
_WINDOW = 1 << 16  # bytes searched at a time
# A chunk record up to its data: opcode, length, two times, size, CRC, compression, data's length.
_CHUNK_HEAD = re.compile(
    rb"(?=\x06(.{8}).{16}.{8}.{4}(?:(\x04\0\0\0zstd)|(\x03\0\0\0lz4)|\0\0\0\0)(.{8}))", re.DOTALL
)
_LONGEST_HEAD = RECORD.size + 28 + 8 + 8


class Broken(Exception):
    """Raised for an incomplete or invalid record."""


class Undeclared(Broken):
    """Raised for a message of an undeclared channel."""


@dataclass(frozen=True)
class Lost:
    """An unreadable stretch of a file."""

    at: int  # bytes from the start of the file
    size: int  # bytes
    chunks: int
    seconds: float  # duration of the lost part by the log times around it; 0 if unknown
    why: str


@dataclass(frozen=True)
class Summary:
    """The summary of a complete file: its schemas and channels and the index of its chunks."""

    declared: Sequence[tuple[int, bytes]] = ()  # opcode, record: schemas, then channels
    chunks: Sequence[ChunkIndex] = ()

    def lost_between(self, begin: int, end: int) -> list[ChunkIndex]:
        """Chunks that start in [begin, end)."""
        return [c for c in self.chunks if begin <= c.chunk_start_offset < end]


def read_summary(read: Read, size: int) -> Summary | None:
    """The file's summary; None if it is missing or fails its checksum. `size`: of the file, in
    bytes."""
    try:
        at = size - len(MCAP0_MAGIC) - _FOOTER_SIZE
        opcode, length = RECORD.unpack(read(at, RECORD.size))
        if (opcode, length) != (Opcode.FOOTER, 20):
            return None
        footer = Footer.read(ReadDataStream(io.BytesIO(read(at + RECORD.size, 20))))
        start = footer.summary_start
        if not 0 < start <= at or at - start > LARGEST_SUMMARY or not footer.summary_crc:
            return None
        data = read(start, at - start + _FOOTER_SIZE - 4)
        if zlib.crc32(data) != footer.summary_crc:
            return None
        return _parsed(data[: at - start])
    except Exception:  # the library raises various types for malformed bytes
        return None


def _parsed(data: bytes) -> Summary:
    declared: list[tuple[int, bytes]] = []
    chunks: list[ChunkIndex] = []
    at = 0
    while at < len(data):
        opcode, length = RECORD.unpack_from(data, at)
        record = data[at + RECORD.size : at + RECORD.size + length]
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            declared.append((opcode, record))
        elif opcode == Opcode.CHUNK_INDEX:
            chunks.append(ChunkIndex.read(ReadDataStream(io.BytesIO(record))))
        at += RECORD.size + length
    return Summary(sorted(declared, key=lambda one: one[0]), chunks)


def next_chunk(read: Read, begin: int, size: int, before: int | None = None) -> int | None:
    """Offset of the first likely chunk record that starts in [begin, before); None without any.

    The lengths in its header agree, and it ends within the file of `size` bytes. before: None is
    the end of the file.
    """
    last = size if before is None else before
    for at in range(begin, last, _WINDOW):
        window = read(at, min(_WINDOW + _LONGEST_HEAD, size - at))
        for found in _CHUNK_HEAD.finditer(window):
            start = at + found.start()
            length, packed = (int.from_bytes(found[k], "little") for k in (1, 4))
            name = 4 if found[2] else 3 if found[3] else 0
            agree = length == 28 + 4 + name + 8 + packed
            fits = start < last and start + RECORD.size + length <= size
            if found.start() < _WINDOW and agree and fits:
                return start
    return None
