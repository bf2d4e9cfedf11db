"""Queue of messages: bounded in bytes; a put never blocks."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass

from google.protobuf.message import Message

STREAM_SHARE = 0.5  # share of the limit for droppable messages; the rest is reserved


@dataclass(frozen=True)
class Item:
    """One message in the queue."""

    channel: str
    message: Message
    log_time_ns: int  # since 1970; rises from item to item
    size: int  # bytes


class MessageQueue:
    """Bounded queue. Thread-safe. Log times rise strictly, even if the clock does not."""

    def __init__(self, limit_bytes: float) -> None:
        self._limit = limit_bytes
        self._items: deque[Item] = deque()
        self._bytes = 0
        self._changed = threading.Condition()
        self._clock_ns = time.time_ns() - time.monotonic_ns()
        self._last_ns = 0
        self._closed = False

    def put(self, channel: str, message: Message, droppable: bool) -> bool:
        """Add a message; never blocks. False without room, of which droppable ones get a part."""
        size = message.ByteSize()
        with self._changed:
            room = self._limit * (STREAM_SHARE if droppable else 1.0) - self._bytes
            if self._closed or size > room:
                return False
            now_ns = self._clock_ns + time.monotonic_ns()
            self._last_ns = max(now_ns, self._last_ns + 1)
            self._items.append(Item(channel, message, self._last_ns, size))
            self._bytes += size
            self._changed.notify()
            return True

    def take(self, timeout_s: float) -> Item | None:
        """Oldest item; None if none came in time."""
        with self._changed:
            if not self._items and not self._closed:
                self._changed.wait(timeout_s)
            if not self._items:
                return None
            item = self._items.popleft()
            self._bytes -= item.size
            return item

    def close(self) -> None:
        """Accept no more messages; the queued ones can still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def closed(self) -> bool:
        """True if closed and empty."""
        with self._changed:
            return self._closed and not self._items

    @property
    def bytes(self) -> int:
        """Size of the queued messages."""
        with self._changed:
            return self._bytes
