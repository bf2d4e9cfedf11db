"""Names of the agents, and the service settings that each agent needs.

An agent decides in the planner, but depends on the content of the maps. The defaults of the
settings are Table 3 of the paper and our rules where an agent of your own needs some. The agents of
the paper turn these rules off (`PRINTED_RULES`). `helios` has its own settings, which go beyond the
paper: it uses weak detections, weighs evidence by viewing sectors and with past views, and compares
objects with the usual size of their class, with look-alikes and with image-text scores.
docs/reference/agents.md lists all values.
"""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator

from helios_core.plugins import AGENTS, find

AgentName = Literal[
    "helios",
    "helios-paper",
    "helios-5050",
    "no-global-objective",
    "nearest-frontier",
    "trusting",
    "random-frontier",
    "homerobot-heuristic",
    "vlfm",
    "vlfm-unfiltered",
    "vlfm-helios-stop",
]
AGENT_NAMES: tuple[str, ...] = get_args(AgentName)  # built-in agents of the planner
DEFAULT_AGENT: AgentName = "helios"


def _agent(name: str) -> str:
    """The name itself, if a built-in agent or plug-in has it; nothing is loaded yet.

    Raises ValueError.
    """
    if name in AGENT_NAMES or find(AGENTS, name) is not None:
        return name
    known = (*AGENT_NAMES, *AGENTS.entry_names())
    near = "".join(f" (did you mean {n}?)" for n in get_close_matches(name, known, 1))
    raise ValueError(
        f"there is no such agent{near}; choose one of {', '.join(known)}, or package:agent"
    )


AgentSetting = Annotated[str, AfterValidator(_agent)]  # built-in, entry point or package:agent

Value = bool | int | float | str

_HELIOS: dict[str, Value] = {
    "planner.od_a": 0.2,
    "planner.od_g": 0.2,
    "planner.od_b": 0.2,
    "planner.cs_a": 0.2,
    "planner.cs_g": 0.15,
    "planner.cs_b": 0.2,
    "planner.tau_g": 0.2,
    "planner.tau_b": 0.35,
    "planner.ask_also": "household",
    "planner.hand_sides": 6,
    "planner.unnamed_picks": 8,
    "planner.absent_from": 0.5,
    "objectmap.evidence": "hindsight",
    "objectmap.named_from": 0.15,
    "objectmap.core_from": 0.3,
    "objectmap.joined_by": "detections",
    "objectmap.look_alikes": "sized",
    "objectmap.image_text": "compared",
    "objectmap.furniture_above_m": 0.05,
    "objectmap.equal_masks": "by-score",
    "objectmap.receptacle_voxel_m": 0.2,
    "objectmap.size_agreement": "large",
}

# Rules as the paper prints them. Where a rule is ours alone, the value turns it off.
PRINTED_RULES: dict[str, Value] = {
    "planner.start_receptacle_first": False,
    "planner.confirm_from_near": False,
    "planner.pick_at_last": 1.0,
    "planner.place_at_last": 1.0,
    "planner.rounds": 1,
    "planner.rounds_held": 1,
    "planner.place_rule": "paper",
    "planner.gaze_aim": "top",
    "planner.view_contours": "paper",
    "planner.pooled_looks": False,
    "planner.most_gaze_points": 256,
    "planner.gain_norm": "sum",
    "planner.goal_seen_before_pick": False,
    "objectmap.expected_label": "rendered",
    "objectmap.object_voxel_m": 0.5,
    "objectmap.carving": False,
    "objectmap.view_weights": "full",
}

# HomeRobot's heuristic agent remembers receptacles, places on flat areas, and searches once.
_HOMEROBOT: dict[str, Value] = {"planner.rounds": 1, "planner.rounds_held": 1}

AGENT_SETTINGS: Mapping[str, Mapping[str, Value]] = {
    "helios": _HELIOS,
    "helios-paper": PRINTED_RULES,
    "helios-5050": PRINTED_RULES,
    "no-global-objective": PRINTED_RULES,
    "nearest-frontier": PRINTED_RULES,
    "trusting": PRINTED_RULES,
    "random-frontier": PRINTED_RULES,
    "homerobot-heuristic": _HOMEROBOT,
    "vlfm": PRINTED_RULES,
    "vlfm-unfiltered": PRINTED_RULES,
    "vlfm-helios-stop": PRINTED_RULES,
}


def settings_for(agent: str) -> Mapping[str, Value]:
    """Settings of all services by "service.setting"; empty for an agent that uses the defaults."""
    return AGENT_SETTINGS.get(agent, {})


def service_settings(service: str, agent: str) -> dict[str, Value]:
    """Settings of one service for an agent, by name."""
    own = f"{service}."
    return {
        name.removeprefix(own): value
        for name, value in settings_for(agent).items()
        if name.startswith(own)
    }


def same_settings(one: str, other: str) -> bool:
    """True if two agents need the same settings, so that the same services can serve both."""
    return settings_for(one) == settings_for(other)
