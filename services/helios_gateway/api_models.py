"""Request and response models of the HTTP API. World frame: z up, metres; names carry the units."""

from __future__ import annotations

from typing import Annotated, Literal

from helios_core.health import HealthState
from helios_core.printable_text import printable
from helios_core.task_states import ENDED, TaskState
from pydantic import BaseModel, ConfigDict, Field, JsonValue, field_validator

MAX_INSTRUCTION_CHARACTERS = 10_000
Vector3 = Annotated[list[float | None], Field(description="x, y, z in the world, metres")]
Vector2 = Annotated[list[float | None], Field(description="x, y in the world, metres")]
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
        description=f"what to do, in words; at most {MAX_INSTRUCTION_CHARACTERS} characters"
    )
    max_steps: int | None = Field(
        default=None,
        ge=1,
        le=1_000_000,
        description="steps of the robot allowed; null: the setting",
    )

    time_limit_s: float | None = Field(
        default=None,
        gt=0,
        le=86_400,
        description="seconds from its start after which it ends; null: the setting",
    )

    agent: str | None = Field(
        default=None,
        max_length=100,
        description="who does it: helios, trusting …, or another that the planner lets tasks "
        "name; null: the setting",
    )

    priority: int = Field(
        default=0, ge=-100, le=100, description="of the queued ones a higher one is begun first"
    )

    settings: dict[str, str | float] = Field(
        default_factory=dict,
        max_length=30,
        description="settings of the planner for this task alone, such as alpha_d; a wrong name is "
        "answered with those there are",
        examples=[{"alpha_d": 0.01}],
    )

    @field_validator("settings")
    @classmethod
    def _is_plain(cls, settings: dict[str, str | float]) -> dict[str, str | float]:
        if not all(name.isidentifier() and str(value).isprintable()
                   for name, value in settings.items()):  # fmt: skip
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
    state: Literal["waiting", "active", "done", "failed"] = Field(description="how far it is")


class GoalPoint(BaseModel):
    """Goal of a task of kind `go_to_point`, in the world frame."""

    x_m: float | None = Field(description="metres in the world frame")
    y_m: float | None = Field(description="metres in the world frame")
    yaw_rad: float | None = Field(description="null: whichever way it comes")


class Task(BaseModel):
    """Task with its state and progress."""

    id: str = Field(description="names the task in every other request")
    instruction: str = Field(description="the sentence that was submitted")
    state: TaskState = Field(description="queued, under way (running, paused), or how it ended")
    phase: str = Field(description="find_object, pick, find_receptacle, place, go or explore")
    phases: list[Phase] = Field(description="the phases of a task of this kind, in order")
    message: str = Field(description="what it does now, or why it ended, in one sentence")
    cause: str = Field(description="of a failure: one of a closed list; else empty")
    seeking: str = Field(description="what is sought now", examples=["mug"])
    kind: str = Field(description="move, find, go_to, go_to_point, explore or go_home")
    object: str = Field(examples=["mug"])
    start: str = Field(description="receptacle to take it from", examples=["coffee table"])
    goal: str = Field(description="receptacle to bring it to", examples=["kitchen counter"])
    steps: int = Field(description="steps of the robot so far")
    max_steps: int = Field(description="it fails after so many steps")
    time_limit_s: float | None = Field(description="seconds from its start; null: none")
    picks: int = Field(description="picks tried so far")
    progress: float | None = Field(description="0 to 1, a rough guide for people; never falls")
    eta_s: tuple[float, float] | None = Field(
        description="it may end in so many seconds: at least, at most; null: nobody can say",
        examples=[[40.0, 310.0]],
    )
    created_s: float | None = Field(description="seconds since 1970")
    started_s: float | None = Field(description="seconds since 1970; null: not yet")
    ended_s: float | None = Field(description="seconds since 1970; null: not yet")
    context_id: str = Field(description="the search context it works in")
    agent: str = Field(description="which agent does it", examples=["helios"])
    priority: int = Field(description="of the queued ones a higher one is begun first")
    settings: dict[str, str] = Field(
        description="of the planner, for this task alone", examples=[{"alpha_d": "0.01"}]
    )
    on_hold: bool = Field(description="somebody paused it, and nobody has resumed it yet")
    unused: list[str] = Field(
        description="what was said and does not change the task", examples=[["in the kitchen"]]
    )
    seen_at_goal: bool | None = Field(
        description="of a thing that was placed: whether it was seen on the goal receptacle "
        "afterwards; null: nothing was placed, or the task ended before that was known"
    )
    point: GoalPoint | None = Field(description="of kind go_to_point; null: of any other")

    @property
    def ended(self) -> bool:
        return self.state in ENDED


