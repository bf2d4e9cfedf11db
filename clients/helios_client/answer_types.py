"""What the HTTP interface answers, typed. All of it is kept in `raw`; unknown fields only there."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self, TypedDict

from helios_core.task_states import ENDED


@dataclass(frozen=True)
class _FromJson:
    raw: dict[str, Any] = field(default_factory=dict, repr=False, kw_only=True)

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        """From one JSON object; what it lacks has its default."""
        known = {f.name for f in fields(cls)} - {"raw"}
        values = {k: v for k, v in raw.items() if k in known and v is not None}
        return cls(**values, raw=raw)


@dataclass(frozen=True)
class Task(_FromJson):
    """A task and how far it is. Times are seconds since 1970."""

    id: str = ""
    instruction: str = ""
    state: str = ""  # queued, running, paused, succeeded, failed, cancelled
    phase: str = ""  # find_object, pick, find_receptacle, place, go, explore
    message: str = ""  # what it does now, or why it ended
    cause: str = ""
    seeking: str = ""
    agent: str = ""  # helios, trusting …
    priority: int = 0  # of the queued ones a higher one is begun first
    settings: dict[str, str] = field(default_factory=dict)  # of the planner, for it alone
    kind: str = ""  # move, find, go_to, go_to_point, explore, go_home
    object: str = ""
    start: str = ""
    goal: str = ""
    steps: int = 0
    max_steps: int = 0
    time_limit_s: float | None = None  # from its start; None: none
    picks: int = 0
    progress: float = 0.0  # 0 to 1, a rough guide; never falls
    # It may end in so many seconds: at least, at most. None: nobody can say.
    eta_s: list[float] | None = None
    created_s: float = 0.0
    started_s: float = 0.0
    ended_s: float = 0.0
    on_hold: bool = False  # somebody paused it, and nobody has resumed it yet
    unused: list[str] = field(default_factory=list)  # of the instruction
    seen_at_goal: bool | None = None  # after it was placed; None: it was not, or nobody knows

    point: GoalPoint | None = None  # of kind go_to_point

    @property
    def ended(self) -> bool:
        return self.state in ENDED

    @property
    def succeeded(self) -> bool:
        return self.state == "succeeded"


@dataclass(frozen=True)
class Decision(_FromJson):
    """What was decided, by which rule and why."""

    task_id: str = ""
    index: int = 0
    phase: str = ""
    rule: str = ""
    do: str = ""  # act, look, search_on, search_receptacle, go_to_frontier, nothing_left
    why: str = ""
    candidates: list[dict[str, Any]] = field(default_factory=list)
    settings: dict[str, float] = field(default_factory=dict)
    made_s: float = 0.0
    recomputed: dict[str, Any] | None = None  # under other settings, where they were asked for


@dataclass(frozen=True)
class FoundObject(_FromJson):
    """One instance of the object map; lengths in metres, world z up."""

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
    probabilities: dict[str, float] = field(default_factory=dict)

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        """The wire says `class`, which is no name in Python."""
        named = super().from_json(raw | {"class_name": raw.get("class", "")})
        return replace(named, raw=raw)


@dataclass(frozen=True)
class SeenView(_FromJson):
    """A past view that fits what was asked for."""

    score: float = 0.0  # how well, 0 to 1
    class_name: str = ""  # what the detector named in it; empty: the scorer's model was asked
    center_m: list[float] = field(default_factory=list)  # x, y: of that, or of what it saw
    camera: Pose | None = None  # where it stood, and its direction
    stamp_s: float = 0.0  # the robot's clock
    jpeg: bytes = field(default=b"", repr=False)  # a small picture

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        """The wire says `class`, which is no name in Python."""
        jpeg = base64.b64decode(raw.get("jpeg_base64", ""))
        named = super().from_json(raw | {"class_name": raw.get("class", "")})
        return replace(named, jpeg=jpeg, raw=raw)


@dataclass(frozen=True)
class Seen(_FromJson):
    """Where something was seen."""

    prompt: str = ""
    objects: tuple[FoundObject, ...] = ()  # believed, of a class that the words name; surest first
    views: tuple[SeenView, ...] = ()  # past views that fit the words, best first
    views_asked: int = 0
    views_note: str = ""  # why past views were not asked, or by names alone

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        return replace(
            super().from_json(raw),
            objects=tuple(FoundObject.from_json(o) for o in raw.get("objects", ())),
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
        """It tells that a task has ended."""
        return self.type == "task" and self.data.get("state") in ENDED


class GoalPoint(TypedDict):
    """Where the robot was sent, in the world."""

    x_m: float
    y_m: float
    yaw_rad: float | None  # None: whichever way it comes


class ServiceAnswer(TypedDict):
    """How one service is."""

    name: str
    state: str  # starting, waiting, ready, degraded, stopping, down
    reason: str
    restarts: int
    pid: int | None


class Status(TypedDict):
    """How all services are, and whether a task submitted now would start."""

    ready: bool
    stopped: bool | None  # until clear-stop; None: only the gateway knows, and it is away
    stop_reason: str  # what was said then; empty while it is not stopped
    services: list[ServiceAnswer]


class DriveAnswer(TypedDict):
    """What came of one short move, as the robot measured it."""

    succeeded: bool
    reason: str  # one sentence when it failed
    moved_m: float | None
    turned_rad: float | None
    collided: bool
    pose: dict[str, float] | None  # x_m, y_m, yaw_rad


class Vocabulary(TypedDict):
    """What can be asked for."""

    open: bool  # any name; else those in `names` alone
    names: list[str]
    detector: str
    scorer: str


class SeenName(TypedDict):
    """A name of which something is believed to be in this home."""

    name: str
    score: float  # Ψ of the surest one, eq. 7
    objects: int  # how many


class Suggestions(TypedDict):
    """What to ask for in this home."""

    tasks: list[str]  # instructions that this robot can do
    seen: list[SeenName] | None  # the surest first; None: the object map does not answer


class Pose(TypedDict):
    """On the floor of the world."""

    x_m: float
    y_m: float
    yaw_rad: float


class RobotState(TypedDict):
    """How the robot is now."""

    pose: Pose | None
    held: str  # class of what is held; empty: nothing
    moving: bool
    stopped: bool  # until clear-stop
    message: str


class RobotAnswer(TypedDict):
    """The robot; `state` is None until it was heard."""

    connected: bool
    state: RobotState | None
    description: dict[str, Any] | None


class Frontier(TypedDict):
    """A border of what was seen since the search began."""

    id: int
    center_m: list[float]
    size_m: float
    reachable: bool
    values: dict[str, float]  # by value layer


class LoadedMaps(TypedDict):
    """What came out of a file of maps."""

    known_m2: float
    occupied_m2: float
    views: int
    objects: int
    gaussians: int


class ResetMaps(TypedDict):
    """Which maps were forgotten: `objects`, `occupancy`."""

    reset: list[str]


class MapLayer(TypedDict):
    """A value layer and its largest value."""

    name: str
    max_value: float


class MapInfo(TypedDict):
    """The 2D map without its arrays."""

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
