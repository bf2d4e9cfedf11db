"""Table of the agents. Task flow, motion, pick and place are the same for all.

| agent               | belief               | object: next place          | goal: next frontier |
|---------------------|----------------------|-----------------------------|---------------------|
| helios              | object map, by score | objective (eq. 8-10)        | highest value       |
| helios-paper        | object map, by score | objective (eq. 8-10)        | highest value       |
| helios-5050         | object map, by score | objective, other share 0.5  | highest value       |
| no-global-objective | object map, by score | receptacles, then frontiers | highest value       |
| nearest-frontier    | object map, by score | receptacles, then nearest   | nearest             |
| trusting            | every detection      | highest value               | highest value       |
| random-frontier     | every detection      | random                      | random              |
| homerobot-heuristic | every detection      | start receptacles, nearest  | nearest             |
| vlfm                | detections seen well | highest value, kept         | highest value, kept |
| vlfm-unfiltered     | also at image sides  | highest value, kept         | highest value, kept |
| vlfm-helios-stop    | object map, by score | highest value, kept         | highest value       |

`helios-paper` is the paper's method. `helios` waits before it acts on a doubtful candidate
(`acceptance.py`) and has its own settings (`helios_core.agent_presets`). `homerobot-heuristic`
takes an object only on a start receptacle (`search/heuristic_search.py`). The last three are for
object navigation (Table 2); they can do every task.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from typing import Any

from helios_core import plugins
from helios_core.agent_presets import AGENT_NAMES
from helios_core.errors import InvalidInput
from helios_core.log_location import log_place

from helios_planner.agent import Agent, trusting
from helios_planner.decisions import global_search
from helios_planner.decisions.acceptance import Rule, paper, patient
from helios_planner.decisions.global_search import FrontierRule, SearchRule
from helios_planner.search.baselines import StopSearch, UnfilteredBelief, VlfmBelief
from helios_planner.search.candidate_beliefs import MapBelief, TrustingBelief
from helios_planner.search.frontier_exploration import RuleExplorer, TargetPursuit
from helios_planner.search.heuristic_search import HeuristicSearch
from helios_planner.search.object_search import ObjectSearch
from helios_planner.search.scored_search import ReceptacleSearch
from helios_planner.task import Phase

_loaded: dict[str, Agent] = {}  # agents of other packages; each is imported once per process


def _scoring(
    rule: SearchRule,
    thresholds: Rule = paper,
    frontiers: FrontierRule = global_search.highest_value,
) -> Agent:
    return Agent(
        MapBelief,
        lambda tools, name, start: ObjectSearch(tools, name, start, rule, thresholds),
        lambda tools, name, not_at: ReceptacleSearch(tools, name, not_at, thresholds, frontiers),
        retries=True,
    )


def _by(rule: FrontierRule) -> Agent:
    return trusting(TrustingBelief, partial(RuleExplorer, rule=rule))


_PAPER = _scoring(global_search.by_objective)

AGENTS: dict[str, Agent] = {
    "helios": _scoring(global_search.by_objective, patient),
    "helios-paper": _PAPER,
    "helios-5050": replace(_PAPER, other_share=0.5),
    "no-global-objective": _scoring(global_search.receptacles_first),
    "nearest-frontier": _scoring(global_search.by_distance, frontiers=global_search.nearest),
    "trusting": _by(global_search.highest_value),
    "random-frontier": _by(global_search.drawn),
    "homerobot-heuristic": Agent(
        TrustingBelief,
        lambda tools, name, start: HeuristicSearch(tools, Phase.FIND_OBJECT, name, start),
        lambda tools, name, not_at: HeuristicSearch(
            tools, Phase.FIND_RECEPTACLE, name, not_at=not_at
        ),
        retries=False,
    ),
    "vlfm": trusting(VlfmBelief, TargetPursuit),
    "vlfm-unfiltered": trusting(UnfilteredBelief, TargetPursuit),
    "vlfm-helios-stop": replace(_PAPER, seek_object=lambda tools, name, _: StopSearch(tools, name)),
}


def agent_named(name: str) -> Agent:
    """Agent of the table, of an entry point, or of a custom `package:agent`.

    Raises InvalidInput for an unknown agent or one that cannot be loaded.
    """
    if name in AGENTS:
        return AGENTS[name]
    if name not in _loaded:
        _loaded[name] = _of_package(name)
    return _loaded[name]


def fault_of(name: str, error: BaseException) -> str:
    """Message of a task that an unexpected exception ended. name: the task's agent."""
    if name in AGENTS:
        return (
            f"a fault in the planner ({type(error).__name__}: {str(error)[:200]}); the traceback "
            f"is in {log_place()}"
        )
    return (
        f"the agent {name} failed ({type(error).__name__}: {error}); the traceback is in "
        f"{log_place()}"
    )


def _of_package(name: str) -> Agent:
    named = plugins.find(plugins.AGENTS, name)
    known = ", ".join((*AGENT_NAMES, *plugins.AGENTS.entry_names()))
    if named is None:
        raise InvalidInput(
            f"there is no agent {name!r}; choose one of {known}, or package:agent of your own"
        )
    if named.argument:
        raise InvalidInput(f"agent {name!r}: an agent takes no argument; leave it out")
    if named.module.partition(".")[0] in sys.stdlib_module_names:
        raise InvalidInput(f"agent {name!r} is of Python's own library; choose one of {known}")
    given: Any = plugins.load(plugins.AGENTS, named)
    if not isinstance(given, Agent):  # never call it: a task may name any attribute
        raise InvalidInput(
            f"agent {name!r} is {plugins.described(given)}; wanted a helios_planner.plugins.Agent, "
            f"such as agent = exploring_by(my_rule), and its name: {named.module}:agent"
        )
    return given
