"""Typed responses of the HTTP interface. `raw` holds the whole JSON object, including the fields
that a class does not declare."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self, TypedDict

from helios_core.task_states import ENDED


def check_keys(raw: Mapping[str, Any], wanted: Iterable[str]) -> None:
    """Raise KeyError if an answer lacks one of these keys, and AttributeError if it is no JSON
    object."""
    if missing := sorted(set(wanted) - raw.keys()):
        raise KeyError(", ".join(missing))


@dataclass(frozen=True)
class _FromJson:
    REQUIRED: ClassVar[tuple[str, ...]] = ()  # fields that every version gives

    raw: dict[str, Any] = field(default_factory=dict, repr=False, kw_only=True)

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        """Instance from one JSON object; a missing field has its default. Raises KeyError if one of
        `REQUIRED` is missing."""
        check_keys(raw, cls.REQUIRED)
        known = {f.name for f in fields(cls)} - {"raw"}
        values = {k: v for k, v in raw.items() if k in known and v is not None}
        return cls(**values, raw=raw)


class _WithEnd:
    """What the state of a task says about its end."""

    state: str

    @property
    def ended(self) -> bool:
        return self.state in ENDED

    @property
    def succeeded(self) -> bool:
        return self.state == "succeeded"


@dataclass(frozen=True)
class Task(_WithEnd, _FromJson):
    """A task and its progress. Times are seconds since 1970."""

    REQUIRED = ("id", "state")

    id: str = ""
    instruction: str = ""
    state: str = ""  # queued, running, paused, succeeded, failed, cancelled
    phase: str = ""  # find_object, pick, find_receptacle, place, go, explore
    message: str = ""  # current activity, or the reason for the end
    cause: str = ""  # cause of a failure, from a closed list
    seeking: str = ""  # name of the object or place that the task looks for now
    agent: str = ""  # agent that runs the task: helios, trusting …
    priority: int = 0  # tasks with a higher value start first
    settings: dict[str, str] = field(default_factory=dict)  # planner settings for this task alone
    kind: str = ""  # move, find, go_to, go_to_point, explore, go_home
    object: str = ""
    start: str = ""
    goal: str = ""
    steps: int = 0
    max_steps: int = 0
    time_limit_s: float | None = None  # from the start of the task; None: no limit
    picks: int = 0
    progress: float = 0.0  # 0 to 1, approximate; never falls
    # Remaining seconds, as minimum and maximum. None: unknown.
    eta_s: list[float] | None = None
    created_s: float = 0.0
    started_s: float = 0.0
    ended_s: float = 0.0
    on_hold: bool = False  # paused by a client, and not resumed yet
    unused: list[str] = field(default_factory=list)  # words of the instruction without effect
    seen_at_goal: bool | None = None  # seen after placing; None: not placed, or unknown

    point: GoalPoint | None = None  # for kind go_to_point
    trace_id: str = ""  # trace in OpenTelemetry; empty: it is not traced
    recordings: list[str] = field(default_factory=list)  # names of recordings around its failure


@dataclass(frozen=True)
class FleetTask(_WithEnd, _FromJson):
    """A task of the fleet. Times are seconds since 1970."""

    REQUIRED = ("id", "state")

    id: str = ""  # its id in the fleet
    instruction: str = ""
    state: str = ""  # as of a task; queued also until its robot has begun it
    message: str = ""  # what it waits for, current activity, or the reason for the end
    wanted: str = ""  # robot that the request named; any: the fleet chooses
    robot: str = ""  # robot that has the task; empty: it waits in the queue
    task_id: str = ""  # id of the task at its robot
    begun: bool = False  # the robot has been told to start; the task stays with it
    why: str = ""  # why this robot was chosen
    priority: int = 0  # tasks with a higher value get a robot first
    unused: list[str] = field(default_factory=list)  # words of the instruction without effect
    returned: int = 0  # times that a robot gave it back
    refused: dict[str, str] = field(default_factory=dict)  # reasons of robots that cannot do it
    created_s: float = 0.0
    ended_s: float = 0.0
    task: dict[str, Any] | None = None  # the task at its robot, as JSON


@dataclass(frozen=True)
class Decision(_FromJson):
    """A decision with its rule, reason and candidates."""

    task_id: str = ""
    index: int = 0
    phase: str = ""
    rule: str = ""
    do: str = ""  # act, look, search_on, search_receptacle, go_to_frontier, nothing_left
    why: str = ""
    candidates: list[dict[str, Any]] = field(default_factory=list)
    settings: dict[str, float] = field(default_factory=dict)
    made_s: float = 0.0
    recomputed: dict[str, Any] | None = None  # decision under other settings, if requested


@dataclass(frozen=True)
class Trace(_FromJson):
    """Spans of one task, and what each service contributed."""

    REQUIRED = ("spans", "sources")

    task_id: str = ""
    trace_id: str = ""
    spans: list[dict[str, Any]] = field(default_factory=list)
    sources: list[dict[str, Any]] = field(default_factory=list)  # service, spans, note


@dataclass(frozen=True)
class Fault(_FromJson):
    """A fault of a service, of the robot or of a task. Times are seconds since 1970."""

    REQUIRED = ("id", "state")

    id: str = ""
    source: str = ""  # service, robot or task
    kind: str = ""
    severity: str = ""  # warning or error
    state: str = ""  # raised, confirmed, cleared
    message: str = ""  # its newest occurrence
    count: int = 0  # occurrences since the first
    first_s: float = 0.0
    last_s: float = 0.0
    raised_s: float = 0.0
    confirmed_s: float = 0.0  # 0: not confirmed
    cleared_s: float = 0.0  # 0: not cleared
    recordings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class FaultRecording(_FromJson):
    """Recording of the time around faults, an MCAP file."""

    name: str = ""
    made_s: float = 0.0
    faults: list[str] = field(default_factory=list)
    tasks: list[str] = field(default_factory=list)  # failed tasks that it shows
    bytes: int | None = None  # None: it is still being made


@dataclass(frozen=True)
class FaultList(_FromJson):
    """Faults, and the recordings around them, newest first."""

    faults: list[Fault] = field(default_factory=list)
    recordings: list[FaultRecording] = field(default_factory=list)
    folder: str = ""  # of the recordings, on the gateway's machine; empty: none are made

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        found = super().from_json(raw)
        return replace(
            found,
            faults=[Fault.from_json(f) for f in raw["faults"]],
            recordings=[FaultRecording.from_json(r) for r in raw["recordings"]],
        )


@dataclass(frozen=True)
class FoundObject(_FromJson):
    """One instance of the object map; lengths in metres, world frame, z up."""

    REQUIRED = ("id", "class")

    id: int = 0
    class_name: str = ""
    center_m: list[float] = field(default_factory=list)
    size_m: list[float] = field(default_factory=list)
    score: float = 0.0  # Ψ, eq. 7
    class_score: float = 0.0
    uncertainty: float = 0.0
    views: int = 0
    gaussians: int = 0
    detection_rate: float = 0.0  # share of its views in which it was detected as its class
    # Log-likelihood ratio of its class by image-text scores; None: the scorer rates no such class.
    image_text_nats: float | None = None
    probabilities: dict[str, float] = field(default_factory=dict)
    relocalisation: str | None = None  # "relocalised": of a stored map, found again

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        """Instance from JSON; the field `class` becomes `class_name`."""
        named = super().from_json(raw | {"class_name": raw.get("class", "")})
        return replace(named, raw=raw)


@dataclass(frozen=True)
class StoredObject(_FromJson):
    """Object of a stored map that is not in use; lengths in metres, world frame, z up."""

    class_name: str = ""
    relocalisation: str = ""  # tentative or unknown; the robot drives to neither
    center_m: list[float | None] = field(default_factory=list)  # None while unknown
    size_m: list[float] = field(default_factory=list)
    score: float = 0.0  # Ψ when the map was saved
    views: int = 0

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        """Object from JSON; the field `class` becomes `class_name`."""
        named = super().from_json(raw | {"class_name": raw.get("class", "")})
        return replace(named, raw=raw)


@dataclass(frozen=True)
class SeenView(_FromJson):
    """Past view that matches a prompt."""

    score: float = 0.0  # score for the prompt, 0 to 1
    class_name: str = ""  # detected class that matches; empty: the scorer's model rated it
    # x, y of the detection, else most likely position of the object in the view
    center_m: list[float] = field(default_factory=list)
    camera: Pose | None = None  # position and viewing direction
    stamp_s: float = 0.0  # on the robot's clock
    jpeg: bytes = field(default=b"", repr=False)  # small image

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        """Instance from JSON; the field `class` becomes `class_name`."""
        jpeg = base64.b64decode(raw.get("jpeg_base64", ""))
        named = super().from_json(raw | {"class_name": raw.get("class", "")})
        return replace(named, jpeg=jpeg, raw=raw)


@dataclass(frozen=True)
class Seen(_FromJson):
    """Places where something was seen."""

    REQUIRED = ("objects", "views")

    prompt: str = ""
    objects: tuple[FoundObject, ...] = ()  # of a class that the prompt names, highest score first
    stored: tuple[StoredObject, ...] = ()  # of a stored map that is not in use
    views: tuple[SeenView, ...] = ()  # past views that match the prompt, best first
    views_asked: int = 0  # number of stored views that were searched
    views_note: str = ""  # why past views were not searched, or only by class names

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        return replace(
            super().from_json(raw),
            objects=tuple(FoundObject.from_json(o) for o in raw.get("objects", ())),
            stored=tuple(StoredObject.from_json(o) for o in raw.get("stored", ())),
            views=tuple(SeenView.from_json(v) for v in raw.get("views", ())),
        )


@dataclass(frozen=True)
class Event:
    """One server-sent event."""

    type: str
    data: dict[str, Any]
    id: str = ""

    @property
    def ends_task(self) -> bool:
        """True if the event reports the end of a task."""
        return self.type == "task" and self.data.get("state") in ENDED


class GoalPoint(TypedDict):
    """Goal point of a task, in the world frame."""

    x_m: float
    y_m: float
    yaw_rad: float | None  # None: any heading


class ServiceAnswer(TypedDict):
    """Health of one service."""

    name: str
    state: str  # starting, waiting, ready, degraded, stopping, down
    reason: str
    restarts: int
    pid: int | None


class Status(TypedDict):
    """Health of all services, and readiness for a new task."""

    ready: bool
    stopped: bool | None  # True until clear-stop; None: unknown, as the gateway is down
    stop_reason: str  # reason given with the stop; empty while not stopped
    services: list[ServiceAnswer]


class DriveAnswer(TypedDict):
    """Result of one short move, as the robot measured it."""

    succeeded: bool
    reason: str  # reason for a failure, in one sentence
    moved_m: float | None
    turned_rad: float | None
    collided: bool
    pose: dict[str, float] | None  # x_m, y_m, yaw_rad


class RobotCheck(TypedDict):
    """Result of one check of the robot's set-up."""

    name: str
    verdict: str  # ok, wrong, not measured
    value: float | None  # in `unit`; None: not measured
    error: float | None  # standard error of the value
    limit: float  # largest size of the value that is right
    unit: str
    words: str  # one sentence: what is wrong and by how much, or why nothing was measured


