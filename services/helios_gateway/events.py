"""Events for whoever watches: numbered, kept for a while, handed from bus threads to the loop.

A viewer that was cut off names the last id it saw and gets what it missed; where that is no
longer held, and at the first visit, it gets the newest event of each kind that describes a state.
"""

from __future__ import annotations

import asyncio
import threading
import uuid
from collections import deque
from collections.abc import AsyncIterator
from dataclasses import dataclass

from helios_core.errors import Unavailable
from pydantic import BaseModel

KEEPALIVE = b": still here\n\n"


@dataclass(frozen=True)
class Event:
    """One server-sent event."""

    number: int
    type: str
    state_key: str  # what state it tells of; "": none, it is a happening
    data: str  # JSON, one line

    def encode(self, boot: str) -> bytes:
        return f"id: {boot}-{self.number}\nevent: {self.type}\ndata: {self.data}\n\n".encode()


class EventHub:
    """Thread-safe. `publish` from any thread; `stream` on an event loop."""

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

    def publish(self, type: str, data: BaseModel, state_key: str = "") -> None:
        """Tell everybody. `state_key` names the state whose newest event newcomers are given."""
        text = data.model_dump_json()  # one line; what is not finite becomes null
        with self._lock:
            self._number += 1
            event = Event(self._number, type, state_key, text)
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

    def stream(self, last_id: str | None) -> AsyncIterator[bytes]:
        """The bytes of one viewer's stream. Raises Unavailable when there are too many viewers."""
        with self._lock:
            if self._closed:
                raise Unavailable("the gateway is stopping; come back in a moment")
            if len(self._viewers) >= self._max_viewers:
                raise Unavailable(
                    f"{len(self._viewers)} event streams are open and no more are taken; "
                    "close one, or raise --max-viewers"
                )
        return self._told(last_id)

    async def _told(self, last_id: str | None) -> AsyncIterator[bytes]:
        viewer = _Viewer(asyncio.get_running_loop(), 2 * self._backlog)
        with self._lock:
            for event in self._missed(last_id):
                viewer.queue.put_nowait(event)
            if self._closed:
                viewer.queue.put_nowait(None)
            self._viewers.append(viewer)
        try:
            yield b"retry: 1000\n\n"
            while True:
                try:
                    async with asyncio.timeout(self._keepalive_s):
                        event = await viewer.queue.get()
                except TimeoutError:
                    yield KEEPALIVE
                    continue
                if event is None:
                    return
                yield event.encode(self._boot)
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

    def __init__(self, loop: asyncio.AbstractEventLoop, depth: int) -> None:
        self.queue: asyncio.Queue[Event | None] = asyncio.Queue()
        self._loop = loop
        self._depth = depth

    def put(self, event: Event | None) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._accept, event)

    def _accept(self, event: Event | None) -> None:
        if self.queue.qsize() > self._depth:
            event = None
        self.queue.put_nowait(event)
