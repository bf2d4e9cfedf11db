"""`/events` and `/events/ws`: the event stream, as server-sent events or over a WebSocket."""

from __future__ import annotations

import contextlib
import time
from collections.abc import AsyncGenerator, Callable, Mapping
from typing import Annotated

import anyio
import anyio.to_thread
from fastapi import APIRouter, Header, Query, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import StreamingResponse
from helios_core import proto as pb
from helios_core.errors import HeliosError, InvalidInput
from helios_core.topics import GET_TASK
from starlette.requests import HTTPConnection
from starlette.types import Send

from helios_gateway.api_keys import Scope
from helios_gateway.dependencies import AddressedRobot, State, check, secured
from helios_gateway.error_responses import (
    Forbidden,
    Unauthorized,
    invalid_as_not_found,
    problem_of,
    problems,
)
from helios_gateway.event_hub import Event, EventFilter, as_sse
from helios_gateway.robot_registry import RobotEndpoint
from helios_gateway.settings import Settings

TYPES = ("task", "decision", "plan", "robot", "map", "service", "ready", "fault")

Types = Annotated[
    str,
    Query(max_length=200, description="event types to receive, separated by commas; empty: all"),
]
TaskId = Annotated[
    str,
    Query(
        max_length=100,
        description="id of the task whose events to receive, until it has ended; empty: all",
    ),
]
router = APIRouter(tags=["events"])


class EventResponse(StreamingResponse):
    """Response that `ending` breaks off, also while the connection accepts no data."""

    def __init__(
        self,
        content: AsyncGenerator[bytes],
        ending: anyio.CancelScope,
        media_type: str,
        headers: Mapping[str, str],
    ) -> None:
        super().__init__(content, media_type=media_type, headers=headers)
        self._ending = ending

    async def stream_response(self, send: Send) -> None:
        with self._ending:
            await super().stream_response(send)


@router.get(
    "/events",
    summary="Receive events as server-sent events",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {}}}, **problems(404)},
    dependencies=secured(Scope.READ),
)
async def events(
    robot: AddressedRobot,
    state: State,
    request: Request,
    types: Types = "",
    task_id: TaskId = "",
    last_event_id: Annotated[
        str | None, Header(description="id of the last received event; the stream resumes after it")
    ] = None,
) -> StreamingResponse:
    """Stream all events as server-sent events.

    Types: `task`, `decision`, `plan`, `robot` (at most 2 a second while it moves), `map`
    (counters that rise when a map changes), `service`, `ready`, `fault`. The data is JSON in the
    form of the other endpoints. Every event has an id; reconnect with `Last-Event-ID` to receive
    the missed events. A new subscriber first receives the current state.

    The same stream over a WebSocket: `/v1/events/ws?last_event_id=…`. Each message is
    `{"id", "type", "data"}`; an empty text is a keepalive.
    """
    ending = anyio.CancelScope()
    stream = await _watch(
        request, robot, state.settings, last_event_id, types, task_id, ending.cancel
    )
    return EventResponse(
        as_sse(stream),
        ending,
        media_type="text/event-stream",
        headers={"cache-control": "no-store", "x-accel-buffering": "no"},
    )


@router.websocket("/events/ws")
async def socket(
    robot: AddressedRobot,
    state: State,
    socket: WebSocket,
    types: Types = "",
    task_id: TaskId = "",
    last_event_id: Annotated[
        str | None,
        Query(
            max_length=100, description="id of the last received event; the stream resumes after it"
        ),
    ] = None,
) -> None:
    ending = anyio.CancelScope()
    try:
        check(socket, Scope.READ)
        stream = await _watch(
            socket, robot, state.settings, last_event_id, types, task_id, ending.cancel
        )
    except HeliosError as error:
        await socket.send_denial_response(problem_of(error))
        return
    await socket.accept()
    with ending:
        await _send(socket, stream)


async def _send(socket: WebSocket, stream: AsyncGenerator[Event | None]) -> None:
    async with contextlib.aclosing(stream), anyio.create_task_group() as group:

        async def leave_when_gone() -> None:
            while (await socket.receive())["type"] != "websocket.disconnect":
                pass  # subscribers send nothing
            group.cancel_scope.cancel()

        group.start_soon(leave_when_gone)
        with contextlib.suppress(WebSocketDisconnect):
            async for event in stream:
                await socket.send_text("" if event is None else event.as_json)
            await socket.close(1001, "no more events")
        group.cancel_scope.cancel()


async def _watch(
    viewer: HTTPConnection,
    robot: RobotEndpoint,
    settings: Settings,
    last_id: str | None,
    types: str,
    task_id: str,
    on_drop: Callable[[], None],
) -> AsyncGenerator[Event | None]:
    """Events that a subscriber requested; None is a keepalive. on_drop: see `EventHub.watch`.

    Raises InvalidInput, NotFound, Unavailable.
    """
    wanted = EventFilter(_types(types), task_id)
    if not task_id:
        stream = robot.monitor.events.watch(last_id, wanted, on_drop)
    else:
        stream = robot.monitor.events.watch(last_id, wanted.with_tasks(), on_drop)
        await anext(stream)  # from here on the stream includes the end of the task
        try:
            first = await anyio.to_thread.run_sync(
                _task_event, robot, task_id, settings.call_timeout_s
            )
        except BaseException:
            await stream.aclose()
            raise
        stream = _until_ended(stream, first, wanted)
    return _while_allowed(stream, viewer, settings.keepalive_s)


def _types(text: str) -> frozenset[str]:
    types = frozenset(part.strip() for part in text.split(",") if part.strip())
    if unknown := sorted(types - set(TYPES)):
        raise InvalidInput(
            f"no events are of type {unknown[0][:50]!r}; there are: {', '.join(TYPES)}"
        )
    return types


def _task_event(robot: RobotEndpoint, task_id: str, timeout_s: float) -> Event:
    """Event with the current state of a task; without an id, because it is not from the stream."""
    with invalid_as_not_found():
        task = robot.bus.call(GET_TASK, pb.TaskRequest(id=task_id), timeout_s)
    model = robot.monitor.task(task)
    return Event("", 0, "task", model.model_dump_json(), task_id=task_id, ends_task=model.ended)


async def _until_ended(
    stream: AsyncGenerator[Event | None], first: Event, wanted: EventFilter
) -> AsyncGenerator[Event | None]:
    """Requested events of a started stream, until the task has ended.

    first: event with the current state of the task.
    """
    async with contextlib.aclosing(stream):
        yield None
        if wanted(first):
            yield first
        if first.ends_task:
            return
        async for event in stream:
            if event is None or wanted(event):
                yield event
            if event is not None and event.ends_task:
                return


async def _while_allowed(
    stream: AsyncGenerator[Event | None], viewer: HTTPConnection, every_s: float
) -> AsyncGenerator[Event | None]:
    """Events, until the subscriber's key is revoked.

    The key is checked at every keepalive, and every `every_s` seconds between events.
    """
    checked_s = time.monotonic()
    async with contextlib.aclosing(stream):
        async for event in stream:
            now_s = time.monotonic()
            if event is None or now_s - checked_s >= every_s:
                try:
                    check(viewer, Scope.READ)
                except (Unauthorized, Forbidden):
                    return
                checked_s = now_s
            yield event
