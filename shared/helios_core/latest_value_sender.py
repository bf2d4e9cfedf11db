"""Delivery of latest-wins topics over Zenoh: the newest message eventually reaches every reader.

BLOCK_FIRST lets one message wait on each link, at the sender and at the router, and drops messages
that arrive meanwhile. It may thus drop the newest message and deliver an older one. So the sender
repeats its newest message until a newer one follows, and readers skip messages that they have
received. The sender and other readers never block.
"""

from __future__ import annotations

import logging
import threading
import time
import uuid
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import zenoh

from helios_core.shared_payloads import Payload

log = logging.getLogger(__name__)

# Seconds between repetitions. Their sum exceeds the 5 s after which Zenoh either sends a waiting
# message or closes the link, so the last repetition gets through.
PAUSES_S = (0.25, 0.5, 1.0, 2.0, 4.0)
REMEMBERED = 64  # number of sources whose newest message number a reader stores


class Put(Protocol):
    """Signature of `zenoh.Publisher.put`."""

    def __call__(self, payload: Payload, *, attachment: str) -> None: ...


@dataclass
class _Newest:
    """Newest message of one topic. `turn` is held while it is sent, so that a repetition cannot
    overtake a newer message."""

    put: Put
    turn: threading.Lock = field(default_factory=threading.Lock)
    number: int = 0
    data: Payload = b""
    repeated: int = 0
    due_s: float | None = None  # time of the next repetition; None: no further one


class Repeater:
    """Sender of latest-wins topics that repeats the newest message of each. Thread-safe."""

    def __init__(
        self,
        start_thread: Callable[[str, Callable[[], None]], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """start_thread: runs a named job until `close`; called at the first message.
        clock: monotonic seconds."""
        self._start_thread, self._clock = start_thread, clock
        self._source = uuid.uuid4().hex[:16]
        self._changed = threading.Condition()  # guards the next three attributes
        self._topics: dict[str, _Newest] = {}
        self._running = False
        self._closed = False

    def send(self, topic: str, put: Put, data: Payload) -> None:
        """Send a message with the topic's `put`. Raises the exceptions of `put`."""
        with self._changed:
            newest = self._topics.setdefault(topic, _Newest(put))
        with newest.turn:
            put(data, attachment=f"{self._source}/{newest.number + 1}")
            newest.number, newest.data, newest.repeated = newest.number + 1, data, 0
            with self._changed:
                newest.due_s = self._clock() + PAUSES_S[0]
                starts = not self._running and not self._closed
                self._running |= starts
                self._changed.notify_all()
        if starts:
            self._start_thread("repeat the newest", self._run)

    def close(self) -> None:
        """End the repetitions. Idempotent."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def repeat_due(self) -> None:
        """Repeat all messages that are due."""
        with self._changed:
            due = [n for n in self._topics.values() if self._is_due(n)]
        for newest in due:
            with newest.turn:
                if self._is_due(newest):  # False if a newer message was sent meanwhile
                    self._repeat(newest)

    def _repeat(self, newest: _Newest) -> None:
        try:
            newest.put(newest.data, attachment=f"{self._source}/{newest.number}")
        except zenoh.ZError as error:  # the router is down, or the bus is closing
            log.debug("a message could not be repeated: %s", error)
        except Exception:  # the repetitions of other topics must go on
            log.exception("a message of %d bytes could not be repeated", len(newest.data))
        newest.repeated += 1
        if newest.repeated < len(PAUSES_S):
            newest.due_s = self._clock() + PAUSES_S[newest.repeated]
        else:
            newest.due_s, newest.data = None, b""

    def _is_due(self, newest: _Newest) -> bool:
        return newest.due_s is not None and newest.due_s <= self._clock()

    def _run(self) -> None:
        while True:
            self.repeat_due()
            with self._changed:
                if self._closed:
                    return
                due_s = [n.due_s for n in self._topics.values() if n.due_s is not None]
                wait_s = min(due_s) - self._clock() if due_s else None
                if wait_s is None or wait_s > 0:
                    self._changed.wait(wait_s)


class DuplicateFilter:
    """Filter of repeated messages for one reader. Not thread-safe."""

    def __init__(self) -> None:
        self._newest: OrderedDict[bytes, int] = OrderedDict()

    def take(self, attachment: bytes | None) -> bool:
        """True if the message with this attachment is new: its number is higher than all before
        from its source, or the attachment has no `source/number`."""
        source, _, digits = (attachment or b"").partition(b"/")
        if not digits.isdigit() or len(digits) > 18:
            return True
        number = int(digits)
        if number <= self._newest.get(source, -1):
            return False
        self._newest[source] = number
        self._newest.move_to_end(source)
        while len(self._newest) > REMEMBERED:
            self._newest.popitem(last=False)
        return True
