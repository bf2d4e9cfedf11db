"""Request and response models of the HTTP API. World frame: z up, metres; names carry the units."""

from __future__ import annotations

from typing import Annotated, Literal

from helios_core.health import HealthState
from helios_core.printable_text import printable
from helios_core.task_states import ENDED, TaskState
from helios_core.topics import MAX_INSTRUCTION_CHARACTERS
from pydantic import BaseModel, ConfigDict, Field, JsonValue, field_validator

Vector3 = Annotated[list[float | None], Field(description="x, y, z in the world frame, metres")]
Vector2 = Annotated[list[float | None], Field(description="x, y in the world frame, metres")]
ServiceState = Literal[HealthState, "down"]


class TaskRequest(BaseModel):
    """Task as an instruction in natural language."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "example": {"instruction": "Move the mug from the coffee table to the kitchen counter"}
        },
    )

    instruction: str = Field(
        description=f"task in natural language; at most {MAX_INSTRUCTION_CHARACTERS} characters"
    )
    max_steps: int | None = Field(
        default=None,
        ge=1,
        le=1_000_000,
        description="maximum number of robot steps; null: the planner's setting",
    )

    time_limit_s: float | None = Field(
        default=None,
        gt=0,
        le=86_400,
        description="time limit in seconds from the start of the task; null: the planner's setting",
    )

    agent: str | None = Field(
        default=None,
        max_length=100,
        description="agent that runs the task: helios, trusting …, or another one that the "
        "planner allows; null: the planner's setting",
    )

    priority: int = Field(
        default=0,
        ge=-100,
        le=100,
        description="priority in the queue; tasks with a higher value start first",
    )

    settings: dict[str, str | float] = Field(
        default_factory=dict,
        max_length=30,
        description="planner settings for this task alone; the error for an unknown name lists "
        "the known ones",
        examples=[{"alpha_d": 0.01}],
    )

    @field_validator("settings")
    @classmethod
    def _is_plain(cls, settings: dict[str, str | float]) -> dict[str, str | float]:
        if not all(
            name.isidentifier() and str(value).isprintable() for name, value in settings.items()
        ):
            raise ValueError("names and values of settings are plain words and numbers")
        return settings

    @field_validator("instruction")
    @classmethod
    def _is_text(cls, text: str) -> str:
        if len(text) > MAX_INSTRUCTION_CHARACTERS:
            raise ValueError(
                f"the instruction has {len(text)} characters; send at most "
                f"{MAX_INSTRUCTION_CHARACTERS}"
            )
        if not text.strip():
            raise ValueError("the instruction is empty; say what to move, find or go to")
        try:
            text.encode()
        except UnicodeEncodeError as error:
            raise ValueError(
                "the instruction holds half a character; send whole Unicode"
            ) from error
        if (at := _control_character(text)) is not None:
            raise ValueError(
                f"the instruction holds the control character U+{ord(text[at]):04X} as its "
                f"character {at + 1}; send plain text"
            )
        return text


def _control_character(text: str) -> int | None:
    """Index of the first control character except tab and line end; None if there is none."""
    shown = printable(text)
    return next((i for i, c in enumerate(shown) if c == "\ufffd" and text[i] != c), None)


class Phase(BaseModel):
    """One phase of a task."""

    name: str = Field(examples=["find_object"])
    state: Literal["waiting", "active", "done", "failed"] = Field(
        description="progress of the phase"
    )


class GoalPoint(BaseModel):
    """Goal of a task of kind `go_to_point`, in the world frame."""

    x_m: float | None = Field(description="x coordinate in the world frame, metres")
    y_m: float | None = Field(description="y coordinate in the world frame, metres")
    yaw_rad: float | None = Field(
        description="heading at the goal, counter-clockwise from the world's x axis; null: "
        "any heading"
    )


class Task(BaseModel):
    """Task with its state and progress."""

    id: str = Field(description="identifier of the task, used in all other requests")
    instruction: str = Field(description="instruction as submitted")
    state: TaskState = Field(description="current state; succeeded, failed and cancelled are final")
    phase: str = Field(
        description="current phase: find_object, pick, find_receptacle, place, go or explore"
    )
    phases: list[Phase] = Field(description="phases of a task of this kind, in order")
    message: str = Field(description="current activity, or reason for the end, in one sentence")
    cause: str = Field(
        description="cause of a failure, from a closed list; empty if the task has not failed"
    )
    seeking: str = Field(
        description="name of the object or place that the task looks for now", examples=["mug"]
    )
    kind: str = Field(
        description="kind of the task: move, find, go_to, go_to_point, explore or go_home"
    )
    object: str = Field(examples=["mug"])
    start: str = Field(
        description="start receptacle, from which to take the object", examples=["coffee table"]
    )
    goal: str = Field(
        description="goal receptacle, on which to place the object or to which to go",
        examples=["kitchen counter"],
    )
    steps: int = Field(description="number of robot steps so far")
    max_steps: int = Field(description="number of robot steps after which the task fails")
    time_limit_s: float | None = Field(
        description="time limit in seconds from the start of the task; null: none"
    )
    picks: int = Field(description="number of pick attempts so far")
    progress: float | None = Field(
        description="estimated progress, 0 to 1; approximate, for display; never falls"
    )
    eta_s: tuple[float, float] | None = Field(
        description="estimated remaining time in seconds, as minimum and maximum; null: unknown",
        examples=[[40.0, 310.0]],
    )
    created_s: float | None = Field(description="creation time, seconds since 1970")
    started_s: float | None = Field(
        description="start time, seconds since 1970; null: not started yet"
    )
    ended_s: float | None = Field(description="end time, seconds since 1970; null: not ended yet")
    context_id: str = Field(description="identifier of the search context that the task uses")
    agent: str = Field(description="agent that runs the task", examples=["helios"])
    priority: int = Field(
        description="priority in the queue; tasks with a higher value start first"
    )
    settings: dict[str, str] = Field(
        description="planner settings for this task alone", examples=[{"alpha_d": "0.01"}]
    )
    on_hold: bool = Field(
        description="true if a client has paused the task and none has resumed it yet"
    )
    unused: list[str] = Field(
        description="words of the instruction that have no effect on the task",
        examples=[["in the kitchen"]],
    )
    seen_at_goal: bool | None = Field(
        description="true if the robot saw the placed object on the goal receptacle "
        "afterwards; null: nothing was placed, or the task ended before the result was known"
    )
    point: GoalPoint | None = Field(
        description="goal of a task of kind go_to_point; null: task of another kind"
    )
    trace_id: str | None = Field(
        description="identifier of the task's trace in OpenTelemetry; null: it is not traced"
    )
    recordings: list[str] = Field(
        description="names of the recordings around its failure, for "
        "`/v1/faults/recordings/{recording}`"
    )

    @property
    def ended(self) -> bool:
        return self.state in ENDED


class TaskList(BaseModel):
    tasks: list[Task] = Field(description="tasks, newest first")


class Candidate(BaseModel):
    """One candidate of a decision."""

    kind: str = Field(description="kind of the candidate: object, receptacle, frontier or gaze")
    name: str = Field(
        description="class of the object or receptacle, or name of the frontier or viewpoint"
    )
    position_m: Vector3 = Field(description="position in the world frame, metres")
    terms: dict[str, float | None] = Field(
        description="terms by which the rule compared the candidate, by name",
        examples=[{"class_score": 0.62, "distance_m": 3.1}],
    )
    chosen: bool = Field(description="true if the decision chose this candidate")


class Recomputed(BaseModel):
    """Decision recomputed under other settings, by the same functions."""

    do: str = Field(description="action under these settings")
    why: str = Field(description="reason, in one sentence")
    candidates: list[Candidate] = Field(
        description="candidates with their terms under these settings"
    )
    flips: bool = Field(description="true if these settings lead to another candidate or action")
    certain: bool = Field(
        description="false if the outcome depends on data that was not collected at that time"
    )


class Decision(BaseModel):
    """Decision with its candidates, its rule and its reason."""

    task_id: str = Field(description="identifier of the task that made the decision")
    index: int = Field(description="position among the decisions of the task, from 0")
    phase: str = Field(description="phase of the task at the time of the decision")
    rule: str = Field(examples=["global_search (eq. 10)", "given up"])
    do: str = Field(
        description="chosen action: act, look, search_on, search_receptacle, go_to_frontier "
        "or nothing_left"
    )
    why: str = Field(description="reason, in one sentence")
    candidates: list[Candidate] = Field(description="candidates that the decision compared")
    settings: dict[str, float | None] = Field(
        description="values of the settings that the rule used"
    )
    made_s: float | None = Field(description="time of the decision, seconds since 1970")
    context_id: str = Field(
        description="identifier of the search context at the time of the decision"
    )
    recomputed: Recomputed | None = Field(
        description="decision recomputed under the requested settings; null: none requested, or "
        "another version of the planner stored it in another form"
    )


class DecisionList(BaseModel):
    decisions: list[Decision] = Field(description="decisions, oldest first")


class Plan(BaseModel):
    """Path that the robot follows; empty while it stands."""

    task_id: str = Field(description="identifier of the task that the path belongs to")
    path_m: list[Vector2] = Field(
        description="points of the path in the world frame, metres, starting at the robot"
    )
    goal: RobotPose | None = Field(description="pose at the end of the path; null: no goal")
    purpose: str = Field(description="purpose of the motion, in a few words")


class RobotPose(BaseModel):
    x_m: float = Field(description="x coordinate in the world frame, metres")
    y_m: float = Field(description="y coordinate in the world frame, metres")
    yaw_rad: float = Field(description="heading, counter-clockwise from the world's x axis")


class RobotState(BaseModel):
    """Current state of the robot."""

    pose: RobotPose | None = Field(description="pose of the robot on the floor; null: unknown")
    tilt_rad: float | None = Field(description="tilt of the head; positive looks down")
    held: str = Field(description="class of the held object; empty: none")
    moving: bool = Field(description="true while the base moves")
    stopped: bool = Field(description="true if the robot is stopped until /v1/robot/clear-stop")
    finished: bool = Field(description="true if the replayed recording has ended")
    message: str = Field(description="message from the robot, in one sentence")
    robot_boot_id: str = Field(
        description="identifier of this start of the robot; changes with every start"
    )
    world_epoch: int = Field(
        description="world epoch; rises by 1 when the localisation jumps, and new maps begin"
    )
    origin_id: str = Field(
        description="name of the origin of the robot's poses; if it stays the same, maps outlive "
        "a restart of the robot; empty: unknown"
    )
    battery: float | None = Field(description="charge of the battery, 0 to 1; null: unknown")


class RobotDescription(BaseModel):
    """Dimensions, camera and abilities of the robot."""

    name: str = Field(description="name that the robot reports")
    simulated: bool = Field(description="true for a simulated robot")
    footprint_radius_m: float | None = Field(description="radius of the circle around the base")
    height_m: float | None = Field(description="height of the whole robot")
    reach_m: float | None = Field(
        description="horizontal reach of the arm from the centre of the base"
    )
    max_depth_m: float | None = Field(description="largest depth that the camera measures")
    camera_height_m: float | None = Field(description="height of the camera above the floor")
    camera_width_px: int = Field(description="width of the camera image")
    camera_height_px: int = Field(description="height of the camera image")
    can_move: bool = Field(description="true if the robot can drive")
    can_pick: bool = Field(description="true if the robot can pick up objects")
    can_place: bool = Field(description="true if the robot can put down objects")
    min_forward_m: float | None = Field(description="shortest single move")
    max_forward_m: float | None = Field(description="longest single move forward")
    max_back_m: float | None = Field(
        description="longest single move backward; 0: the robot cannot move back"
    )
    min_turn_rad: float | None = Field(description="smallest single turn")
    max_turn_rad: float | None = Field(description="largest single turn")


class Robot(BaseModel):
    connected: bool = Field(description="true if the bridge is alive")
    state: RobotState | None = Field(description="state of the robot; null: not received yet")
    description: RobotDescription | None = Field(
        description="description of the robot; null: not received yet"
    )


class Service(BaseModel):
    """One service of the stack, or its router."""

    name: str = Field(examples=["map2d"])
    state: ServiceState = Field(
        description="health of the service; a `ready` service handles requests; a `degraded` one "
        "has a fault, and may still handle them"
    )
    reason: str = Field(
        description="condition that the service waits for, or cause of a problem; empty: no problem"
    )
    restarts: int = Field(description="number of restarts by the supervisor")
    pid: int | None = Field(description="process id; null: unknown")


class Status(BaseModel):
    ready: bool = Field(
        description="true if the robot can do a task now: every service that a task needs handles "
        "requests, and the robot is not stopped"
    )
    stopped: bool = Field(description="true if the robot is stopped until /v1/robot/clear-stop")
    stop_reason: str = Field(
        description="reason given with the stop; empty if the robot is not stopped"
    )
    services: list[Service] = Field(description="all known services")


class Readiness(BaseModel):
    ready: bool = Field(
        description="true if the robot can do a task now: every service that a task needs handles "
        "requests, and the robot is not stopped; in `/readyz`: true if all robots can"
    )
    stopped: bool = Field(description="true if the robot is stopped until /v1/robot/clear-stop")
    stop_reason: str = Field(
        default="", description="reason given with the stop; empty if the robot is not stopped"
    )
    reasons: list[str] = Field(
        description="reasons why a robot cannot do a task now, one sentence each"
    )


class HealthAnswer(BaseModel):
    healthy: Literal[True] = Field(default=True, description="always true: the process responds")


class Vocabulary(BaseModel):
    """Names that the detector can look for, and the models in use."""

    open: bool = Field(description="true if the detector accepts any class name")
    names: list[str] = Field(description="class names that the detector knows")
    detector: str = Field(description="name of the detector")
    scorer: str = Field(description="name of the image-text scorer")


class SeenName(BaseModel):
    """Name of which the object map holds at least one object."""

    name: str = Field(examples=["coffee table"])
    score: float = Field(description="highest score Ψ among the objects of this name, eq. 7")
    objects: int = Field(description="number of objects of this name in the object map")


class Suggestions(BaseModel):
    """Tasks to try in this home, and the names seen in it."""

    tasks: list[str] = Field(
        description="suggested instructions that this robot can carry out",
        examples=[["Move the mug from the coffee table to the kitchen counter"]],
    )
    seen: list[SeenName] | None = Field(
        description="names seen in this home, highest score first; null: the object map does "
        "not respond"
    )


class StopRequest(BaseModel):
    """Reason for a stop. The robot stops even if the body is invalid."""

    reason: str = Field(
        default="stop-now was asked for over HTTP",
        description="reason for the stop; cut at 500 characters",
    )


class RobotEntry(BaseModel):
    """One robot that this gateway serves."""

    name: str = Field(description="name of the robot, as in `/v1/robots/NAME`")
    connected: bool = Field(description="true if the robot's bridge is alive")
    ready: bool = Field(
        description="true if the robot can do a task now: every service that a task needs handles "
        "requests, and the robot is not stopped"
    )
    stopped: bool = Field(description="true if the robot is stopped until /v1/robot/clear-stop")


class RobotList(BaseModel):
    robots: list[RobotEntry] = Field(
        description="robots of this gateway; a request without a name addresses the first one"
    )


class SettingValue(BaseModel):
    """One setting of a running service."""

    value: JsonValue = Field(description="value in the running service")
    default: JsonValue = Field(description="default value")
    description: str = Field(description="meaning of the setting, with its unit")


class ServiceSettings(BaseModel):
    """Settings that a service was started with. Secrets are masked."""

    service: str = Field(description="name of the service")
    settings: dict[str, SettingValue] = Field(description="settings by name")


class SessionRequest(BaseModel):
    """API key to store in the session cookie."""

    model_config = ConfigDict(extra="forbid")

    key: str = Field(description="API key, made with `helios key`", min_length=1, max_length=200)


class Session(BaseModel):
    """Key requirement of the gateway, with the name and scope of the key in the request."""

    required: bool = Field(description="true if requests need a key")
    name: str = Field(description="name of the key; empty: the request has no known key")
    scope: Literal["read", "task", "robot", "admin"] | None = Field(
        description="scope of the key; null: the request has no known key"
    )
