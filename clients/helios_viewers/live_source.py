"""Entries of a running robot, from the bus. Nobody waits for a viewer: a full queue drops."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import suppress

from google.protobuf.message import Message
from helios_core.bus import Bus
from helios_core.errors import HeliosError
from helios_core.viewing.bus_messages import BusMessages
from helios_core.viewing.entry import Entry
from helios_core.viewing.message_entries import Entries
from helios_core.viewing.message_queue import MessageQueue

log = logging.getLogger(__name__)

MAP_PERIOD_S = 1.0
QUEUE_BYTES = 128_000_000
JPEG_QUALITY = 85
TAKE_S = 0.1


class LiveSource:
    """Subscriber of every topic: see the module."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._queue = MessageQueue(QUEUE_BYTES)
        self._entries = Entries(JPEG_QUALITY)
        self.dropped = 0
        self._messages = BusMessages(bus, MAP_PERIOD_S, self._put, lambda _: None)

    def until(self, stopping: threading.Event) -> Iterator[tuple[int, Entry]]:
        """Log time (ns) and entry of each message, until `stopping` is set."""
        told = 0
        while not stopping.is_set():
            item = self._queue.take(TAKE_S)
            if self.dropped > told:
                told = self.dropped
                log.warning("this machine is too slow: %d messages were not shown", told)
            if item is None:
                continue
            try:
                entries = list(self._entries.of(item.channel, item.message, item.log_time_ns))
            except HeliosError as error:
                log.warning("a message of %s cannot be shown: %s", item.channel, error.message)
                continue
            for entry in entries:
                yield item.log_time_ns, entry

    def close(self) -> None:
        """Leave the bus."""
        self._messages.close()
        self._queue.close()
        with suppress(HeliosError):
            self._bus.close()

    def _put(self, channel: str, message: Message, droppable: bool) -> None:
        if not self._queue.put(channel, message, droppable):
            self.dropped += 1
