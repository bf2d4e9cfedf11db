"""Tasks and decisions."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import DeadlineExceeded, InvalidInput, Unavailable
from helios_core.topics import (
    CANCEL,
    DECISIONS,
    GET_TASK,
    LIST_TASKS,
    PAUSE,
    RESUME,
    SUBMIT,
    VOCABULARY,
    M,
    Method,
)

from helios_gateway import api_models, message_conversion
from helios_gateway.api_keys import Scope
from helios_gateway.authorization import secured
from helios_gateway.error_responses import NotFound, problems
from helios_gateway.robot_registry import At
from helios_gateway.settings import Settings
from helios_gateway.task_suggestions import suggestions as suggested


def task_routes(prefix: str, settings: Settings) -> APIRouter:
    """`/tasks…`, `/vocabulary` and `/suggestions`."""
    routes = APIRouter(prefix=prefix, tags=["tasks"], dependencies=secured(Scope.READ))
    timeout_s = settings.call_timeout_s

    def of_task(bus: Bus, method: Method[pb.TaskRequest, M], id: str) -> M:
        try:
            return bus.call(method, pb.TaskRequest(id=id), timeout_s)
        except InvalidInput as error:
            raise NotFound(error.message) from error

    @routes.post(
        "/tasks",
        status_code=202,
        summary="Submit a task",
        responses=problems(409, body=True),
        dependencies=secured(Scope.OPERATE),
    )
    def submit(at: At, request: api_models.TaskRequest) -> api_models.Task:
        """Queue a task. It starts when all before it have ended, those of a higher priority
        first; watch it by its id or events.

        An instruction that is not understood is a 400 that says what was."""
        message = pb.SubmitRequest(
            instruction=request.instruction,
            max_steps=request.max_steps or 0,
            agent=request.agent or "",
            time_limit_s=request.time_limit_s or 0.0,
            priority=request.priority,
            settings={name: str(value) for name, value in request.settings.items()},
        )
        return message_conversion.task(at.bus.call(SUBMIT, message, timeout_s))

    @routes.get("/tasks", summary="Tasks, newest first", responses=problems())
    def list_tasks(
        at: At,
        state: Annotated[
            api_models.TaskState | None, Query(description="only those in this state")
        ] = None,
        limit: Annotated[int, Query(ge=1, le=1000, description="at most so many")] = 1000,
    ) -> api_models.TaskList:
        """To watch them: `/v1/events`, or `/v1/events?task_id=…` for one until it has ended."""
        tasks = at.bus.call(LIST_TASKS, pb.Empty(), timeout_s).tasks
        fitting = [t for t in tasks if state in (None, t.state)]
        newest_first = sorted(fitting, key=lambda t: -t.created_s)
        return api_models.TaskList(tasks=[message_conversion.task(t) for t in newest_first[:limit]])

    @routes.get("/tasks/{id}", summary="One task", responses=problems(404))
    def get_task(at: At, id: str) -> api_models.Task:
        return message_conversion.task(of_task(at.bus, GET_TASK, id))

    @routes.post(
        "/tasks/{id}/cancel",
        summary="Cancel a task",
        responses=problems(404, 409, body=True),
        dependencies=secured(Scope.OPERATE),
    )
    def cancel(at: At, id: str) -> api_models.Task:
        """The robot comes to rest; a task that has ended stays as it is."""
        return message_conversion.task(of_task(at.bus, CANCEL, id))

    @routes.post(
        "/tasks/{id}/pause",
        summary="Pause a task",
        responses=problems(404, 409, body=True),
        dependencies=secured(Scope.OPERATE),
    )
    def pause(at: At, id: str) -> api_models.Task:
        """The action that runs is finished, no further one is begun until the task is resumed."""
        return message_conversion.task(of_task(at.bus, PAUSE, id))

    @routes.post(
        "/tasks/{id}/resume",
        summary="Go on with a paused task",
        responses=problems(404, 409, body=True),
        dependencies=secured(Scope.OPERATE),
    )
    def resume(at: At, id: str) -> api_models.Task:
        return message_conversion.task(of_task(at.bus, RESUME, id))

    @routes.get("/tasks/{id}/decisions", summary="Why it did what it did", responses=problems(404))
    def decisions(
        at: At,
        id: str,
        set: Annotated[
            list[str] | None,
            Query(description="take them again under this setting, `alpha_d=0.01`; repeatable"),
        ] = None,
    ) -> api_models.DecisionList:
        """With `set`, each holds as `recomputed` what it would have been under these settings."""
        if not set:
            reply = of_task(at.bus, DECISIONS, id)
        else:
            of_task(at.bus, GET_TASK, id)
            changes = dict(assignment(text) for text in set)
            request = pb.TaskRequest(id=id, settings=changes)
            reply = at.bus.call(DECISIONS, request, timeout_s)
        return api_models.DecisionList(
            decisions=[message_conversion.decision(d) for d in reply.decisions]
        )

    @routes.get("/vocabulary", summary="What can be looked for", responses=problems())
    def vocabulary(at: At) -> api_models.Vocabulary:
        reply = at.bus.call(VOCABULARY, pb.Empty(), timeout_s)
        return api_models.Vocabulary(
            open=reply.open,
            names=list(reply.names),
            detector=reply.detector,
            scorer=reply.scorer,
        )

    @routes.get("/suggestions", summary="Tasks to try in this home", responses=problems())
    def suggestions(
        at: At, limit: Annotated[int, Query(ge=1, le=20, description="tasks at most")] = 3
    ) -> api_models.Suggestions:
        """Of what was seen here, the surest and nearest first. Where nothing was seen yet (`seen`
        is empty), examples of names that the detector knows."""
        known = at.bus.call(VOCABULARY, pb.Empty(), timeout_s)
        now = at.live.robot()
        robot, pose = now.description, now.state.pose if now.state else None
        has_arm = robot is None or (robot.can_pick and robot.can_place)
        robot_xy = (pose.x_m, pose.y_m) if pose else None
        try:
            believed = message_conversion.believed(at.live.maps.objects())
        except (Unavailable, DeadlineExceeded):
            believed = None
        return api_models.Suggestions(
            tasks=suggested(known.open, known.names, has_arm, believed or (), limit, robot_xy),
            seen=None if believed is None else message_conversion.seen_names(believed),
        )

    return routes


def assignment(text: str) -> tuple[str, str]:
    """`alpha_d=0.01` as name and value. Raises InvalidInput."""
    name, equals, value = text.partition("=")
    if not (name.strip() and equals and value.strip()):
        raise InvalidInput(f"set is {text!r:.100}; wanted NAME=VALUE, such as alpha_d=0.01")
    return name.strip(), value.strip()