class TaskList(BaseModel):
    tasks: list[Task] = Field(description="newest first")


class Candidate(BaseModel):
    """One candidate of a decision."""

    kind: str = Field(description="object, receptacle, frontier or gaze")
    name: str = Field(description="class of the thing, or which frontier or gaze point")
    position_m: Vector3 = Field(description="in the world frame")
    terms: dict[str, float | None] = Field(
        description="what it was judged by", examples=[{"class_score": 0.62, "distance_m": 3.1}]
    )
    chosen: bool = Field(description="the decision took this one")


class Recomputed(BaseModel):
    """Decision recomputed under other settings, by the same functions."""

    do: str = Field(description="what would have been done")
    why: str = Field(description="one sentence")
    candidates: list[Candidate] = Field(description="with their terms under these settings")
    flips: bool = Field(description="another would have been chosen, or something else done")
    certain: bool = Field(description="false: it depends on what was not asked for at that time")


class Decision(BaseModel):
    """Decision with its candidates, its rule and its reason."""

    task_id: str = Field(description="of which task")
    index: int = Field(description="its place among the decisions of the task, from 0")
    phase: str = Field(description="the phase of the task then")
    rule: str = Field(examples=["global_search (eq. 10)", "given up"])
    do: str = Field(
        description="act, look, search_on, search_receptacle, go_to_frontier or nothing_left"
    )
    why: str = Field(description="one sentence")
    candidates: list[Candidate] = Field(description="what was chosen among")
    settings: dict[str, float | None] = Field(description="the values that the rule used")
    made_s: float | None = Field(description="seconds since 1970")
    context_id: str = Field(description="the search context then")
    recomputed: Recomputed | None = Field(
        description="under the settings that were asked for; null: none were"
    )


class DecisionList(BaseModel):
    decisions: list[Decision] = Field(description="oldest first")


class Plan(BaseModel):
    """Path that the robot follows; empty while it stands."""

    task_id: str = Field(description="of which task")
    path_m: list[Vector2] = Field(description="points in the world frame, from the robot on")
    goal: RobotPose | None = Field(description="where the path ends; null: nowhere")
    purpose: str = Field(description="why the robot drives, in a few words")


class RobotPose(BaseModel):
    x_m: float = Field(description="metres in the world frame")
    y_m: float = Field(description="metres in the world frame")
    yaw_rad: float = Field(description="counter-clockwise from the world's x axis")


class RobotState(BaseModel):
    """Current state of the robot."""

    pose: RobotPose | None = Field(description="null: the robot does not know")
    tilt_rad: float | None = Field(description="of the head; positive looks down")
    held: str = Field(description="class of what is held; empty: nothing")
    moving: bool = Field(description="the base moves now")
    stopped: bool = Field(description="stopped until /v1/robot/clear-stop")
    finished: bool = Field(description="a recording has come to its end")
    message: str = Field(description="one sentence of the robot for people")
    robot_boot_id: str = Field(description="another text after each start of the robot")
    world_epoch: int = Field(description="rises by 1 when localisation jumps; the maps begin anew")
    origin_id: str = Field(
        description="of its poses: where it stays the same, maps outlive a start of the robot; "
        "empty: not known"
    )


class RobotDescription(BaseModel):
    """Dimensions, camera and abilities of the robot."""

    name: str = Field(description="as the robot calls itself")
    simulated: bool = Field(description="it is a simulator")
    footprint_radius_m: float | None = Field(description="of the circle around the base")
    height_m: float | None = Field(description="of the whole robot")
    reach_m: float | None = Field(description="of the arm, level, from the base's centre")
    max_depth_m: float | None = Field(description="farthest depth that the camera measures")
    camera_height_m: float | None = Field(description="of the camera above the floor")
    camera_width_px: int = Field(description="of the camera's image")
    camera_height_px: int = Field(description="of the camera's image")
    can_move: bool = Field(description="it drives")
    can_pick: bool = Field(description="it can pick things up")
    can_place: bool = Field(description="it can put things down")
    min_forward_m: float | None = Field(description="shortest single move")
    max_forward_m: float | None = Field(description="longest single move ahead")
    max_back_m: float | None = Field(description="longest single move back; 0: it cannot")
    min_turn_rad: float | None = Field(description="smallest single turn")
    max_turn_rad: float | None = Field(description="largest single turn")


