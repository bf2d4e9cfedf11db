"""Tasks, decisions and the stream of events."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Header, Request
from fastapi.responses import StreamingResponse
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import InvalidInput
from helios_core.topics import (
    CANCEL,
    DECISIONS,
    GET_TASK,
    LIST_TASKS,
    SUBMIT,
    VOCABULARY,
    M,
    Method,
)

from helios_gateway import convert, models
from helios_gateway.live import Live
from helios_gateway.problems import NotFound
from helios_gateway.settings import Settings


def task_routes(bus: Bus, live: Live, settings: Settings) -> APIRouter:
    """`/v1/tasks…`, `/v1/vocabulary` and `/v1/events`."""
    routes = APIRouter(prefix="/v1", tags=["tasks"])
    timeout_s = settings.call_timeout_s

    def of_task(method: Method[pb.TaskRequest, M], id: str) -> M:
        try:
            return bus.call(method, pb.TaskRequest(id=id), timeout_s)
        except InvalidInput as error:
            raise NotFound(error.message) from error

    @routes.post("/tasks", status_code=202, summary="Submit a task")
    def submit(request: models.TaskRequest) -> models.Task:
        """Queue a task. It starts when all before it have ended; watch it by its id or events.

        An instruction that is not understood is a 400 that says what was."""
        message = pb.SubmitRequest(
            instruction=request.instruction, max_steps=request.max_steps or 0
        )
        return convert.task(bus.call(SUBMIT, message, timeout_s))

    @routes.get("/tasks", summary="All tasks")
    def list_tasks() -> models.TaskList:
        tasks = bus.call(LIST_TASKS, pb.Empty(), timeout_s).tasks
        newest_first = sorted(tasks, key=lambda t: -t.created_s)
        return models.TaskList(tasks=[convert.task(t) for t in newest_first])

    @routes.get("/tasks/{id}", summary="One task")
    def get_task(id: str) -> models.Task:
        return convert.task(of_task(GET_TASK, id))

    @routes.post("/tasks/{id}/cancel", summary="Cancel a task")
    def cancel(id: str) -> models.Task:
        """The robot comes to rest; a task that has ended stays as it is."""
        return convert.task(of_task(CANCEL, id))

    @routes.get("/tasks/{id}/decisions", summary="Why it did what it did")
    def decisions(id: str) -> models.DecisionList:
        reply = of_task(DECISIONS, id)
        return models.DecisionList(decisions=[convert.decision(d) for d in reply.decisions])

    @routes.get("/vocabulary", summary="What can be looked for")
    def vocabulary() -> models.Vocabulary:
        reply = bus.call(VOCABULARY, pb.Empty(), timeout_s)
        return models.Vocabulary(
            open=reply.open,
            names=list(reply.names),
            detector=reply.detector,
            scorer=reply.scorer,
        )

    @routes.get(
        "/events",
        summary="Everything that happens, as server-sent events",
        response_class=StreamingResponse,
        responses={200: {"content": {"text/event-stream": {}}}},
    )
    async def events(
        request: Request, last_event_id: Annotated[str | None, Header()] = None
    ) -> StreamingResponse:
        """Types: `task`, `decision`, `plan`, `robot` (at most 2 a second while it moves),
        `map` (numbers that rise when a map changes), `service`, `ready`. The data is JSON, of the
        same form as the other addresses give. Every event has an id; come back with
        `Last-Event-ID` to get what was missed. Newcomers are given the present state first."""
        return StreamingResponse(
            live.events.stream(last_event_id),
            media_type="text/event-stream",
            headers={"cache-control": "no-store", "x-accel-buffering": "no"},
        )

    return routes
