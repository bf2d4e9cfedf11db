"""The agents, side by side. Flow, motion, pick and place are the same for all.

| agent               | takes for true         | object: next place          | goal: next frontier |
|---------------------|------------------------|-----------------------------|---------------------|
| helios              | object map, by score   | objective (eq. 8-10)        | highest value       |
| helios-next         | the best it knows      | objective (eq. 8-10)        | highest value       |
| helios-5050         | object map, by score   | the same, half as hopeful   | highest value       |
| no-global-objective | object map, by score   | receptacles, then frontiers | highest value       |
| trusting            | whatever is detected   | highest value               | highest value       |
| random-frontier     | whatever is detected   | drawn                       | drawn               |
| homerobot-heuristic | whatever is detected   | nearest                     | nearest             |
| vlfm                | what was detected well | highest value, kept         | highest value, kept |
| vlfm-unfiltered     | and at an image's side | highest value, kept         | highest value, kept |
| vlfm-helios-stop    | object map, by score   | highest value, kept         | highest value       |

`helios-next` waits before it acts on what it is not sure of (`standards.py`), and its house runs
with the settings of `helios_core.agent_settings`. The last three are for object navigation (Table
2); they can do every task.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from helios_core.errors import InvalidInput

from helios_planner.decisions import frontier_rules, global_search
from helios_planner.decisions.frontier_rules import FrontierRule
from helios_planner.decisions.global_search import SearchRule
from helios_planner.decisions.standards import Rule, paper, patient
from helios_planner.searching.belief import Belief, MapBelief, TrustingBelief
from helios_planner.searching.explore import Kit, Search
from helios_planner.searching.explorers import ByRule, Explorer, Pursuit
from helios_planner.searching.object_search import ObjectSearch
from helios_planner.searching.receptacle_search import ReceptacleSearch
from helios_planner.searching.trusting_search import TrustingSearch
from helios_planner.searching.vlfm_belief import UnfilteredBelief, VlfmBelief
from helios_planner.searching.vlfm_search import StopSearch
from helios_planner.task import Phase


@dataclass(frozen=True)
class Agent:
    """How an agent differs from the others.

    seek_object: kit, class, start receptacle's class; seek_receptacle: kit, class, where the object
    was taken from if that must not be the goal. retries: whether a failed pick is tried again from
    elsewhere, or that place is left alone. other_share: of what a local search is expected to see,
    what speaks for something else (Table 5); 0 is optimistic.
    """

    belief: type[Belief]
    seek_object: Callable[[Kit, str, str | None], Search]
    seek_receptacle: Callable[[Kit, str, np.ndarray | None], Search]
    retries: bool
    other_share: float = 0.0


def _scoring(rule: SearchRule, standards: Rule = paper) -> Agent:
    return Agent(
        MapBelief,
        lambda kit, name, start: ObjectSearch(kit, name, start, rule, standards),
        lambda kit, name, not_at: ReceptacleSearch(kit, name, not_at, standards),
        retries=True,
    )


def _trusting(belief: type[Belief], explorer: Callable[[Search, str], Explorer]) -> Agent:
    return Agent(
        belief,
        lambda kit, name, _: TrustingSearch(kit, Phase.FIND_OBJECT, name, explorer),
        lambda kit, name, not_at: TrustingSearch(
            kit, Phase.FIND_RECEPTACLE, name, explorer, not_at
        ),
        retries=False,
    )


def _by(rule: FrontierRule) -> Agent:
    return _trusting(TrustingBelief, partial(ByRule, rule=rule))


_HELIOS = _scoring(global_search.by_objective)

AGENTS: dict[str, Agent] = {
    "helios": _HELIOS,
    "helios-next": _scoring(global_search.by_objective, patient),
    "helios-5050": replace(_HELIOS, other_share=0.5),
    "no-global-objective": _scoring(global_search.receptacles_first),
    "trusting": _by(frontier_rules.highest_value),
    "random-frontier": _by(frontier_rules.drawn),
    "homerobot-heuristic": _by(frontier_rules.nearest),
    "vlfm": _trusting(VlfmBelief, Pursuit),
    "vlfm-unfiltered": _trusting(UnfilteredBelief, Pursuit),
    "vlfm-helios-stop": replace(_HELIOS, seek_object=lambda kit, name, _: StopSearch(kit, name)),
}


def agent_named(name: str) -> Agent:
    """Raises InvalidInput for a name that there is not."""
    if name not in AGENTS:
        raise InvalidInput(f"there is no agent {name!r}; choose one of {', '.join(AGENTS)}")
    return AGENTS[name]
