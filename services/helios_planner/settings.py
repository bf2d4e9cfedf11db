"""Settings of the planner: the paper's Table 3 and the rules of moving."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from helios_core.agent_presets import DEFAULT_AGENT, AgentSetting
from helios_core.errors import InvalidInput
from helios_core.printable_text import plain_error
from helios_core.settings import ServiceSettings, service_config
from pydantic import AfterValidator, Field, SecretStr, ValidationError


def _with_class(prompt: str) -> str:
    """The prompt itself. Raises ValueError unless it has a place for the class."""
    try:
        has_place = prompt.format("mug") != prompt.format("cup")
    except (LookupError, ValueError, AttributeError):
        has_place = False
    if not has_place:
        raise ValueError(
            f"the prompt is {prompt[:80]!r}; wanted a text with {{}} where the class stands and no "
            "other braces, such as 'a {} ahead'"
        )
    return prompt


def _clearances(margins_m: tuple[float, ...]) -> tuple[float, ...]:
    """The margins themselves. Raises ValueError for none, or for one that is no distance."""
    if not margins_m or min(margins_m) < 0:
        raise ValueError(
            f"the margins are {list(margins_m)} m; wanted at least one, each 0 m or more, such as "
            "[0.08, 0.05, 0.025]"
        )
    return margins_m


def _for_header(key: SecretStr) -> SecretStr:
    """The key itself. Raises ValueError, without the key, unless an HTTP header can hold it."""
    text = key.get_secret_value()
    if not (text.isascii() and text.isprintable()):
        raise ValueError(
            "the key has characters that no HTTP header holds; wanted printable ASCII characters "
            "alone: copy it again"
        )
    return key


PlaceRule = Literal["flat", "paper"]
GainNorm = Literal["per_gaussian", "per_area", "per_pixel", "sum"]
Prompt = Annotated[str, AfterValidator(_with_class)]
HeaderKey = Annotated[SecretStr, AfterValidator(_for_header)]
Margins = Annotated[tuple[float, ...], AfterValidator(_clearances)]
LEAST_TAU = -0.5  # every score is higher: S is at least 0, and U is below 0.5
# Settings that a task may set for itself: those of its decisions and of its limits. It may not set
# how the robot moves, or how long the planner waits for other services.
OWN = (
    "alpha_d", "tau_g", "tau_b", "tau_inc", "cs_a", "cs_g", "cs_b", "od_a", "od_g", "od_b",
    "gain_norm", "max_picks", "picks_per_object", "falls", "places_per_receptacle", "extra_views",
    "hand_sides", "hand_from", "unnamed_picks", "absent_from", "rounds", "rounds_held",
    "pick_at_last", "place_at_last", "agent_seed", "place_rule", "vlfm_confidence",
    "start_receptacle_first", "confirm_from_near", "gaze_aim", "view_contours",
    "pooled_looks", "most_gaze_points", "goal_seen_before_pick", "ask_also",
)  # fmt: skip
MOST = 1e9  # beyond all sense for any of them


class Settings(ServiceSettings):
    """Flags of `python -m helios_planner`."""

    model_config = service_config("planner")

    state_dir: Path = Field(
        default=Path("runs/state/planner"), description="folder of the task database (SQLite)"
    )
    time_limit_s: float = Field(
        default=0.0,
        ge=0,
        description="longest duration of a task that sets none itself; 0: no limit",
    )
    resume_within_s: float = Field(
        default=120.0,
        ge=0,
        description="after a crash the planner resumes a task if it was down no longer than this, "
        "s; later the home may have changed",
    )
    keep_within_s: float = Field(
        default=60.0,
        ge=0,
        description="a task waits this long while its state cannot be saved, for example on a "
        "full disk; then it fails",
    )
    keep_tasks: int = Field(
        default=500, ge=1, description="number of ended tasks to keep; the oldest is deleted first"
    )
    max_waiting: int = Field(
        default=100, ge=1, description="most tasks that wait; a further one is refused"
    )
    max_steps: int = Field(
        default=1250,
        ge=1,
        description="most actions of a task that sets no limit itself; the paper names no number",
    )

    agent: AgentSetting = Field(
        default=DEFAULT_AGENT,
        description="agent that decides unless a task names one: see docs/explanation/planner.md, "
        "or package:agent of your own",
    )
    agents_of_tasks: Literal["any", "listed"] = Field(
        default="listed",
        description="agents that a task may name: listed (ours, entry points of installed "
        "packages, and the one above) or any (also package:agent, which the planner then "
        "imports and runs)",
    )
    agent_seed: int = Field(default=0, ge=0, description="seed of an agent that chooses at random")

    llm_url: str = Field(
        default="",
        pattern="^(https?://.+)?$",
        description="OpenAI-compatible endpoint, up to and with /v1, that helps with instructions "
        "which the grammar does not recognise; empty: none",
    )
    llm_model: str = Field(default="default", description="name of the model at that endpoint")
    llm_key: HeaderKey = Field(
        default=SecretStr(""),
        description="API key of that endpoint; set it as a variable, not as a flag",
    )
    llm_timeout_s: float = Field(
        default=3.0,
        gt=0,
        le=30,
        description="longest wait for the model when a task is submitted",
    )

    # --- Table 3 of the paper; agents may have other values (helios_core.agent_presets) ---
    alpha_d: float = Field(
        default=0.001, ge=0, description="cost of a metre in the objective (α_d, eq. 8, 10)"
    )
    tau_g: float = Field(
        default=0.5,
        ge=LEAST_TAU,
        description="score from which the planner picks an object (τ_g)",
    )
    tau_b: float = Field(
        default=0.5,
        ge=LEAST_TAU,
        description="score from which the planner places on a receptacle (τ_b)",
    )
    tau_inc: float = Field(
        default=0.05, ge=0, description="least gain in score that is worth an extra view (τ_inc)"
    )
    cs_a: float = Field(
        default=0.3,
        ge=0,
        le=1,
        description="class score from which an instance is a candidate start receptacle (cs_a)",
    )
    cs_g: float = Field(
        default=0.3,
        ge=0,
        le=1,
        description="class score from which an instance is a candidate object (cs_g)",
    )
    cs_b: float = Field(
        default=0.3,
        ge=0,
        le=1,
        description="class score from which an instance is a candidate goal receptacle (cs_b)",
    )
    od_a: float = Field(
        default=0.35, ge=0, le=1, description="detector threshold of start receptacles (od_a)"
    )
    od_g: float = Field(
        default=0.25, ge=0, le=1, description="detector threshold of objects (od_g)"
    )
    od_b: float = Field(
        default=0.45, ge=0, le=1, description="detector threshold of goal receptacles (od_b)"
    )
    ask_also: Literal["nothing", "household"] = Field(
        default="nothing",
        description="names that the detector is asked for beside the task's classes: nothing, or "
        "household (look-alikes then get their own names too)",
    )
    vlfm_confidence: float = Field(
        default=0.4, ge=0, le=1, description="detector threshold of the agent vlfm"
    )
    gain_norm: GainNorm = Field(
        default="per_gaussian",
        description="information gain in the objective: divided by the number of Gaussians, by the "
        "surface seen so far (m²), or by the number of pixels that show the candidate in the "
        "expected views; sum: not divided, as in the paper",
    )
    prompt: Prompt = Field(
        default="Seems like there is a {} ahead",
        description="text prompt of the value layers; {} stands for the class",
    )

    # --- limits ---
    max_picks: int = Field(default=0, ge=0, description="most picks per task; 0: no limit")
    picks_per_object: int = Field(default=3, ge=1, description="most picks of one object")
    falls: int = Field(
        default=2,
        ge=0,
        description="how often the robot searches for an object that it dropped and picks it again",
    )
    places_per_receptacle: int = Field(
        default=3, ge=1, description="most attempts to place on one receptacle"
    )
    extra_views: int = Field(
        default=8,
        ge=1,
        description="most extra views of one candidate before the planner rejects it",
    )
    hand_sides: int = Field(
        default=0,
        ge=0,
        le=12,
        description="sides from which the robot looks at a picked object before it carries it "
        "away, if it can show it to its camera; 0: none",
    )
    unnamed_picks: int = Field(
        default=0,
        ge=0,
        description="most things on a believed start receptacle that are picked and looked at, "
        "although no detection gave them the object's name; 0: none",
    )
    hand_from: float = Field(
        default=0.5,
        ge=0,
        le=1,
        description="probability below which it then puts the object back and searches on",
    )
    absent_from: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="probability from which the planner reports the object as not there instead of "
        "picking the most likely candidate; 1: never",
    )
    rounds: int = Field(
        default=2,
        ge=1,
        description="how often the robot searches the whole home before it gives up",
    )
    rounds_held: int = Field(
        default=6,
        ge=1,
        description="how often it searches for the goal receptacle while it holds the object",
    )

    # --- rules that the paper does not have; docs/explanation/planner.md lists them by agent ---
    start_receptacle_first: bool = Field(
        default=True,
        description="pick an object elsewhere than on a named start receptacle only when nothing "
        "is left to search; false: wherever its score suffices, as in the paper",
    )
    confirm_from_near: bool = Field(
        default=True,
        description="in front of a candidate, act only if its score is still τ − τ_inc; false: "
        "act without a second check, as in the paper",
    )
    gaze_aim: Literal["between", "top"] = Field(
        default="between",
        description="aim of the head at gaze points: between the candidate's top and centre, or "
        "its top, as in the paper",
    )
    view_contours: Literal["wide", "paper"] = Field(
        default="wide",
        description="contours of extra views: 0.6 to 1.8 m around the object (wide), or those of "
        "the local search, 0.6 and 0.9 m (paper)",
    )
    pooled_looks: bool = Field(
        default=True,
        description="a look at a thing uses up the gaze points of all things within 0.5 m of it; "
        "false: of those of its class alone, as in the paper",
    )
    most_gaze_points: int = Field(
        default=10,
        ge=1,
        le=256,
        description="gaze points of one candidate, the nearest ones, that eq. 11 and 12 consider; "
        "256, more than there are: all, as in the paper",
    )

    goal_seen_before_pick: bool = Field(
        default=True,
        description="of `trusting` and its kin: a goal receptacle detected before the pick counts; "
        "false: only one detected after it, as in the paper",
    )

    # --- moving ---
    margins_m: Margins = Field(
        default=(0.08, 0.05, 0.025),
        description="clearance between footprint and obstacles: tried in this order",
    )
    blind_m: float = Field(
        default=1.5,
        ge=0,
        description="longest drive over floor beyond the image's lower edge that the camera "
        "cannot see; 0: never",
    )
    travel_tilt_rad: float = Field(
        default=0.5236, ge=-1.5708, le=1.5708, description="downward tilt of the head while driving"
    )

    # --- in the end ---
    pick_at_last: float = Field(
        default=0.67,
        gt=0,
        le=1,
        description="share of the step budget after which the robot picks the most likely object "
        "below the threshold; 1: never, as in the paper",
    )
    place_at_last: float = Field(
        default=0.88,
        gt=0,
        le=1,
        description="share of the step budget after which it places on the most likely receptacle "
        "below the threshold; 1: never, as in the paper",
    )

    # --- pick and place ---
    place_rule: PlaceRule = Field(
        default="flat",
        description="flat: lower the object onto a free flat area; paper: drop it above the "
        "highest point ahead",
    )

    # --- waiting for others ---
    ack_timeout_s: float = Field(
        default=20.0,
        gt=0,
        description="longest wait for a map to integrate the keyframe of an action",
    )
    action_timeout_s: float = Field(
        default=60.0, gt=0, description="longest duration of one action"
    )
    call_timeout_s: float = Field(
        default=5.0, gt=0, description="longest wait for one response of another service"
    )
    away_s: float = Field(
        default=15.0,
        gt=0,
        description="how long another service may be down before the task fails",
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
        raise InvalidInput(
            f"{name} is {own.get(name)!r:.80}: {plain_error(first['msg'])}"
        ) from error
    for name, text in own.items():
        value = getattr(made, name)
        if isinstance(value, int | float) and abs(value) > MOST:
            raise InvalidInput(f"{name} is {text!r:.80}; wanted a number of at most {MOST:.0f}")
    return made
