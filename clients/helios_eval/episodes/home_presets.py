"""Homes by the name of their kind: a preset, or a preset with realistic furniture.

`ovmm-v1+sweethome3d` is preset `ovmm-v1` with the furniture that `helios assets bake` made. The
names differ, so that results of the two are never mixed. `flat.sh3d@1a2b3c4d5e6f` are the homes of
a plan file (`plan_homes.py`), which come as `plans` beside their name.
"""

from __future__ import annotations

from functools import cache, lru_cache

from helios_client.usage_errors import UsageError
from helios_core.errors import HeliosError
from helios_core.name_rules import same_name
from helios_sim.assets import FurnitureReplacement, realistic
from helios_sim.assets.asset_pack import NAME
from helios_sim.home import PRESETS, Home, HomePreset, generate_home
from helios_sim.home.presets import noise_table_of, pick_and_place_steps_of

from helios_eval.episodes.episode_record import Benchmark
from helios_eval.episodes.plan_homes import PlanHomes, is_plan_kind

LIKE_PLANS = "ovmm-v1"  # preset whose noise and number of actions the homes of plans have
_JOINT = "+"
_OBJECTNAV_STEPS = 500
KINDS = tuple(name + end for name in sorted(PRESETS) for end in ("", f"{_JOINT}{NAME}"))


@lru_cache(maxsize=2)
def home_of(kind: str, seed: int, plans: PlanHomes | None = None) -> Home:
    """Home of a seed. The last two are cached, since agents play in the same home in turn.

    plans: files of the kind, if they are plans. Raises HeliosError if there is no such home, or if
    no furniture is baked.
    """
    if plans is not None:
        return plans.home_of(seed)
    preset, furniture_models = _parts(kind)
    return generate_home(seed, preset, furniture_models)


def digest_of(kind: str, plans: PlanHomes | None = None) -> str:
    """Digest of everything that determines the homes of a kind. plans: as of `home_of`."""
    if plans is not None:
        return plans.digest
    preset, furniture_models = _parts(kind)
    return preset.digest() + (f"{_JOINT}{furniture_models.pack.digest}" if furniture_models else "")


def noise_of(kind: str) -> str:
    """Name of the noise table of a kind of homes."""
    return noise_table_of(LIKE_PLANS if is_plan_kind(kind) else layout_of(kind))


def default_steps(kind: str, benchmark: Benchmark) -> int:
    """Number of actions that an episode in a kind of homes may take, unless a run sets another."""
    if benchmark == "objectnav":
        return _OBJECTNAV_STEPS
    return pick_and_place_steps_of(LIKE_PLANS if is_plan_kind(kind) else layout_of(kind))


def check_kind(kind: str) -> str:
    """Canonical name of a kind of homes; letter case does not matter.

    Raises UsageError for an unknown kind, and for missing furniture.
    """
    known = same_name(kind, KINDS)
    if known is None:
        raise UsageError(f"no preset is called {kind!r}; wanted one of {', '.join(KINDS)}")
    try:
        _parts(known)
    except HeliosError as error:
        raise UsageError(error.message) from error
    return known


def layout_of(kind: str) -> str:
    """Kind of the same homes without realistic furniture."""
    return kind.partition(_JOINT)[0]


@cache
def _parts(kind: str) -> tuple[HomePreset, FurnitureReplacement | None]:
    name, joint, _ = kind.partition(_JOINT)
    return PRESETS[name], realistic() if joint else None
