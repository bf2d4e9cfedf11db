"""The agents, side by side. Flow, motion, pick and place are the same for all.

| agent               | takes for true       | object: next place          | goal: next frontier |
|---------------------|----------------------|-----------------------------|---------------------|
| helios              | object map, by score | objective (eq. 8-10)        | highest value       |
| no-global-objective | object map, by score | receptacles, then frontiers | highest value       |
| trusting            | whatever is detected | highest value               | highest value       |
| random-frontier     | whatever is detected | drawn                       | drawn               |
| homerobot-heuristic | whatever is detected | nearest                     | nearest             |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from helios_core.errors import InvalidInput

from helios_planner import frontier_rules, global_search
from helios_planner.belief import Belief, MapBelief, TrustingBelief
from helios_planner.explore import Kit, Search
from helios_planner.frontier_rules import FrontierRule
from helios_planner.global_search import SearchRule
from helios_planner.object_search import ObjectSearch
from helios_planner.receptacle_search import ReceptacleSearch
from helios_planner.task import Phase
from helios_planner.trusting_search import TrustingSearch


@dataclass(frozen=True)
class Agent:
    """How an agent differs from the others.

    seek_object: kit, class, start receptacle's class; seek_receptacle: kit, class, where the object
    was taken from if that must not be the goal. retries: whether a failed pick is tried again from
    elsewhere, or that place is left alone.
    """

    belief: type[Belief]
    seek_object: Callable[[Kit, str, str | None], Search]
    seek_receptacle: Callable[[Kit, str, np.ndarray | None], Search]
    retries: bool


def _scoring(rule: SearchRule) -> Agent:
    return Agent(
        MapBelief,
        lambda kit, name, start: ObjectSearch(kit, name, start, rule),
        ReceptacleSearch,
        retries=True,
    )


def _trusting(rule: FrontierRule) -> Agent:
    return Agent(
        TrustingBelief,
        lambda kit, name, _: TrustingSearch(kit, Phase.FIND_OBJECT, name, rule),
        lambda kit, name, not_at: TrustingSearch(kit, Phase.FIND_RECEPTACLE, name, rule, not_at),
        retries=False,
    )


AGENTS: dict[str, Agent] = {
    "helios": _scoring(global_search.by_objective),
    "no-global-objective": _scoring(global_search.receptacles_first),
    "trusting": _trusting(frontier_rules.highest_value),
    "random-frontier": _trusting(frontier_rules.drawn),
    "homerobot-heuristic": _trusting(frontier_rules.nearest),
}


def agent_named(name: str) -> Agent:
    """Raises InvalidInput for a name that there is not."""
    if name not in AGENTS:
        raise InvalidInput(f"there is no agent {name!r}; choose one of {', '.join(AGENTS)}")
    return AGENTS[name]
