"""MCAP files, read so that neither a SIGKILL while they were written nor malice does harm.

A file is walked record by record from its start: indexes at its end are not needed, and reading
ends at the first record that is not whole. No size in it is believed before it is checked against
the file. Records themselves are parsed by the `mcap` library.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import lz4.frame
import zstandard
from helios_core.errors import InvalidInput
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from mcap.writer import MCAP0_MAGIC

LARGEST_CHUNK = 256_000_000  # bytes, unpacked; ours have four million
CACHED_CHUNKS = 3
_RECORD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time


class Broken(Exception):
    """A record that is not whole or makes no sense: where reading ends."""


@dataclass(frozen=True)
class Place:
    """Where the data of one message lies."""

    chunk: int  # offset of its chunk in the file; of the record itself where there are no chunks
    start: int  # within the unpacked chunk, or the file
    size: int
    chunked: bool


@dataclass(frozen=True)
class Found:
    """One message, not read yet."""

    topic: str
    schema: str
    log_time_ns: int
    publish_time_ns: int
    place: Place


class McapFile:
    """One open file. Not thread-safe."""

    def __init__(self, path: Path) -> None:
        """Raises InvalidInput when it is not there or no MCAP at all."""
        self.path = path
        self.topics: dict[str, str] = {}  # topic -> name of its schema, as far as it was walked
        self.cut: str = ""  # why the walk ended early
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
        """Every message, in the order of the file, as far as it is whole."""
        at = len(MCAP0_MAGIC)
        try:
            while at < self._size:
                opcode, length = self._head(at)
                body = at + _RECORD.size
                if opcode == Opcode.CHUNK:
                    yield from self._walk_chunk(at)
                elif opcode == Opcode.MESSAGE:
                    yield from self._message(self._bytes(body, length), at, body, chunked=False)
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._learn(opcode, self._bytes(body, length))
                elif opcode in (Opcode.DATA_END, Opcode.FOOTER):
                    return
                at = body + length
            self.cut = "it has no end: whoever wrote it was stopped"
        except Broken as error:
            self.cut = str(error)

    def read(self, place: Place) -> bytes:
        """The data of a message. Raises InvalidInput when it has become unreadable."""
        try:
            if not place.chunked:
                return self._bytes(place.start, place.size)
            return self._unpacked(place.chunk)[place.start : place.start + place.size]
        except Broken as error:
            raise InvalidInput(f"{self.path} cannot be read any more: {error}") from error

    # --- records ------------------------------------------------------------------------------
    def _head(self, at: int) -> tuple[int, int]:
        opcode, length = _RECORD.unpack(self._bytes(at, _RECORD.size))
        if length > self._size - at - _RECORD.size:
            raise Broken(f"the record at byte {at} claims {length} bytes, more than the file has")
        return opcode, length

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
            if len(data) - at < _RECORD.size:
                raise Broken(f"the chunk at byte {chunk} ends within a record")
            opcode, length = _RECORD.unpack_from(data, at)
            body = at + _RECORD.size
            if length > len(data) - body:
                raise Broken(f"the chunk at byte {chunk} ends within a record")
            if opcode == Opcode.MESSAGE:
                head = data[body : body + _MESSAGE.size]
                yield from self._message(head, chunk, body, chunked=True, length=length)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._learn(opcode, data[body : body + length])
            at = body + length

    def _message(
        self, head: bytes, chunk: int, body: int, chunked: bool, length: int | None = None
    ) -> Iterator[Found]:
        size = len(head) if length is None else length
        if size < _MESSAGE.size:
            raise Broken(f"the message at byte {chunk} is too short")
        number, _, log_time_ns, publish_time_ns = _MESSAGE.unpack_from(head)
        channel = self._channels.get(number)
        if channel is None:
            raise Broken(
                f"a message at byte {chunk} is of channel {number}, which nothing declares"
            )
        schema = self._schemas.get(channel.schema_id)
        place = Place(chunk, body + _MESSAGE.size, size - _MESSAGE.size, chunked)
        name = schema.name if schema else ""
        yield Found(channel.topic, name, log_time_ns, publish_time_ns, place)

    def _learn(self, opcode: int, data: bytes) -> None:
        stream = ReadDataStream(io.BytesIO(data))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self._schemas[schema.id] = schema
            else:
                channel = Channel.read(stream)
                self._channels[channel.id] = channel
                known = self._schemas.get(channel.schema_id)
                self.topics[channel.topic] = known.name if known else ""
        except Exception as error:  # whatever the library makes of bytes that are no record
            raise Broken(f"a schema or channel cannot be read ({type(error).__name__})") from error

    def _unpacked(self, at: int) -> bytes:
        if at in self._cache:
            self._cache.move_to_end(at)
            return self._cache[at]
        _, length = self._head(at)
        try:
            chunk = Chunk.read(ReadDataStream(io.BytesIO(self._bytes(at + _RECORD.size, length))))
        except Broken:
            raise
        except Exception as error:
            raise Broken(
                f"the chunk at byte {at} cannot be read ({type(error).__name__})"
            ) from error
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
