"""Encoded messages of a black box, and the MCAP file made of them."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import zstandard
from google.protobuf.message import Message
from helios_core.recording_format import PROFILE
from helios_core.viewing.entry import Entry
from helios_core.viewing.mcap_channels import McapChannels
from mcap.writer import CompressionType, Writer

LARGE_BYTES = 16_000  # from here on a message is compressed while it waits
METADATA = "helios.fault"  # name of the metadata record: what the recording was made for


@dataclass(frozen=True)
class BoxMessage:
    """One encoded message of a channel; log time in nanoseconds since 1970."""

    channel: str
    kind: type[Message]
    data: bytes
    is_compressed: bool
    log_time_ns: int

    @property
    def size(self) -> int:
        """Bytes that it takes in memory, about."""
        return len(self.data) + 200

    def content(self) -> bytes:
        return zstandard.decompress(self.data) if self.is_compressed else self.data

    def at(self, log_time_ns: int) -> BoxMessage:
        """The message with another log time."""
        return replace(self, log_time_ns=log_time_ns)


def compressed(entry: Entry, log_time_ns: int) -> BoxMessage:
    """Encode an entry; large ones are compressed."""
    data = entry.message.SerializeToString()
    large = len(data) >= LARGE_BYTES
    return BoxMessage(
        entry.channel,
        type(entry.message),
        zstandard.compress(data, 1) if large else data,
        large,
        log_time_ns,
    )


def mcap_bytes(messages: Iterable[BoxMessage], about: Mapping[str, str]) -> bytes:
    """MCAP file of the messages; `about` goes into its metadata record."""
    stream = io.BytesIO()
    writer = Writer(stream, compression=CompressionType.ZSTD)
    writer.start(profile=PROFILE)
    table = McapChannels(writer)
    for number, message in enumerate(messages):
        channel = table.channel(message.channel, message.kind)
        writer.add_message(
            channel.id, message.log_time_ns, message.content(), message.log_time_ns, number
        )
    writer.add_metadata(METADATA, dict(about))
    writer.finish()
    return stream.getvalue()