class Robot(BaseModel):
    connected: bool = Field(description="the bridge is alive")
    state: RobotState | None = Field(description="null: nothing heard yet")
    description: RobotDescription | None = Field(description="null: nothing heard yet")


class Service(BaseModel):
    """One service of the stack, or its router."""

    name: str = Field(examples=["map2d"])
    state: ServiceState = Field(description="`ready` and `degraded` serve; the others do not")
    reason: str = Field(description="what it waits for, or why it is not ready; empty: all is well")
    restarts: int = Field(description="by the supervisor")
    pid: int | None = Field(description="process id; null: not known")


class Status(BaseModel):
    ready: bool = Field(description="a task submitted now would start")
    stopped: bool = Field(description="stopped until /v1/robot/clear-stop")
    stop_reason: str = Field(description="why it is stopped, as was said then; else empty")
    services: list[Service] = Field(description="every service that was heard")


class Readiness(BaseModel):
    ready: bool = Field(description="a task submitted now would start")
    stopped: bool = Field(description="the robot is stopped until /v1/robot/clear-stop")
    stop_reason: str = Field(
        default="", description="why a robot is stopped, as was said then; else empty"
    )
    reasons: list[str] = Field(description="one sentence for each thing that is in the way")


class HealthAnswer(BaseModel):
    healthy: Literal[True] = Field(default=True, description="the process answers")


class Vocabulary(BaseModel):
    """Names that the detector can look for, and the models in use."""

    open: bool = Field(description="any name may be asked for")
    names: list[str] = Field(description="names that it knows")
    detector: str = Field(description="which detector")
    scorer: str = Field(description="which image-text scorer")


class SeenName(BaseModel):
    """Name of which the object map holds at least one object."""

    name: str = Field(examples=["coffee table"])
    score: float = Field(description="Ψ of the surest one, eq. 7")
    objects: int = Field(description="how many of that name are in the map")


class Suggestions(BaseModel):
    """Tasks to try in this home, and the names seen in it."""

    tasks: list[str] = Field(
        description="instructions to try, which this robot can do",
        examples=[["Move the mug from the coffee table to the kitchen counter"]],
    )
    seen: list[SeenName] | None = Field(
        description="what was seen here, the surest first; null: the object map does not answer"
    )


class StopRequest(BaseModel):
    """Reason for a stop. The robot stops even if the body is invalid."""

    reason: str = Field(
        default="stop-now was asked for over HTTP",
        description="of a longer one the first 500 characters are kept",
    )


class RobotEntry(BaseModel):
    """One robot that this gateway serves."""

    name: str = Field(description="as in `/v1/robots/NAME`")
    connected: bool = Field(description="its bridge is alive")
    ready: bool = Field(description="a task submitted to it now would start")
    stopped: bool = Field(description="the robot is stopped until /v1/robot/clear-stop")


class RobotList(BaseModel):
    robots: list[RobotEntry] = Field(description="the first one is meant where none is named")


class SettingValue(BaseModel):
    """One setting of a running service."""

    value: JsonValue = Field(description="what the service runs with")
    default: JsonValue = Field(description="what it would be if nobody set it")
    description: str = Field(description="what it means, with its unit")


class ServiceSettings(BaseModel):
    """Settings that a service was started with. Secrets are masked."""

    service: str = Field(description="name of the service")
    settings: dict[str, SettingValue] = Field(description="by name")


class SessionRequest(BaseModel):
    """API key to store in the session cookie."""

    model_config = ConfigDict(extra="forbid")

    key: str = Field(description="made with `helios key`", min_length=1, max_length=200)


class Session(BaseModel):
    """Key requirement of the gateway, with the name and scope of the key in the request."""

    required: bool = Field(description="requests need a key")
    name: str = Field(description="of the key; empty: none came, or none that is known")
    scope: Literal["read", "operate", "admin"] | None = Field(
        description="what the key may do; null: no known key came"
    )
