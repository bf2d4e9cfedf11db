"""`/v1/fleet`: the state of all robots, and tasks that the fleet gives to one of them."""

from __future__ import annotations

from typing import Annotated
from urllib.parse import quote

import anyio.to_thread
from fastapi import APIRouter, Path, Query
from helios_core.printable_text import printable
from helios_core.task_states import TaskState

from helios_gateway import api_fleet_models, message_conversion
from helios_gateway.api_keys import Scope
from helios_gateway.dependencies import Fleet, State, secured
from helios_gateway.error_responses import problems
from helios_gateway.fleet.dispatcher import Dispatcher
from helios_gateway.fleet.fleet_robot import FleetRobot
from helios_gateway.fleet.records import FleetTask
from helios_gateway.routes.tasks import submit_request

router = APIRouter(prefix="/v1/fleet", tags=["fleet"], dependencies=secured(Scope.READ))
TaskId = Annotated[str, Path(description="id of the task, as returned by `POST /v1/fleet/tasks`")]


@router.get("", summary="Get the state of every robot, and the open tasks", responses=problems())
def overview(fleet: Fleet) -> api_fleet_models.Fleet:
    return api_fleet_models.Fleet(
        robots=[robot_model(robot) for robot in fleet.robots.values()],
        tasks=[task_model(fleet, task) for task in fleet.queue.open_tasks()],
    )


@router.post(
    "/tasks",
    status_code=202,
    summary="Submit a task for any robot",
    responses=problems(404, 409, body=True),
    dependencies=secured(Scope.TASK),
)
def submit(fleet: Fleet, request: api_fleet_models.FleetTaskRequest) -> api_fleet_models.FleetTask:
    """Queue a task for the fleet.

    It goes to the nearest idle robot whose map knows the object or place, else to any idle robot;
    a higher priority goes first. If a robot drops out before it has begun the task, the task
    returns to the queue. A task that has begun stays with its robot.

    An instruction that no robot understands returns 400 with the reason of the first one.
    """
    return task_model(fleet, fleet.add(submit_request(request), request.robot))


@router.get("/tasks", summary="List the tasks of the fleet", responses=problems())
def list_tasks(
    fleet: Fleet,
    state: Annotated[TaskState | None, Query(description="state of the tasks to list")] = None,
    limit: Annotated[int, Query(ge=1, le=1000, description="maximum number of tasks")] = 1000,
) -> api_fleet_models.FleetTaskList:
    """List the tasks of the fleet, newest first.

    Tasks that were submitted to one robot directly are below `/v1/robots/NAME/tasks`.
    """
    newest_first = [t for t in reversed(fleet.queue.tasks()) if state in (None, t.state)]
    return api_fleet_models.FleetTaskList(
        tasks=[task_model(fleet, task) for task in newest_first[:limit]]
    )


@router.get("/tasks/{id}", summary="Get a task of the fleet", responses=problems(404))
def get_task(fleet: Fleet, id: TaskId) -> api_fleet_models.FleetTask:
    return task_model(fleet, fleet.queue.get(id))


@router.post(
    "/tasks/{id}/cancel",
    summary="Cancel a task of the fleet",
    responses=problems(404, 409, body=True),
    dependencies=secured(Scope.TASK),
)
async def cancel(fleet: Fleet, state: State, id: TaskId) -> api_fleet_models.FleetTask:
    """Cancel a task, also at the robot that does it.

    If that robot is away, it is told when it is back. A task that has ended stays unchanged.
    """

    def cancelled() -> api_fleet_models.FleetTask:
        return task_model(fleet, fleet.cancel(id))

    return await anyio.to_thread.run_sync(cancelled, limiter=state.control_threads)


def task_model(fleet: Dispatcher, task: FleetTask) -> api_fleet_models.FleetTask:
    """HTTP model of a task of the fleet."""
    return api_fleet_models.FleetTask(
        id=task.id, instruction=printable(task.request.instruction), state=task.state,
        message=printable(fleet.message(task)), wanted=task.wanted, robot=task.robot or None,
        task_id=task.task_id or None, begun=task.begun, why=printable(task.why),
        priority=task.request.priority, unused=list(task.task.unused), returned=task.returned,
        refused={name: printable(why) for name, why in task.refused.items()},
        created_s=task.created_s, ended_s=task.ended_s or None,
        task=message_conversion.task(task.task) if task.task.id else None,
    )  # fmt: skip


def robot_model(robot: FleetRobot) -> api_fleet_models.FleetRobot:
    """HTTP model of a robot of the fleet."""
    now, task = robot.served.monitor.robot().state, robot.under_way()
    has_picture = robot.served.monitor.camera.has_picture
    return api_fleet_models.FleetRobot(
        name=robot.name,
        state=robot.state(),
        reasons=robot.reasons(),
        task=None if task is None else message_conversion.task(task),
        pose=now and now.pose,
        battery=now and now.battery,
        held=now.held if now else "",
        picture=f"/v1/robots/{quote(robot.name, safe='')}/camera.jpg" if has_picture else None,
    )
