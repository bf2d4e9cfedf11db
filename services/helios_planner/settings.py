"""Settings of the planner: the paper's Table 3 and the rules of moving."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from helios_core.agent_presets import DEFAULT_AGENT, AgentSetting
from helios_core.errors import InvalidInput
from helios_core.settings import ServiceSettings, service_config
from pydantic import Field, SecretStr, ValidationError

PlaceRule = Literal["flat", "paper"]
# How it decides and when it gives up; not how it moves, nor how long others are waited for.
OWN = (
    "alpha_d", "tau_g", "tau_b", "tau_inc", "cs_a", "cs_g", "cs_b", "od_a", "od_g", "od_b",
    "gain_norm", "max_picks", "picks_per_object", "falls", "places_per_receptacle", "extra_views",
    "rounds", "rounds_held", "pick_at_last", "place_at_last", "agent_seed", "place_rule",
    "vlfm_confidence",
)  # fmt: skip
MOST = 1e9  # beyond all sense for any of them


class Settings(ServiceSettings):
    """Flags of `python -m helios_planner`."""

    model_config = service_config("planner")

    state_dir: Path = Field(
        default=Path("runs/state/planner"), description="where tasks are kept (SQLite)"
    )
    time_limit_s: float = Field(
        default=0.0, ge=0, description="time a task may take, unless it says so; 0: any"
    )
    resume_within_s: float = Field(
        default=120.0,
        ge=0,
        description="a task goes on by itself if the planner died no longer ago than this",
    )
    keep_within_s: float = Field(
        default=60.0,
        ge=0,
        description="a task stands and waits this long while what it does cannot be written down, "
        "on a full disk for example; then it fails",
    )
    keep_tasks: int = Field(
        default=500, ge=1, description="ended tasks that are remembered; then the oldest goes"
    )
    keep_decisions: int = Field(
        default=2000, ge=1, description="decisions remembered of one task; then the oldest goes"
    )
    max_steps: int = Field(
        default=1250, ge=1, description="actions a task may take, unless it says so"
    )

    agent: AgentSetting = Field(
        default=DEFAULT_AGENT,
        description="who decides, unless a task says so: one of docs/explanation/planner.md, "
        "or package:agent of your own",
    )
    agents_of_tasks: Literal["any", "listed"] = Field(
        default="listed",
        description="which agents a task may name: listed (ours, those of installed packages' "
        "entry points, and the one above), or any (the planner also imports and runs any "
        "package:agent of its module path or folder that a task names)",
    )
    agent_seed: int = Field(default=0, ge=0, description="seed of an agent that draws frontiers")

    llm_url: str = Field(
        default="",
        pattern="^(https?://.+)?$",
        description="an OpenAI-compatible endpoint, up to and with /v1, that helps with sentences "
        "which are not recognised; empty: none",
    )
    llm_model: str = Field(default="default", description="the model's name there")
    llm_key: SecretStr = Field(
        default=SecretStr(""), description="its key; better as a variable than as a flag"
    )
    llm_timeout_s: float = Field(
        default=3.0, gt=0, le=30, description="longest wait for its answer at submission"
    )

    # --- Table 3 of the paper; agents may have other values (helios_core.agent_presets) ---
    alpha_d: float = Field(
        default=0.001, ge=0, description="weight of a metre in the objective (eq. 8, 10)"
    )
    tau_g: float = Field(default=0.5, description="score from which an object is picked (τ_g)")
    tau_b: float = Field(
        default=0.5, description="score from which a receptacle is placed on (τ_b)"
    )
    tau_inc: float = Field(
        default=0.05, ge=0, description="least rise of a score worth a view (τ_inc)"
    )
    cs_a: float = Field(
        default=0.3, description="class score of a candidate start receptacle (cs_a)"
    )
    cs_g: float = Field(default=0.3, description="class score of a candidate object (cs_g)")
    cs_b: float = Field(
        default=0.3, description="class score of a candidate goal receptacle (cs_b)"
    )
    od_a: float = Field(
        default=0.35, ge=0, le=1, description="detector threshold, start receptacle (od_a)"
    )
    od_g: float = Field(default=0.25, ge=0, le=1, description="detector threshold, object (od_g)")
    od_b: float = Field(
        default=0.45, ge=0, le=1, description="detector threshold, goal receptacle (od_b)"
    )
    vlfm_confidence: float = Field(
        default=0.4, ge=0, le=1, description="least confidence of a detection that VLFM believes"
    )
    gain_norm: Literal["per_gaussian", "sum"] = Field(
        default="per_gaussian",
        description="information gain per Gaussian, or the paper's plain sum",
    )
    prompt: str = Field(
        default="Seems like there is a {} ahead",
        description="what a value layer is asked for; {} is named",
    )

    # --- limits ---
    max_picks: int = Field(
        default=0, ge=0, description="picks a task may try; 0: as many as it takes"
    )
    picks_per_object: int = Field(
        default=3, ge=1, description="picks at one object before it is left alone"
    )
    falls: int = Field(
        default=2, ge=0, description="times that what fell is searched and picked again"
    )
    places_per_receptacle: int = Field(default=3, ge=1, description="places at one receptacle")
    extra_views: int = Field(
        default=8, ge=1, description="extra views of one candidate before it is doubted"
    )
    rounds: int = Field(default=2, ge=1, description="times the home is searched before giving up")
    rounds_held: int = Field(
        default=6, ge=1, description="the same for where to put what the robot holds"
    )
    patrol_m: float = Field(
        default=2.5,
        gt=0,
        description="from the second time on: distance between places to look around from",
    )
    gaze_poses: int = Field(
        default=10, ge=1, description="gaze points asked about at most, per candidate"
    )

    # --- moving ---
    margins_m: tuple[float, ...] = Field(
        default=(0.08, 0.05, 0.025),
        description="clearance beyond the footprint: wished, then accepted",
    )
    saturation_m: float = Field(
        default=0.30, gt=0, description="clearance from which FM² is at full speed"
    )
    speck_m2: float = Field(
        default=0.015, ge=0, description="unknown specks below this area are floor"
    )
    blind_m: float = Field(
        default=1.5,
        ge=0,
        description="longest way over ground beyond the rim that the camera cannot see from where "
        "the robot stands; 0: none",
    )
    travel_tilt_rad: float = Field(
        default=0.5236, description="tilt of the head while driving, down"
    )
    frontier_reach_m: float = Field(
        default=1.2, gt=0, description="a frontier is reached from this near"
    )
    go_within_m: float = Field(
        default=0.25,
        ge=0,
        le=2,
        description="where the robot cannot stand on the point that it is sent to, a place this "
        "near to it will do",
    )
    border_m: float = Field(
        default=0.4,
        gt=0,
        description="an exploration leaves shorter edges of the known floor alone",
    )
    same_place_m: float = Field(
        default=0.5, gt=0, description="two things nearer than this are the same"
    )

    # --- looking ---
    gaze_distances_m: tuple[float, ...] = Field(
        default=(0.6, 0.9), description="contours around a receptacle on which gaze points lie"
    )
    gaze_spacing_m: float = Field(default=0.8, gt=0, description="distance between its gaze points")
    view_distances_m: tuple[float, ...] = Field(
        default=(0.6, 0.9, 1.3, 1.8),
        description="contours around an object on which extra views lie",
    )
    view_spacing_m: float = Field(default=0.5, gt=0, description="distance between extra views")
    stop_distances_m: tuple[float, ...] = Field(
        default=(0.5, 0.7, 0.85),
        description="contours around what was to be found on which the robot stops; object "
        "navigation counts up to 1.0 m",
    )
    block_height_m: float = Field(
        default=1.25, description="what is higher than this blocks any gaze"
    )

    # --- in the end ---
    pick_at_last: float = Field(
        default=0.67,
        gt=0,
        le=1,
        description="share of the steps after which the likeliest object is brought, sure or not, "
        "as when everything was searched; 1: never, as the paper",
    )
    place_at_last: float = Field(
        default=0.88,
        gt=0,
        le=1,
        description="share of the steps after which what is held is put on the likeliest "
        "receptacle, as when everything was searched; 1: never, as the paper",
    )

    # --- pick and place ---
    reach_spare_m: float = Field(default=0.06, ge=0, description="kept of the robot's reach")
    place_rule: PlaceRule = Field(
        default="flat",
        description="flat: lowered onto a flat free area; paper: dropped above the highest point "
        "ahead",
    )
    place_inset_m: float = Field(
        default=0.12, ge=0, description="least distance from a surface's edge"
    )
    place_flats_m: tuple[float, ...] = Field(
        default=(0.012, 0.045),
        description="height range of what counts as flat: wished, so that nothing lies there "
        "already, then accepted",
    )
    place_drop_m: float = Field(
        default=0.01, ge=0, description="height above the surface to let go from"
    )
    paper_drop_m: float = Field(
        default=0.10, ge=0, description="height above the highest point that rule paper drops from"
    )

    # --- waiting for others ---
    ack_timeout_s: float = Field(
        default=20.0, gt=0, description="longest wait for a map after an action"
    )
    action_timeout_s: float = Field(default=60.0, gt=0, description="longest an action may take")
    call_timeout_s: float = Field(default=5.0, gt=0, description="longest wait for one answer")
    away_s: float = Field(
        default=15.0, gt=0, description="how long a service may be away before failing"
    )


def for_task(settings: Settings, own: Mapping[str, str]) -> Settings:
    """The settings with a task's own, as typed: "alpha_d" -> "0.01". Raises InvalidInput."""
    if not own:
        return settings
    if unknown := sorted(set(own) - set(OWN)):
        raise InvalidInput(
            f"a task has no setting {unknown[0][:80]!r} of its own; choose among {', '.join(OWN)}"
        )
    try:
        made = type(settings).model_validate(settings.model_dump() | dict(own))
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0])
        raise InvalidInput(f"{name} is {own.get(name)!r:.80}: {first['msg']}") from error
    for name, text in own.items():
        value = getattr(made, name)
        if isinstance(value, int | float) and not abs(value) <= MOST:  # neither is "not a number"
            raise InvalidInput(f"{name} is {text!r:.80}; wanted a number of at most {MOST:.0f}")
    return made
