"""The SDK for asyncio: `helios_client.sdk` with `await`.

async with AsyncHelios("http://127.0.0.1:8080") as helios:
    task = await helios.submit("Find the apple")
    async for event in helios.events(task_id=task.id):
        print(event.type, event.data)
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from types import TracebackType
from typing import Any, Self, TypeVar

import httpx
from helios_core.errors import DeadlineExceeded, Unavailable
from numpy.typing import NDArray

from helios_client.http import calls
from helios_client.http.connection import EVENT_RETRY_S, POLL_S, SILENCE_S, Connection
from helios_client.http.errors import lost, refused
from helios_client.http.events import EventParser
from helios_client.http.waiting import Waiting
from helios_client.tasks import (
    Decision,
    Event,
    FoundObject,
    Frontier,
    LoadedMaps,
    MapInfo,
    RobotAnswer,
    Seen,
    SeenView,
    Status,
    Task,
)

T = TypeVar("T")


class AsyncHelios:
    """A running HELIOS, for one event loop. Methods are those of `helios_client.sdk.Helios`."""

    def __init__(
        self,
        base_url: str = "http://127.0.0.1:8080",
        timeout_s: float = 10.0,
        transport: httpx.AsyncBaseTransport | None = None,
        key: str | None = None,
        robot: str | None = None,
    ) -> None:
        self._to = Connection(base_url, timeout_s, key, robot)
        self._http = httpx.AsyncClient(**self._to.options(), transport=transport)

    # --- tasks --------------------------------------------------------------------------------
    async def submit(
        self,
        instruction: str,
        max_steps: int | None = None,
        agent: str | None = None,
        time_limit_s: float | None = None,
        priority: int = 0,
        settings: Mapping[str, str | float] | None = None,
    ) -> Task:
        return await self._do(calls.submit(
            instruction, max_steps, agent, time_limit_s, priority, settings
        ))  # fmt: skip

    async def task(self, id: str) -> Task:
        return await self._do(calls.task(id))

    async def tasks(self, state: str | None = None, limit: int | None = None) -> tuple[Task, ...]:
        return await self._do(calls.tasks(state, limit))

    async def cancel(self, id: str) -> Task:
        return await self._do(calls.cancel(id))

    async def pause(self, id: str) -> Task:
        return await self._do(calls.pause(id))

    async def resume(self, id: str) -> Task:
        return await self._do(calls.resume(id))

    async def wait(
        self, id: str, timeout_s: float, on_update: Callable[[Task], None] | None = None
    ) -> Task:
        waiting = Waiting(id, timeout_s, SILENCE_S)
        while True:
            try:
                task = await self.task(id)
            except (Unavailable, DeadlineExceeded):
                if waiting.gives_up():
                    raise
            else:
                if waiting.is_new(task) and on_update:
                    on_update(task)
                if task.ended:
                    return task
                waiting.check(task)
            await asyncio.sleep(POLL_S)

    async def decisions(self, id: str, changes: Sequence[str] = ()) -> tuple[Decision, ...]:
        return await self._do(calls.decisions(id, changes))

    # --- maps and robot -----------------------------------------------------------------------
    async def objects(
        self, class_name: str | None = None, min_score: float | None = None
    ) -> tuple[FoundObject, ...]:
        return await self._do(calls.objects(class_name, min_score))

    async def object(self, id: int) -> FoundObject:
        return await self._do(calls.found_object(id))

    async def seen(self, prompt: str, limit: int = 5) -> Seen:
        return await self._do(calls.seen(prompt, limit))

    async def object_views(self, id: int, limit: int = 5) -> tuple[SeenView, ...]:
        return await self._do(calls.object_views(id, limit))

    async def save_map(self) -> bytes:
        return await self._do(calls.save_map())

    async def load_map(self, data: bytes) -> LoadedMaps:
        return await self._do(calls.load_map(data))

    async def map_info(self) -> MapInfo:
        return await self._do(calls.map_info())

    async def occupancy(self) -> dict[str, NDArray]:
        return await self._do(calls.arrays("occupancy"))

    async def value_layer(self, layer: str) -> dict[str, NDArray]:
        return await self._do(calls.arrays(f"value/{layer}"))

    async def picture(self, what: str = "occupancy") -> bytes:
        return await self._do(calls.map_file(what, "png"))

    async def map_file(self, what: str, ending: str) -> bytes:
        return await self._do(calls.map_file(what, ending))

    async def ros_map(self) -> dict[str, bytes]:
        return await self._do(calls.ros_map())

    async def frontiers(self) -> list[Frontier]:
        return await self._do(calls.frontiers())

    async def camera(self) -> bytes:
        return await self._do(calls.camera())

    async def robot(self) -> RobotAnswer:
        return await self._do(calls.robot())

    async def stop_robot(self, reason: str = "asked for by the Python SDK") -> RobotAnswer:
        return await self._do(calls.stop_robot(reason))

    async def clear_stop(self) -> RobotAnswer:
        return await self._do(calls.clear_stop())

    # --- the whole ----------------------------------------------------------------------------
    async def status(self) -> Status:
        return await self._do(calls.status())

    async def settings(self, service: str) -> dict[str, Any]:
        return await self._do(calls.service_settings(service))

    async def ready(self) -> bool:
        try:
            return (await self.status())["ready"]
        except (Unavailable, DeadlineExceeded):
            return False

    async def events(
        self,
        types: Iterable[str] = (),
        task_id: str | None = None,
        last_id: str = "",
        silence_s: float = SILENCE_S,
    ) -> AsyncIterator[Event]:
        heard_s = time.monotonic()
        asked = tuple(types)
        while True:
            try:
                async for event in self._stream(asked, task_id, last_id, silence_s):
                    heard_s, last_id = time.monotonic(), event.id or last_id
                    yield event
                    if task_id and event.ends_task:
                        return
                trouble = Unavailable(f"{self._to.url} ended the stream of events; try again")
            except (Unavailable, DeadlineExceeded) as error:
                trouble = error
            if time.monotonic() - heard_s >= silence_s:
                raise trouble
            await asyncio.sleep(EVENT_RETRY_S)

    async def close(self) -> None:
        await self._http.aclose()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    # --- transport ----------------------------------------------------------------------------
    async def _do(self, call: calls.Call[T]) -> T:
        try:
            response = await self._http.request(**self._to.request(call))
        except httpx.TransportError as error:
            raise lost(error, self._to.url) from error
        return call.answer(response)

    async def _stream(
        self, types: tuple[str, ...], task_id: str | None, last_id: str, silence_s: float
    ) -> AsyncIterator[Event]:
        request = self._to.event_request(types, task_id, last_id, silence_s)
        parser = EventParser()
        try:
            async with self._http.stream(**request) as response:
                if response.is_error:
                    await response.aread()
                    raise refused(response)
                async for line in response.aiter_lines():
                    if event := parser.feed(line):
                        yield event
        except httpx.TransportError as error:
            raise lost(error, self._to.url) from error
