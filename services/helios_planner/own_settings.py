"""Settings that one task has for itself."""

from __future__ import annotations

from collections.abc import Mapping

from helios_core.errors import InvalidInput
from pydantic import ValidationError

from helios_planner.settings import Settings

# How it decides and when it gives up; not how it moves, nor how long others are waited for.
OWN = (
    "alpha_d", "tau_g", "tau_b", "tau_inc", "cs_a", "cs_g", "cs_b", "od_a", "od_g", "od_b",
    "gain_norm", "max_picks", "picks_per_object", "falls", "places_per_receptacle", "extra_views",
    "rounds", "rounds_held", "pick_at_last", "place_at_last", "agent_seed", "place_rule",
    "vlfm_confidence",
)  # fmt: skip

MOST = 1e9  # beyond all sense for any of them


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
