"""Message on a channel."""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message


@dataclass(frozen=True)
class Entry:
    """Message with the channel on which it is recorded or shown."""

    channel: str
    message: Message
