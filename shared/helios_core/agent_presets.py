"""The agents by name, and settings of the services that an agent's house runs with, where they are
not the defaults.

An agent decides in the planner, but what it may rely on is made in the maps. `helios-next` has what
goes beyond the paper (what it is worth: docs/results): the detector's weak detections count too,
evidence is weighed by sides and with hindsight, and things are held against their usual size.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

AgentName = Literal[
    "helios",
    "helios-next",
    "helios-5050",
    "no-global-objective",
    "trusting",
    "random-frontier",
    "homerobot-heuristic",
    "vlfm",
    "vlfm-unfiltered",
    "vlfm-helios-stop",
]
AGENT_NAMES: tuple[str, ...] = get_args(AgentName)  # those of the planner itself

Value = bool | int | float | str

_NEXT: dict[str, Value] = {
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

AGENT_SETTINGS: Mapping[str, Mapping[str, Value]] = {"helios-next": _NEXT}


def settings_for(agent: str) -> Mapping[str, Value]:
    """By "service.setting"; none for an agent that runs with the defaults."""
    return AGENT_SETTINGS.get(agent, {})