class RobotChecks(TypedDict):
    """Results of all checks of the robot's set-up so far."""

    checks: list[RobotCheck]
    images: int  # images at rest behind the results
    free_ahead_m: float  # free distance in front of the robot in the newest of them


class Vocabulary(TypedDict):
    """Names that a task may use."""

    open: bool  # True: any name; False: only those in `names`
    names: list[str]
    detector: str
    scorer: str


class SeenName(TypedDict):
    """Class name with at least one instance in the object map."""

    name: str
    score: float  # highest Ψ among its instances, eq. 7
    objects: int  # number of its instances


class Suggestions(TypedDict):
    """Names seen in this home, and tasks to try."""

    tasks: list[str]  # instructions that this robot can do
    seen: list[SeenName] | None  # highest score first; None: the object map does not answer


class Pose(TypedDict):
    """Pose on the floor, in the world frame."""

    x_m: float
    y_m: float
    yaw_rad: float


class RobotState(TypedDict):
    """Current state of the robot."""

    pose: Pose | None
    held: str  # class of the held object; empty: none
    moving: bool
    stopped: bool  # True until clear-stop
    message: str


class RobotAnswer(TypedDict):
    """Connection, state and description of the robot; `state` is None before its first message."""

    connected: bool
    state: RobotState | None
    description: dict[str, Any] | None


