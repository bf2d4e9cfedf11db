"""Events for whoever watches: numbered, kept for a while, handed from bus threads to the loop.

A viewer that was cut off names the last id it saw and gets what it missed; where that is no
longer held, and at the first visit, it gets the newest event of each kind that describes a state.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import uuid
from collections import deque
from collections.abc import AsyncGenerator
from dataclasses import dataclass, replace
from functools import cached_property

from helios_core.errors import Unavailable
from pydantic import BaseModel

BACKLOG = 1000  # events kept for viewers that were cut off, and held for slow ones
RETRY = b"retry: 1000\n\n"
KEEPALIVE = b": still here\n\n"


@dataclass(frozen=True)
class Event:
    """Something that happened, or a state that changed. Encoded once for all viewers."""

    id: str  # <boot of the gateway>-<number>
    number: int
    type: str
    data: str  # JSON, one line
    state_key: str = ""  # what state it tells of; "": none, it is a happening
    task_id: str = ""  # which task it is about; "": none
    ends_task: bool = False

    @cached_property
    def as_sse(self) -> bytes:
        id = f"id: {self.id}\n" if self.id else ""
        return f"{id}event: {self.type}\ndata: {self.data}\n\n".encode()

    @cached_property
    def as_json(self) -> str:
        return f'{{"id":"{self.id}","type":"{self.type}","data":{self.data}}}'


@dataclass(frozen=True)
class Wanted:
    """Which events a viewer wants: empty is all."""

    types: frozenset[str] = frozenset()
    task_id: str = ""

    def __call__(self, event: Event) -> bool:
        if self.types and event.type not in self.types:
            return False
        return not self.task_id or event.task_id == self.task_id

    def with_tasks(self) -> Wanted:
        """The same, and how tasks go on: one of these ends a task."""
        return replace(self, types=self.types | {"task"}) if self.types else self


class EventHub:
    """Thread-safe. `publish` from any thread; `watch` on an event loop."""

    def __init__(self, backlog: int, max_viewers: int, keepalive_s: float) -> None:
        self._boot = uuid.uuid4().hex[:8]
        self._lock = threading.Lock()
        self._number = 0
        self._past: deque[Event] = deque(maxlen=backlog)
        self._state: dict[str, Event] = {}
        self._viewers: list[_Viewer] = []
        self._backlog = backlog
        self._max_viewers = max_viewers
        self._keepalive_s = keepalive_s
        self._closed = False

    @property
    def viewers(self) -> int:
        with self._lock:
            return len(self._viewers)

    def publish(
        self,
        type: str,
        data: BaseModel,
        state_key: str = "",
        task_id: str = "",
        ends_task: bool = False,
    ) -> None:
        """Tell everybody. `state_key` names the state whose newest event newcomers are given."""
        text = data.model_dump_json()  # one line; what is not finite becomes null
        with self._lock:
            self._number += 1
            id = f"{self._boot}-{self._number}"
            event = Event(id, self._number, type, text, state_key, task_id, ends_task)
            self._past.append(event)
            if state_key:
                self._state.pop(state_key, None)
                self._state[state_key] = event
            for viewer in self._viewers:
                viewer.put(event)

    def close(self) -> None:
        """End every stream; viewers come back by themselves."""
        with self._lock:
            self._closed = True
            for viewer in self._viewers:
                viewer.put(None)

    def watch(
        self, last_id: str | None = None, wanted: Wanted = Wanted()
    ) -> AsyncGenerator[Event | None]:
        """One viewer's events; None at first, and when nothing happened for a while.

        Raises Unavailable when there are too many viewers.
        """
        with self._lock:
            if self._closed:
                raise Unavailable("the gateway is stopping; come back in a moment")
            if len(self._viewers) >= self._max_viewers:
                raise Unavailable(
                    f"{len(self._viewers)} event streams are open and no more are taken; "
                    "close one, or raise --max-viewers"
                )
        return self._stream(last_id, wanted)

    async def _stream(self, last_id: str | None, wanted: Wanted) -> AsyncGenerator[Event | None]:
        viewer = _Viewer(asyncio.get_running_loop(), 2 * self._backlog, wanted)
        with self._lock:
            for event in self._missed(last_id):
                if wanted(event):
                    viewer.queue.put_nowait(event)
            if self._closed:
                viewer.queue.put_nowait(None)
            self._viewers.append(viewer)
        try:
            yield None  # from here on nothing is missed
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

    def _missed(self, last_id: str | None) -> list[Event]:
        boot, _, number = (last_id or "").rpartition("-")
        if boot == self._boot and number.isascii() and number.isdigit() and len(number) < 20:
            last, oldest = int(number), self._past[0].number if self._past else 1
            if oldest - 1 <= last <= self._number:
                return [e for e in self._past if e.number > last]
        return sorted(self._state.values(), key=lambda e: e.number)


class _Viewer:
    """One stream's queue. One that falls too far behind is ended, and comes back for the rest."""

    def __init__(self, loop: asyncio.AbstractEventLoop, depth: int, wanted: Wanted) -> None:
        self.queue: asyncio.Queue[Event | None] = asyncio.Queue()
        self._loop, self._depth, self._wanted = loop, depth, wanted

    def put(self, event: Event | None) -> None:
        if event is not None and not self._wanted(event):
            return
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._accept, event)

    def _accept(self, event: Event | None) -> None:
        if self.queue.qsize() > self._depth:
            event = None
        self.queue.put_nowait(event)


async def as_sse(events: AsyncGenerator[Event | None]) -> AsyncGenerator[bytes]:
    """The bytes of a stream of server-sent events."""
    async with contextlib.aclosing(events):
        if await anext(events, None) is None:
            yield RETRY
        async for event in events:
            yield KEEPALIVE if event is None else event.as_sse
