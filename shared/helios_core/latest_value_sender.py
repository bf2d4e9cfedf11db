"""Latest-wins topics over Zenoh: the newest message reaches every reader in the end.

BLOCK_FIRST lets one message wait on each link, at the sender's and at the router's, and drops those
that come while it waits. So the newest may be dropped and an older one delivered. Therefore the
sender repeats its newest message while no newer one follows, and readers leave out what they have
had. A repetition that is dropped costs nobody anything; sender and other readers never wait.
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

log = logging.getLogger(__name__)

# Seconds between repetitions. Together longer than the 5 s after which Zenoh sends a message that
# waits or closes its link: then the last repetition finds room.
PAUSES_S = (0.25, 0.5, 1.0, 2.0, 4.0)
REMEMBERED = 64  # sources of which a reader knows what it has had


class Put(Protocol):
    """As `zenoh.Publisher.put`."""

    def __call__(self, payload: bytes, *, attachment: str) -> None: ...


@dataclass
class _Newest:
    """Of one topic. `turn` is held while it is sent, so that no repetition overtakes a newer
    message."""

    put: Put
    turn: threading.Lock = field(default_factory=threading.Lock)
    number: int = 0
    data: bytes = b""
    repeated: int = 0
    due_s: float | None = None  # when it is repeated; None: no more


class Repeater:
    """Sends messages of latest-wins topics, and repeats the newest of each. Thread-safe."""

    def __init__(
        self, start_thread: Callable[[str, Callable[[], None]], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        """start_thread: runs a job of that name until `close`; called with the first message.
        clock: seconds that only grow."""
        self._start_thread, self._clock = start_thread, clock
        self._source = uuid.uuid4().hex[:16]
        self._changed = threading.Condition()  # guards the three below
        self._topics: dict[str, _Newest] = {}
        self._running = False
        self._closed = False

    def send(self, topic: str, put: Put, data: bytes) -> None:
        """Send by `put`, of the topic's publisher. Raises what it raises."""
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
        """Send again what is due."""
        with self._changed:
            due = [n for n in self._topics.values() if self._is_due(n)]
        for newest in due:
            with newest.turn:
                if self._is_due(newest):  # else a newer one was sent meanwhile
                    self._repeat(newest)

    def _repeat(self, newest: _Newest) -> None:
        try:
            newest.put(newest.data, attachment=f"{self._source}/{newest.number}")
        except zenoh.ZError as error:  # the router is away, or the bus closes
            log.debug("a message could not be repeated: %s", error)
        except Exception:  # the other topics' messages are repeated all the same
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


class Unseen:
    """What one reader has had of each source. For one thread."""

    def __init__(self) -> None:
        self._newest: OrderedDict[bytes, int] = OrderedDict()

    def take(self, attachment: bytes | None) -> bool:
        """Whether a message with this attachment is to be read: it is newer than those before of
        its source, or does not tell its `source/number`."""
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
