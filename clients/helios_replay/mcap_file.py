"""Fault-tolerant reader of MCAP files that are truncated (SIGKILL during writing) or damaged.

It walks a file record by record from its start, without the indexes at the end. It skips damaged
stretches, reports them in `lost`, and continues at the next intact chunk. It checks every size in a
file against the file before use. The `mcap` library parses the records.

Schemas and channels come from the summary at the end, or without one from anywhere in the file.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import lz4.frame
import zstandard
from helios_core.errors import InvalidInput
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from mcap.writer import MCAP0_MAGIC

from helios_replay.mcap_damage import (
    RECORD,
    Broken,
    Lost,
    Summary,
    Undeclared,
    next_chunk,
    read_summary,
)

LARGEST_CHUNK = 256_000_000  # bytes, unpacked; HELIOS writes chunks of four million
CACHED_CHUNKS = 3
MOST_DAMAGES = 10_000  # damaged stretches of one file; after these the walk ends
_KNOWN = frozenset(Opcode)
_ENDS = (Opcode.DATA_END, Opcode.FOOTER)  # records that end the messages
_INDEX = struct.Struct("<HI")  # channel, length of the entries in bytes
_CHUNK_FIELDS = 40  # bytes of a chunk record besides the name of its compression and its data
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time


@dataclass(frozen=True)
class DataLocation:
    """Location of one message's data."""

    chunk: int  # offset of its chunk in the file, or of its record outside chunks
    start: int  # offset within the unpacked chunk, or within the file
    size: int
    chunked: bool


@dataclass(frozen=True)
class Found:
    """One message that the walk found; its data is not read yet."""

    topic: str
    schema: str
    log_time_ns: int
    publish_time_ns: int
    place: DataLocation


@dataclass(frozen=True)
class _Stretch:
    """A stretch of a file: one record, or unreadable bytes."""

    begin: int
    end: int
    found: Sequence[Found] = ()
    why: str = ""  # why it is unreadable; empty if readable
    broken: int = 0  # number of unreadable records

    def with_next(self, other: _Stretch) -> _Stretch:
        return _Stretch(self.begin, other.end, (), self.why, self.broken + other.broken)


