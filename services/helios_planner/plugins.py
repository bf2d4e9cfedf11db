"""Public interface for custom agents (docs/tutorials/your-own-agent.md).

The smallest agent is an exploration rule: a function from places to scores.

    from helios_planner.plugins import Places, exploring_by

    def nearest(places: Places):
        return -places.distance_m

    agent = exploring_by(nearest)

    helios up --agent my_package:agent
    helios task "find the mug"

A full agent defines its belief about objects and its searches for the object and the goal:
`Agent(belief, seek_object, seek_receptacle)`. A custom search derives from `Search` and implements
`decide` and `explore`.
"""

from __future__ import annotations

from collections.abc import Sequence

from helios_core.types import ObjectInstance

from helios_planner.agent import Agent, trusting
from helios_planner.decisions.acceptance import best_of, position_of
from helios_planner.decisions.decision import Candidate, Decision, Do
from helios_planner.decisions.plugin_rule import ExplorationRule, Places
from helios_planner.search.base import PICK_LAYER, PLACE_LAYER, Search, SearchTools
from helios_planner.search.candidate_beliefs import Belief, MapBelief, TrustingBelief
from helios_planner.search.frontier_exploration import Explorer
from helios_planner.search.plugin_search import (
    OwnObjectSearch,
    OwnReceptacleSearch,
    PluginRuleExplorer,
)
from helios_planner.task import Phase, TaskFailed

__all__ = [
    "Agent",
    "Belief",
    "Candidate",
    "Decision",
    "Do",
    "ExplorationRule",
    "Explorer",
    "MapBelief",
    "ObjectInstance",
    "Phase",
    "Places",
    "Search",
    "SearchTools",
    "TaskFailed",
    "TrustingBelief",
    "act_on_best",
    "explorer",
    "exploring_by",
]


def exploring_by(rule: ExplorationRule, *, trusts_detector: bool = False) -> Agent:
    """Agent that explores by a rule and is otherwise a built-in agent.

    By default it is `helios-paper`: it acts on the scores of the object map, and the rule chooses
    among candidate receptacles and frontiers while it searches for the object, among frontiers
    while it searches for the goal. With trusts_detector it is `trusting`: it acts on detections,
    and the rule chooses among frontiers.
    """
    if trusts_detector:
        return trusting(
            TrustingBelief, lambda search, layer: PluginRuleExplorer(search, layer, rule)
        )
    return Agent(
        MapBelief,
        lambda tools, name, start: OwnObjectSearch(tools, name, start, rule),
        lambda tools, name, not_at: OwnReceptacleSearch(tools, name, not_at, rule),
    )


def explorer(search: Search, rule: ExplorationRule) -> Explorer:
    """Explorer for a custom search. `step(found)` visits one frontier by the rule, until `found()`
    is true; it returns False when no frontier is left."""
    layer = PICK_LAYER if search.phase is Phase.FIND_OBJECT else PLACE_LAYER
    return PluginRuleExplorer(search, layer, rule)


def act_on_best(things: Sequence[ObjectInstance], scores: Sequence[float], why: str) -> Decision:
    """Decision for `Search.decide`: act on the instance with the highest score, or search on if
    there is none. why: in words, for `helios why`."""
    candidates = tuple(
        Candidate(
            "object",
            thing.class_name,
            position_of(thing),
            {"score": thing.score, "views": float(thing.views), "total": float(score)},
            thing.id,
        )
        for thing, score in zip(things, scores, strict=True)
    )
    if not candidates:
        return Decision(why, Do.SEARCH_ON, (), None, f"search on: nothing is {why}")
    k = best_of(candidates)
    best = candidates[k]
    said = f"act on the {best.name}: {why}, with a score of {best.terms['total']:.3g}"
    return Decision(why, Do.ACT, candidates, k, said)
