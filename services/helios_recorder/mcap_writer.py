"""Writer of one MCAP file: chunks, indexes, schemas, and the check for a full disk."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

from helios_core.recording_format import PROFILE
from helios_core.viewing.entry import Entry
from helios_core.viewing.mcap_channels import McapChannels
from mcap.data_stream import RecordBuilder
from mcap.writer import CompressionType, Writer

from helios_recorder.settings import MB, Settings

COMPRESSION = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}
SYNC_EVERY_S = 5.0  # to the disk; a power cut loses this much at most
DECLARE_EVERY_S = 10.0  # each time 80 kB


class DiskFull(Exception):
    """The disk has no room for more; the message says so in one sentence."""


class RecordingFile:
    """MCAP file that is being written, created with its folder.

    Schemas and channels are in the chunk that first needs them. They are repeated between chunks,
    after each chunk that may declare some and every `DECLARE_EVERY_S`. So a file without indexes is
    readable after a damaged first chunk.

    All methods may raise OSError; after that, only `abandon` is allowed. After DiskFull the file is
    consistent, and `finish` completes it.
    """

    def __init__(self, path: Path, settings: Settings) -> None:
        """Create the file. Raises OSError, and DiskFull if too little space is free."""
        self.path, self._settings = path, settings
        path.parent.mkdir(parents=True, exist_ok=True)
        _check_room(path.parent, settings)
        self._stream = path.open("xb")
        self._writer = Writer(
            self._stream,
            chunk_size=int(settings.chunk_mb * MB),
            compression=COMPRESSION[settings.compression],
        )
        self._table = McapChannels(self._writer)
        self._declared = 0  # channels already repeated between two chunks
        self._declared_s = time.monotonic()
        self._began_s = self._flushed_s = self._synced_s = time.monotonic()
        self._sequence = 0
        try:
            self._writer.start(profile=PROFILE)
            self._stream.flush()
        except OSError:  # leave no empty file behind for each attempt
            self.abandon()
            path.unlink(missing_ok=True)
            raise

    def write(self, entry: Entry, log_time_ns: int, publish_time_ns: int) -> None:
        """Add an entry to the current chunk."""
        before = self.bytes
        channel = self._table.channel(entry.channel, type(entry.message))
        self._sequence = (self._sequence + 1) % 2**32
        self._writer.add_message(
            channel.id,
            log_time_ns,
            entry.message.SerializeToString(),
            publish_time_ns,
            self._sequence,
        )
        if self.bytes > before:
            self._declare()

    def flush_if_due(self) -> bool:
        """Write out the chunk if it is due. True if it was."""
        now_s = time.monotonic()
        if now_s - self._flushed_s < self._settings.flush_s:
            return False
        self._flushed_s = now_s
        before = self.bytes
        self._writer.flush()
        if self.bytes > before:
            self._declare()
            self._stream.flush()
        if now_s - self._synced_s >= SYNC_EVERY_S:
            self._synced_s = now_s
            os.fdatasync(self._stream.fileno())
        return True

    def check_room(self) -> None:
        """Raise DiskFull if little space is left."""
        _check_room(self.path.parent, self._settings)

    @property
    def bytes(self) -> int:
        """Number of bytes written so far."""
        return self._stream.tell()

    @property
    def is_over(self) -> bool:
        """True if the file is large or old enough to be followed by the next."""
        age_min = (time.monotonic() - self._began_s) / 60
        return self.bytes >= self._settings.rotate_mb * MB or age_min >= self._settings.rotate_min

    def finish(self) -> None:
        """Write the indexes and close."""
        self._writer.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._stream.close()

    def abandon(self) -> None:
        """Close without indexes; complete chunks stay readable."""
        try:
            self._stream.close()
        except OSError:  # the buffered rest is lost
            self._stream.raw.close()

    def _declare(self) -> None:
        """Repeat all schemas and channels if due. Call it only between two chunks."""
        now_s, count = time.monotonic(), len(self._table.channels)
        if self._declared == count and now_s - self._declared_s < DECLARE_EVERY_S:
            return
        self._declared, self._declared_s = count, now_s
        records = RecordBuilder()
        for one in (*self._table.schemas.values(), *self._table.channels.values()):
            one.write(records)
        self._stream.write(records.end())


def _check_room(folder: Path, settings: Settings) -> None:
    free = shutil.disk_usage(folder).free
    if free < settings.min_free_mb * MB:
        raise DiskFull(
            f"{folder} has {free / MB:.0f} MB left and {settings.min_free_mb:g} MB are kept free"
        )
