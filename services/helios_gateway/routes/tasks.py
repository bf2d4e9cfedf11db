"""`/tasks...`, `/vocabulary` and `/suggestions`: tasks, and the names that they may use."""

from __future__ import annotations

from typing import Annotated

import anyio.to_thread
from fastapi import APIRouter, Path, Query
from helios_core import proto as pb
from helios_core.errors import DeadlineExceeded, InvalidInput, Unavailable
from helios_core.task_states import TaskState
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
from helios_gateway.dependencies import (
    AddressedRobot,
    CallTimeout,
    GatewayState,
    Maps,
    State,
    secured,
)
from helios_gateway.error_responses import invalid_as_not_found, problems
from helios_gateway.robot_registry import RobotEndpoint
from helios_gateway.task_suggestions import suggestions as suggested

router = APIRouter(tags=["tasks"], dependencies=secured(Scope.READ))
TaskId = Annotated[str, Path(description="id of the task, as returned by `POST /v1/tasks`")]


@router.post(
    "/tasks",
    status_code=202,
    summary="Submit a task",
    responses=problems(409, body=True),
    dependencies=secured(Scope.TASK),
)
def submit(
    robot: AddressedRobot, request: api_models.TaskRequest, timeout_s: CallTimeout
) -> api_models.Task:
    """Queue a task.

    It starts after all tasks before it have ended; a higher priority goes first. Follow it by
    its id or its events.

    An instruction that the planner does not understand returns 400 with the part that it
    understood.
    """
    return robot.monitor.task(robot.bus.call(SUBMIT, submit_request(request), timeout_s))


def submit_request(request: api_models.TaskRequest) -> pb.SubmitRequest:
    """Message of a request for a task."""
    return pb.SubmitRequest(
        instruction=request.instruction,
        max_steps=request.max_steps or 0,
        agent=request.agent or "",
        time_limit_s=request.time_limit_s or 0.0,
        priority=request.priority,
        settings={name: str(value) for name, value in request.settings.items()},
    )


@router.get("/tasks", summary="List the tasks", responses=problems())
def list_tasks(
    robot: AddressedRobot,
    timeout_s: CallTimeout,
    state: Annotated[TaskState | None, Query(description="state of the tasks to list")] = None,
    limit: Annotated[int, Query(ge=1, le=1000, description="maximum number of tasks")] = 1000,
) -> api_models.TaskList:
    """List the tasks, newest first.

    To follow them, use `/v1/events`, or `/v1/events?task_id=…` for one task until it has ended.
    """
    tasks = robot.bus.call(LIST_TASKS, pb.Empty(), timeout_s).tasks
    fitting = [t for t in tasks if state in (None, t.state)]
    newest_first = sorted(fitting, key=lambda t: -t.created_s)
    return api_models.TaskList(tasks=[robot.monitor.task(t) for t in newest_first[:limit]])


@router.get("/tasks/{id}", summary="Get a task", responses=problems(404))
def get_task(robot: AddressedRobot, id: TaskId, timeout_s: CallTimeout) -> api_models.Task:
    return robot.monitor.task(_of_task(robot, GET_TASK, id, timeout_s))


@router.post(
    "/tasks/{id}/cancel",
    summary="Cancel a task",
    responses=problems(404, 409, body=True),
    dependencies=secured(Scope.TASK),
)
async def cancel(
    robot: AddressedRobot, state: State, id: TaskId, timeout_s: CallTimeout
) -> api_models.Task:
    """Cancel a task and bring the robot to rest.

    A task that has ended stays unchanged.
    """
    return await _controlled(robot, state, CANCEL, id, timeout_s)


@router.post(
    "/tasks/{id}/pause",
    summary="Pause a task",
    responses=problems(404, 409, body=True),
    dependencies=secured(Scope.TASK),
)
async def pause(
    robot: AddressedRobot, state: State, id: TaskId, timeout_s: CallTimeout
) -> api_models.Task:
    """Pause a task after its current action.

    No further action starts until the task is resumed.
    """
    return await _controlled(robot, state, PAUSE, id, timeout_s)


