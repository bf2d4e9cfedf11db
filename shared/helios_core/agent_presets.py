"""Names of the agents, and the service settings that each agent needs.

An agent decides in the planner, but depends on the content of the maps. `helios` has its own
settings, which go beyond the paper (docs/results has the figures): it uses weak detections, weighs
evidence by viewing sectors and with past views, and compares objects with the usual size of their
class. Every other agent runs with the defaults, which are the paper's values.
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
    "planner.tau_g": 0.15,
    "planner.tau_b": 0.28,
    "objectmap.evidence": "hindsight",
    "objectmap.named_from": 0.15,
    "objectmap.receptacle_voxel_m": 0.2,
    "objectmap.size_agreement": "large",
}

AGENT_SETTINGS: Mapping[str, Mapping[str, Value]] = {"helios": _HELIOS}


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
