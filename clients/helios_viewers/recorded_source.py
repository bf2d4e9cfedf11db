"""Entries of a recording, ordered by log time."""

from __future__ import annotations

import bisect
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from google.protobuf import descriptor_pool, message_factory
from google.protobuf.message import DecodeError, Message
from helios_core.errors import InvalidInput
from helios_core.viewing import channels
from helios_core.viewing.entry import Entry
from helios_replay.format_detection import mcap_files
from helios_replay.mcap_file import Found, McapFile

KNOWN = channels.CHANNELS  # importing it declares the types


@dataclass(frozen=True)
class RecordedEntry:
    """Location of an entry in one of the files."""

    log_time_ns: int
    file: int
    found: Found


class RecordedSource:
    """A recording: one file, or a folder of consecutive ones. Not thread-safe."""

    def __init__(self, path: Path) -> None:
        """Raises InvalidInput if the recording is unreadable or has no message."""
        self._files = [McapFile(file) for file in mcap_files(path)]
        entries = [
            RecordedEntry(found.log_time_ns, k, found)
            for k, file in enumerate(self._files)
            for found in file.walk()
            if message_type(found.schema) is not None
        ]
        if not entries:
            raise InvalidInput(
                f"{path} has no message that a viewer can show; give a recording of `helios record`"
            )
        self.entries: Sequence[RecordedEntry] = sorted(entries, key=lambda e: e.log_time_ns)
        self._times_ns = [e.log_time_ns for e in self.entries]
        self.unreadable = 0  # number of messages that could not be read

    @property
    def channels(self) -> dict[str, type[Message]]:
        """Channels with their message types."""
        schemas = {e.found.topic: e.found.schema for e in self.entries}
        return {topic: kind for topic, name in schemas.items() if (kind := message_type(name))}

    @property
    def range_ns(self) -> tuple[int, int]:
        """Log times of the first and the last entry."""
        return self._times_ns[0], self._times_ns[-1]

    def first_from(self, time_ns: int) -> int:
        """Index of the first entry that is not older."""
        return bisect.bisect_left(self._times_ns, time_ns)

    def newest_before(self, index: int) -> list[int]:
        """Index of the last entry of each channel before `index`, in order: the state there."""
        newest: dict[str, int] = {}
        for k in range(index):
            newest[self.entries[k].found.topic] = k
        return sorted(newest.values())

    def read(self, index: int) -> Entry | None:
        """The entry; None if it is unreadable, which is counted."""
        entry = self.entries[index]
        kind = message_type(entry.found.schema)
        assert kind is not None
        message = kind()
        try:
            message.ParseFromString(self._files[entry.file].read(entry.found.place))
        except (InvalidInput, DecodeError):
            self.unreadable += 1
            return None
        return Entry(entry.found.topic, message)

    def __iter__(self) -> Iterator[tuple[int, Entry]]:
        """Log time (ns) and entry of every readable message."""
        for k, recorded in enumerate(self.entries):
            entry = self.read(k)
            if entry is not None:
                yield recorded.log_time_ns, entry


@cache
def message_type(name: str) -> type[Message] | None:
    """The message type of a schema name; None for a foreign one."""
    try:
        descriptor = descriptor_pool.Default().FindMessageTypeByName(name)
    except KeyError:
        return None
    return message_factory.GetMessageClass(descriptor)