@router.post(
    "/tasks/{id}/resume",
    summary="Resume a paused task",
    responses=problems(404, 409, body=True),
    dependencies=secured(Scope.TASK),
)
async def resume(
    robot: AddressedRobot, state: State, id: TaskId, timeout_s: CallTimeout
) -> api_models.Task:
    return await _controlled(robot, state, RESUME, id, timeout_s)


@router.get(
    "/tasks/{id}/decisions",
    summary="List a task's decisions with their reasons",
    responses=problems(404),
)
def decisions(
    robot: AddressedRobot,
    timeout_s: CallTimeout,
    id: TaskId,
    set: Annotated[
        list[str] | None,
        Query(
            description="setting under which to recompute the decisions, such as `alpha_d=0.01`; "
            "repeatable"
        ),
    ] = None,
) -> api_models.DecisionList:
    """List the decisions of a task, oldest first.

    With `set`, each decision also holds `recomputed`: its outcome under these settings.
    """
    if not set:
        reply = _of_task(robot, DECISIONS, id, timeout_s)
    else:
        _of_task(robot, GET_TASK, id, timeout_s)
        changes = dict(assignment(text) for text in set)
        request = pb.TaskRequest(id=id, settings=changes)
        reply = robot.bus.call(DECISIONS, request, timeout_s)
    return api_models.DecisionList(
        decisions=[message_conversion.decision(d) for d in reply.decisions]
    )


@router.get(
    "/vocabulary", summary="List the class names that the detector knows", responses=problems()
)
def vocabulary(robot: AddressedRobot, timeout_s: CallTimeout) -> api_models.Vocabulary:
    reply = robot.bus.call(VOCABULARY, pb.Empty(), timeout_s)
    return api_models.Vocabulary(
        open=reply.open,
        names=list(reply.names),
        detector=reply.detector,
        scorer=reply.scorer,
    )


@router.get("/suggestions", summary="Suggest tasks for this home", responses=problems())
def suggestions(
    robot: AddressedRobot,
    maps: Maps,
    timeout_s: CallTimeout,
    limit: Annotated[int, Query(ge=1, le=20, description="maximum number of tasks")] = 3,
) -> api_models.Suggestions:
    """Suggest tasks with objects of this home, those with the highest score and nearest first.

    If nothing has been seen yet (`seen` is empty), they use example names that the detector
    knows.
    """
    known = robot.bus.call(VOCABULARY, pb.Empty(), timeout_s)
    now = robot.monitor.robot()
    described, pose = now.description, now.state.pose if now.state else None
    has_arm = described is None or (described.can_pick and described.can_place)
    robot_xy = (pose.x_m, pose.y_m) if pose else None
    try:
        believed = message_conversion.suggestable_objects(maps.objects())
    except (Unavailable, DeadlineExceeded):
        believed = None
    return api_models.Suggestions(
        tasks=suggested(known.open, known.names, has_arm, believed or (), limit, robot_xy),
        seen=None if believed is None else message_conversion.seen_names(believed),
    )


def _of_task(
    robot: RobotEndpoint, method: Method[pb.TaskRequest, M], id: str, timeout_s: float
) -> M:
    """Planner's reply to a call about one task. Raises NotFound for an unknown id."""
    with invalid_as_not_found():
        return robot.bus.call(method, pb.TaskRequest(id=id), timeout_s)


async def _controlled(
    robot: RobotEndpoint,
    state: GatewayState,
    method: Method[pb.TaskRequest, pb.Task],
    id: str,
    timeout_s: float,
) -> api_models.Task:
    """State of a task after a call about it, which waits for no request that only reads."""

    def changed() -> api_models.Task:
        return robot.monitor.task(_of_task(robot, method, id, timeout_s))

    return await anyio.to_thread.run_sync(changed, limiter=state.control_threads)


def assignment(text: str) -> tuple[str, str]:
    """Name and value of a text such as `alpha_d=0.01`. Raises InvalidInput."""
    name, equals, value = text.partition("=")
    if not (name.strip() and equals and value.strip()):
        raise InvalidInput(f"set is {text!r:.100}; wanted NAME=VALUE, such as alpha_d=0.01")
    return name.strip(), value.strip()