class FleetRobot(TypedDict):
    """One robot of the fleet."""

    name: str
    state: str  # idle, busy, not ready, stopped, away
    reasons: list[str]  # why a task would not start now
    task: dict[str, Any] | None  # the task that it does
    pose: Pose | None
    battery: float | None  # charge, 0 to 1; None: unknown
    held: str
    picture: str | None  # address of its newest camera image


class Fleet(TypedDict):
    """All robots of a gateway, and the open tasks of the fleet in their order."""

    robots: list[FleetRobot]
    tasks: list[dict[str, Any]]


class Frontier(TypedDict):
    """Frontier between floor explored in this search and unexplored floor."""

    id: int
    center_m: list[float]
    size_m: float
    reachable: bool
    values: dict[str, float]  # value near the frontier, by value layer


class LoadedMaps(TypedDict):
    """Contents of a loaded map file."""

    known_m2: float
    occupied_m2: float
    views: int
    objects: int
    gaussians: int
    stored: bool  # of another world: not in use until the robot has found its place in it


class ResetMaps(TypedDict):
    """Maps that were reset: `objects`, `occupancy`."""

    reset: list[str]


class MapLayer(TypedDict):
    """Value layer and its largest value."""

    name: str
    max_value: float


class MapInfo(TypedDict):
    """2D map without its arrays."""

    version: int
    map_id: str  # changes when a new map begins (new world, reset, load) or map2d restarts
    cell_m: float
    origin_m: list[float]  # corner of the lower left cell
    width_cells: int
    height_cells: int
    explored_m2: float
    layers: list[MapLayer]
    robot: Pose | None
    trajectory_m: list[list[float]]
