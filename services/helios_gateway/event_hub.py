"""Event hub: numbers events, keeps a backlog, passes them from bus threads to the event loop.

A subscriber that reconnects sends its last event id and receives the events that it missed. If
the backlog no longer holds them, and at the first connection, it receives the newest event of
each state.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import uuid
import weakref
from collections import deque
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass, replace
from functools import cached_property

from helios_core.errors import Unavailable
from pydantic import BaseModel

BACKLOG = 1000  # events kept for viewers that were cut off, and held for slow ones
RETRY = b"retry: 1000\n\n"
KEEPALIVE = b": still here\n\n"


@dataclass(frozen=True)
class Event:
    """Occurrence or change of a state. Encoded once for all subscribers."""

    id: str  # <boot id of the gateway>-<number>
    number: int
    type: str
    data: str  # JSON, one line
    task_id: str = ""  # task that it concerns; "": none
    ends_task: bool = False

    @cached_property
    def as_sse(self) -> bytes:
        id = f"id: {self.id}\n" if self.id else ""
        return f"{id}event: {self.type}\ndata: {self.data}\n\n".encode()

    @cached_property
    def as_json(self) -> str:
        return f'{{"id":"{self.id}","type":"{self.type}","data":{self.data}}}'


@dataclass(frozen=True)
class EventFilter:
    """Event filter of a subscriber; an empty field matches all events."""

    types: frozenset[str] = frozenset()
    task_id: str = ""

    def __call__(self, event: Event) -> bool:
        if self.types and event.type not in self.types:
            return False
        return not self.task_id or event.task_id == self.task_id

    def with_tasks(self) -> EventFilter:
        """Same filter with task events added, because one of them reports the end of a task."""
        return replace(self, types=self.types | {"task"}) if self.types else self


class EventHub:
    """Publisher of events. Thread-safe: `publish` from any thread, `watch` on an event loop."""

    def __init__(self, backlog: int, max_viewers: int, keepalive_s: float) -> None:
        self._boot = uuid.uuid4().hex[:8]
        self._lock = threading.Lock()
        self._number = 0
        self._past: deque[Event] = deque(maxlen=backlog)
        self._state: dict[str, Event] = {}
        self._viewers: list[_Subscriber] = []
        # Of all streams that `watch` gave out; one that nobody starts leaves with its stream.
        self._slots = weakref.WeakSet[_Slot]()
        self._backlog = backlog
        self._max_viewers = max_viewers
        self._keepalive_s = keepalive_s
        self._closed = False
        self._dropped = 0

    @property
    def viewers(self) -> int:
        with self._lock:
            return len(self._viewers)

    @property
    def dropped(self) -> int:
        """Number of subscribers that were disconnected because they fell behind."""
        with self._lock:
            return self._dropped

    @property
    def longest_queue(self) -> int:
        """Most events that wait for one subscriber now; at most twice the backlog."""
        with self._lock:
            return max((viewer.queue.qsize() for viewer in self._viewers), default=0)

    def publish(
        self,
        type: str,
        data: BaseModel,
        state_key: str = "",
        task_id: str = "",
        ends_task: bool = False,
    ) -> None:
        """Send an event to all subscribers.

        state_key: state that the event describes, of which a new subscriber receives the newest
        event; empty: none, the event is an occurrence.
        """
        text = data.model_dump_json()  # one line; a non-finite number becomes null
        with self._lock:
            self._number += 1
            id = f"{self._boot}-{self._number}"
            event = Event(id, self._number, type, text, task_id, ends_task)
            self._past.append(event)
            if state_key:
                self._state.pop(state_key, None)
                self._state[state_key] = event
            for viewer in self._viewers:
                viewer.put(event)

    def forget(self, state_key: str) -> None:
        """Tell new subscribers no more of a state. Does nothing for an unknown one."""
        with self._lock:
            self._state.pop(state_key, None)

    def close(self) -> None:
        """End every stream; subscribers reconnect on their own."""
        with self._lock:
            self._closed = True
            for viewer in self._viewers:
                viewer.put(None)

    def watch(
        self,
        last_id: str | None = None,
        wanted: EventFilter = EventFilter(),
        on_drop: Callable[[], None] = lambda: None,
    ) -> AsyncGenerator[Event | None]:
        """Event stream of one subscriber; yields None at the start and as a keepalive.

        on_drop: called on the event loop when the subscriber has fallen too far behind. Its
        connection accepts no data then, so the stream itself cannot end it.

        Raises Unavailable for too many subscribers and after `close`.
        """
        with self._lock:
            if self._closed:
                raise Unavailable("the gateway is stopping; come back in a moment")
            if len(self._slots) >= self._max_viewers:
                raise Unavailable(
                    f"{len(self._slots)} event streams are open and no more are taken; "
                    "close one, or raise --max-viewers"
                )
            slot = _Slot()
            self._slots.add(slot)
        return self._stream(slot, last_id, wanted, on_drop)

    async def _stream(
        self, slot: _Slot, last_id: str | None, wanted: EventFilter, on_drop: Callable[[], None]
    ) -> AsyncGenerator[Event | None]:
        def drop() -> None:
            with self._lock:
                self._dropped += 1
            on_drop()

        viewer = _Subscriber(asyncio.get_running_loop(), 2 * self._backlog, wanted, drop)
        with self._lock:
            for event in self._backlog_since(last_id):
                if wanted(event):
                    viewer.queue.put_nowait(event)
            if self._closed:
                viewer.queue.put_nowait(None)
            self._viewers.append(viewer)
        try:
            yield None  # from here on the stream is complete
            while True:
                try:
                    async with asyncio.timeout(self._keepalive_s):
                        event = await viewer.queue.get()
                except TimeoutError:
                    yield None
                    continue
                if event is None:
                    return
                yield event
        finally:
            with self._lock:
                self._viewers.remove(viewer)
                self._slots.discard(slot)

    def _backlog_since(self, last_id: str | None) -> list[Event]:
        boot, _, number = (last_id or "").rpartition("-")
        if boot == self._boot and number.isascii() and number.isdigit() and len(number) < 20:
            last, oldest = int(number), self._past[0].number if self._past else 1
            if oldest - 1 <= last <= self._number:
                return [e for e in self._past if e.number > last]
        return sorted(self._state.values(), key=lambda e: e.number)


class _Slot:
    """Place of one stream among the most that may be open."""


class _Subscriber:
    """Queue of one stream. A subscriber that falls too far behind is disconnected."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        depth: int,
        wanted: EventFilter,
        drop: Callable[[], None],
    ) -> None:
        self.queue: asyncio.Queue[Event | None] = asyncio.Queue()
        self._loop, self._depth, self._wanted = loop, depth, wanted
        self._drop, self._dropped = drop, False

    def put(self, event: Event | None) -> None:
        if event is not None and not self._wanted(event):
            return
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._accept, event)

    def _accept(self, event: Event | None) -> None:
        if self._dropped:
            return
        if self.queue.qsize() >= self._depth and event is not None:
            self._dropped, event = True, None
            self._drop()
        self.queue.put_nowait(event)


async def as_sse(events: AsyncGenerator[Event | None]) -> AsyncGenerator[bytes]:
    """Event stream as the bytes of server-sent events."""
    async with contextlib.aclosing(events):
        if await anext(events, None) is None:
            yield RETRY
        async for event in events:
            yield KEEPALIVE if event is None else event.as_sse
