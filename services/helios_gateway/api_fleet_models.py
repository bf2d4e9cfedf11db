"""Request and response models of `/v1/fleet`: the robots of this gateway, and tasks for any."""

from __future__ import annotations

from helios_core.name_rules import ANY_ROBOT
from helios_core.task_states import TaskState
from pydantic import BaseModel, Field

from helios_gateway.api_models import RobotPose, Task, TaskRequest
from helios_gateway.fleet.fleet_robot import FleetRobotState


class FleetTaskRequest(TaskRequest):
    """Task for a robot of the fleet."""

    robot: str = Field(
        default=ANY_ROBOT,
        max_length=100,
        description="name of the robot that shall do the task; any: the fleet chooses",
    )


class FleetTask(BaseModel):
    """Task of the fleet, and how it goes at its robot."""

    id: str = Field(description="identifier of the task in the fleet")
    instruction: str = Field(description="instruction as submitted")
    state: TaskState = Field(
        description="current state; queued also while a robot has it and has not begun it; "
        "succeeded, failed and cancelled are final"
    )
    message: str = Field(
        description="what it waits for, current activity, or reason for the end, in one sentence"
    )
    wanted: str = Field(description="robot that the request named; any: the fleet chooses")
    robot: str | None = Field(description="robot that has the task; null: it waits in the queue")
    task_id: str | None = Field(
        description="identifier of the task at its robot, for `/v1/robots/NAME/tasks/ID`; null: "
        "no robot has it"
    )
    begun: bool = Field(
        description="true if the robot has been told to start; from then on the task stays with it"
    )
    why: str = Field(
        description="why this robot was chosen, in one sentence; empty: none is chosen",
        examples=["robot-2 was idle; no idle robot's map had the mug"],
    )
    priority: int = Field(description="tasks with a higher value get a robot first")
    unused: list[str] = Field(
        description="words of the instruction that have no effect on the task",
        examples=[["in the kitchen"]],
    )
    returned: int = Field(description="number of times that a robot gave the task back")
    refused: dict[str, str] = Field(
        description="reasons of the robots that cannot do it, by name",
        examples=[{"robot-3": "the robot has no arm"}],
    )
    created_s: float = Field(description="creation time, seconds since 1970")
    ended_s: float | None = Field(description="end time, seconds since 1970; null: not ended yet")
    task: Task | None = Field(description="the task at its robot; null: no robot has had it")


class FleetTaskList(BaseModel):
    tasks: list[FleetTask] = Field(description="tasks of the fleet, newest first")


class FleetRobot(BaseModel):
    """One robot of the fleet."""

    name: str = Field(description="name of the robot, as in `/v1/robots/NAME`")
    state: FleetRobotState = Field(
        description="idle: it can do a task and has none; busy: it has one; not ready: see "
        "`reasons`; stopped: until clear-stop; away: its bridge is not connected"
    )
    reasons: list[str] = Field(
        description="reasons why the robot cannot do a task now, one sentence each"
    )
    task: Task | None = Field(description="task that it does; null: none")
    pose: RobotPose | None = Field(description="pose of the robot in its own world; null: unknown")
    battery: float | None = Field(description="charge of the battery, 0 to 1; null: unknown")
    held: str = Field(description="class of the held object; empty: none")
    picture: str | None = Field(
        description="address of the newest camera image; null: none has come yet",
        examples=["/v1/robots/robot-2/camera.jpg"],
    )


class Fleet(BaseModel):
    """All robots of this gateway, and the tasks of the fleet that have not ended."""

    robots: list[FleetRobot] = Field(description="robots, in the order of the settings")
    tasks: list[FleetTask] = Field(
        description="open tasks of the fleet, in the order in which robots get them"
    )