class McapFile:
    """One open file. Not thread-safe."""

    def __init__(self, path: Path) -> None:
        """Raises InvalidInput when the file is missing or is not MCAP."""
        self.path = path
        self.topics: dict[str, str] = {}  # topic -> schema name, as found so far
        self.cut: str = ""  # why the walk ended early
        self.lost: list[Lost] = []  # stretches that the walk skipped
        self.undeclared = 0  # intact chunks among them with undeclared channels
        self._searched = False  # True once the whole file was searched for channel declarations
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        self._cache: OrderedDict[int, bytes] = OrderedDict()
        if not path.exists():
            raise InvalidInput(f"there is no recording at {path}; give one that is there")
        try:
            self._file = path.open("rb")
            self._size = path.stat().st_size
            magic = self._file.read(len(MCAP0_MAGIC))
        except OSError as error:
            raise InvalidInput(f"{path} cannot be read: {error.strerror}") from error
        if magic != MCAP0_MAGIC:
            raise InvalidInput(f"{path} is no MCAP file; give one that `helios record` has written")

    def walk(self) -> Iterator[Found]:
        """Every intact message, in file order."""
        self.cut, self.lost, self.undeclared = "", [], 0
        summary = read_summary(self._bytes, self._size)
        for opcode, record in summary.declared if summary else ():
            self._learn(opcode, record)
        gap: _Stretch | None = None  # damage since the last message
        before_ns = 0  # log time of that message
        for stretch in self._stretches():
            if stretch.why:
                gap = stretch if gap is None else gap.with_next(stretch)
            for found in stretch.found:
                if gap is not None:
                    self._note_lost(gap, summary, found.log_time_ns - before_ns if before_ns else 0)
                    gap = None
                before_ns = max(before_ns, found.log_time_ns)
                yield found
        if gap is not None and gap.end == self._size and summary is None:
            self.cut = gap.why
        elif gap is not None:
            self._note_lost(gap, summary, 0)

    def read(self, place: DataLocation) -> bytes:
        """The data of a message. Raises InvalidInput when the file is no longer readable."""
        try:
            if not place.chunked:
                return self._bytes(place.start, place.size)
            return self._unpacked(place.chunk)[place.start : place.start + place.size]
        except Broken as error:
            raise InvalidInput(f"{self.path} cannot be read any more: {error}") from error

    # --- records ------------------------------------------------------------------------------
    def _stretches(self) -> Iterator[_Stretch]:
        """The stretches of the file in order: records and the damage between intact ones."""
        at = whole = len(MCAP0_MAGIC)  # whole: end of the last intact chunk
        damages = 0
        while at < self._size:
            try:
                opcode, end = self._record(at)
                found = self._declared_content(opcode, at, end)
            except Broken as error:
                self.undeclared += isinstance(error, Undeclared)
                begin, end = self._unreadable(at, whole)
                damages += 1
                if damages == MOST_DAMAGES:
                    end = self._size
                yield _Stretch(begin, end, why=str(error), broken=1)
                if end == self._size:
                    return
                at = whole = end
                continue
            yield _Stretch(at, end, found)
            if opcode in _ENDS:
                return
            at = end
            if opcode == Opcode.CHUNK:
                whole = end
        self.cut = "it has no end: whoever wrote it was stopped"

    def _unreadable(self, at: int, whole: int) -> tuple[int, int]:
        """(begin, end) of the stretch that is unreadable because of the broken record at `at`: one
        chunk if a record follows it and no chunk begins within the length that it claims, else
        everything up to the next chunk after the last `whole` one, or to the end of the file."""
        with suppress(Broken):
            opcode, end = self._record(at)
            if opcode == Opcode.CHUNK and self._record(end):
                inside = next_chunk(self._bytes, at + 1, self._size, before=end)
                return at, end if inside is None else inside
        behind = next_chunk(self._bytes, whole if at > whole else at + 1, self._size)
        return min(at, whole), self._size if behind is None else behind

    def _note_lost(self, gap: _Stretch, summary: Summary | None, gap_ns: int) -> None:
        """Add a damaged stretch to `lost`.

        gap_ns: time from the last message before it to the first one after it.
        """
        chunks, seconds = gap.broken, gap_ns / 1e9
        if summary is not None:
            inside = summary.lost_between(gap.begin, gap.end)
            chunks = len(inside)
            seconds = sum(c.message_end_time - c.message_start_time for c in inside) / 1e9
        if chunks:  # otherwise only indexes are damaged
            size = gap.end - gap.begin
            self.lost.append(Lost(gap.begin, size, chunks, max(0.0, seconds), gap.why))

    def _record(self, at: int) -> tuple[int, int]:
        """(opcode, end) of the record at `at`. Raises Broken if it does not fit into the file."""
        opcode, length = RECORD.unpack(self._bytes(at, RECORD.size))
        if opcode not in _KNOWN:
            raise Broken(f"what is at byte {at} is no record of MCAP")
        if length > self._size - at - RECORD.size:
            raise Broken(f"the record at byte {at} claims {length} bytes, more than the file has")
        return opcode, at + RECORD.size + length

    def _declared_content(self, opcode: int, at: int, end: int) -> list[Found]:
        """Like `_content`, but search the whole file once for channels undeclared so far."""
        try:
            return self._content(opcode, at, end)
        except Undeclared:
            if self._searched:
                raise
        self._searched = True
        for _ in self._stretches():
            pass
        self.cut, self.undeclared = "", 0
        return self._content(opcode, at, end)

    def _content(self, opcode: int, at: int, end: int) -> list[Found]:
        """The messages of a record; stores the schemas and channels that it declares."""
        body = at + RECORD.size
        if opcode == Opcode.CHUNK:
            return list(self._walk_chunk(at))
        if opcode == Opcode.MESSAGE:
            return [self._message(self._bytes(body, end - body), at, body, chunked=False)]
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self._learn(opcode, self._bytes(body, end - body), checked=False)
        elif opcode == Opcode.MESSAGE_INDEX:
            if end - body < _INDEX.size or _INDEX.unpack(self._bytes(body, _INDEX.size))[1] != (
                end - body - _INDEX.size
            ):
                raise Broken(f"the index at byte {at} does not have the length it claims")
        elif opcode in _ENDS and next_chunk(self._bytes, end, self._size) is not None:
            raise Broken(f"the record at byte {at} ends a file that goes on")
        return []

    def _bytes(self, at: int, size: int) -> bytes:
        if size > min(self._size - at, LARGEST_CHUNK):
            raise Broken(f"the record at byte {at} is cut off or too large")
        try:
            self._file.seek(at)
            data = self._file.read(size)
        except OSError as error:
            raise Broken(f"byte {at} cannot be read: {error.strerror}") from error
        if len(data) != size:
            raise Broken(f"the record at byte {at} is cut off")
        return data

    def _walk_chunk(self, chunk: int) -> Iterator[Found]:
        data = self._unpacked(chunk)
        at = 0
        while at < len(data):
            if len(data) - at < RECORD.size:
                raise Broken(f"the chunk at byte {chunk} ends within a record")
            opcode, length = RECORD.unpack_from(data, at)
            body = at + RECORD.size
            if length > len(data) - body:
                raise Broken(f"the chunk at byte {chunk} ends within a record")
            if opcode == Opcode.MESSAGE:
                yield self._message(data[body : body + length], chunk, body, chunked=True)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._learn(opcode, data[body : body + length])
            at = body + length

    def _message(self, record: bytes, chunk: int, body: int, chunked: bool) -> Found:
        size = len(record)
        if size < _MESSAGE.size:
            raise Broken(f"the message at byte {chunk} is too short")
        number, _, log_time_ns, publish_time_ns = _MESSAGE.unpack_from(record)
        channel = self._channels.get(number)
        if channel is None:
            raise Undeclared(
                f"a message at byte {chunk} is of channel {number}, which nothing declares"
            )
        schema = self._schemas.get(channel.schema_id)
        if schema is None and channel.schema_id:
            raise Undeclared(
                f"a message at byte {chunk} is of {channel.topic}, whose schema is lost"
            )
        place = DataLocation(chunk, body + _MESSAGE.size, size - _MESSAGE.size, chunked)
        name = schema.name if schema else ""
        return Found(channel.topic, name, log_time_ns, publish_time_ns, place)

    def _learn(self, opcode: int, data: bytes, checked: bool = True) -> None:
        """Store a schema or channel. checked: covered by a checksum; only such records replace
        known ones."""
        stream = ReadDataStream(io.BytesIO(data))
        try:
            record = Schema.read(stream) if opcode == Opcode.SCHEMA else Channel.read(stream)
        except Exception as error:  # the library raises various types for malformed records
            raise Broken(f"a schema or channel cannot be read ({type(error).__name__})") from error
        if isinstance(record, Schema):
            if checked or record.id not in self._schemas:
                self._schemas[record.id] = record
        elif checked or record.id not in self._channels:
            self._channels[record.id] = record
            known = self._schemas.get(record.schema_id)
            self.topics[record.topic] = known.name if known else ""

    def _unpacked(self, at: int) -> bytes:
        if at in self._cache:
            self._cache.move_to_end(at)
            return self._cache[at]
        _, end = self._record(at)
        body = at + RECORD.size
        try:
            chunk = Chunk.read(ReadDataStream(io.BytesIO(self._bytes(body, end - body))))
        except Broken:
            raise
        except Exception as error:
            raise Broken(
                f"the chunk at byte {at} cannot be read ({type(error).__name__})"
            ) from error
        if end - body != _CHUNK_FIELDS + len(chunk.compression) + len(chunk.data):
            raise Broken(f"the chunk at byte {at} does not have the length it claims")
        data = _unpack(chunk, at)
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise Broken(f"the chunk at byte {at} does not have the checksum it claims")
        self._cache[at] = data
        while len(self._cache) > CACHED_CHUNKS:
            self._cache.popitem(last=False)
        return data


def _unpack(chunk: Chunk, at: int) -> bytes:
    size = chunk.uncompressed_size
    if size > LARGEST_CHUNK:
        raise Broken(f"the chunk at byte {at} claims {size} bytes; {LARGEST_CHUNK} are read")
    try:
        if chunk.compression == "zstd":
            with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
                data = reader.read(size + 1)
        elif chunk.compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        elif chunk.compression == "":
            data = chunk.data
        else:
            raise Broken(f"the chunk at byte {at} is packed with {chunk.compression[:20]!r}")
    except (zstandard.ZstdError, RuntimeError, ValueError, MemoryError) as error:
        raise Broken(f"the chunk at byte {at} cannot be unpacked ({error})") from error
    if len(data) != size:
        raise Broken(f"the chunk at byte {at} unpacks to another size than it claims")
    return bytes(data)
