"""What is written into a recording."""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message


@dataclass(frozen=True)
class Entry:
    """A message and its channel."""

    channel: str
    message: Message
