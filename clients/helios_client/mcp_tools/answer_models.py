"""Results of the tools: the objects of the HTTP interface.

The schema of each model names the fields that an agent uses; all other fields are passed on.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field


class Answer(BaseModel):
    """Complete object of the HTTP interface."""

    model_config = ConfigDict(extra="allow")


Text = Annotated[str | None, Field(default=None)]
Number = Annotated[float | None, Field(default=None)]
Metres = Annotated[
    list[float | None] | None, Field(default=None, description="world frame, metres")
]


class Task(Answer):
    """A task and its progress. Times are seconds since 1970."""

    id: str
    instruction: str
    state: str = Field(
        description="current state: queued, running, paused, succeeded, failed or cancelled"
    )
    phase: Text
    message: str | None = Field(default=None, description="current activity, or reason for the end")
    seeking: Text
    cause: str | None = Field(default=None, description="cause of a failure, from a closed list")
    progress: float | None = Field(default=None, description="estimated progress, 0 to 1")
    eta_s: list[float] | None = Field(
        default=None,
        description="estimated remaining seconds, as minimum and maximum; null: unknown",
    )
    steps: int | None = Field(default=None, description="number of robot steps so far")
    on_hold: bool | None = Field(default=None, description="true if a client has paused the task")


class Decision(Answer):
    """A decision with its rule, reason and candidates."""

    index: int | None = None
    phase: Text
    rule: Text
    why: str | None = Field(default=None, description="reason, in one sentence")
    candidates: list[dict[str, Any]] | None = Field(
        default=None, description="candidates of the decision, each with its terms"
    )


class FoundObject(Answer):
    """One object instance of the object map; world frame, z up."""

    id: int
    class_name: str | None = Field(default=None, alias="class")
    center_m: Metres
    size_m: Metres
    score: float | None = Field(
        default=None, description="score Ψ: class score minus weighted uncertainty"
    )
    views: int | None = Field(default=None, description="number of distinct viewpoints")


class Seen(Answer):
    """Places where something was seen. The images of the views follow, in the same order."""

    prompt: Text
    objects: list[FoundObject] = Field(
        description="matching objects of the object map, highest score first"
    )
    views: list[dict[str, Any]] = Field(description="matching past views, best first")
    views_note: Text


class Vocabulary(Answer):
    """Names that a task may use."""

    open: bool = Field(
        description="true if any name is allowed; false if only those in `names` are"
    )
    names: list[str]
    detector: Text


class Suggestions(Answer):
    """Names seen in this home, and tasks to try."""

    tasks: list[str] = Field(description="suggested instructions that this robot can carry out")
    seen: list[dict[str, Any]] | None = Field(
        default=None,
        description="names with their score and number of objects, highest score first",
    )


class Map(Answer):
    """2D map without its cells."""

    cell_m: Number
    origin_m: Metres
    width_cells: int | None = None
    height_cells: int | None = None
    explored_m2: Number
    robot: dict[str, Any] | None = Field(
        default=None, description="pose of the robot: x_m, y_m, yaw_rad"
    )
    frontiers: list[dict[str, Any]] = Field(
        description="frontiers (borders of the explored floor) with their values"
    )


class Robot(Answer):
    """Connection, state and description of the robot."""

    connected: bool
    state: dict[str, Any] | None = Field(
        default=None, description="pose, held, moving, stopped and message; null: not received yet"
    )
    description: dict[str, Any] | None = Field(
        default=None, description="dimensions and abilities of the robot"
    )


class Moved(Answer):
    """Result of one short move, as the robot measured it."""

    succeeded: bool
    reason: str | None = Field(default=None, description="reason for a failure, in one sentence")
    moved_m: Number
    turned_rad: Number
    collided: bool | None = None


class Service(Answer):
    """Health of one service."""

    name: str
    state: str = Field(
        description="health of the service: starting, waiting, ready, degraded, stopping or down"
    )
    reason: Text
    restarts: int | None = None


class Status(Answer):
    """Readiness for a new task, and the health of every service."""

    ready: bool
    stopped: bool | None = Field(
        default=None, description="true if the robot is stopped until clear_stop"
    )
    stop_reason: str | None = Field(default=None, description="reason given with the stop")
    services: list[Service]
