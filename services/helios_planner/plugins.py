"""What an agent of your own is made of (docs/tutorials/your-own-agent.md).

The smallest is an exploration rule: a function from places to scores.

    from helios_planner.plugins import Places, exploring_by

    def nearest(places: Places):
        return -places.distance_m

    agent = exploring_by(nearest)

    helios up --agent my_package:agent
    helios task "find the mug"

A whole agent says what it takes for true of things, and how it seeks the object and the goal:
`Agent(belief, seek_object, seek_receptacle)`. A search of its own derives from `Search` and writes
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
from helios_planner.search.plugin_search import ByOwnRule, OwnObjectSearch, OwnReceptacleSearch
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
    """An agent that goes where a rule says, and is else as one of ours.

    As `helios-paper`: it acts on the scores of the object map, and the rule chooses among candidate
    receptacles and frontiers while the object is sought, among frontiers while the goal is sought.
    With trusts_detector as `trusting`: it acts on what is detected, and the rule chooses among
    frontiers.
    """
    if trusts_detector:
        return trusting(TrustingBelief, lambda search, layer: ByOwnRule(search, layer, rule))
    return Agent(
        MapBelief,
        lambda tools, name, start: OwnObjectSearch(tools, name, start, rule),
        lambda tools, name, not_at: OwnReceptacleSearch(tools, name, not_at, rule),
    )


def explorer(search: Search, rule: ExplorationRule) -> Explorer:
    """Explores for a search of your own: `step(found)` visits one frontier by the rule, until
    `found()` is true; False when none is left."""
    layer = PICK_LAYER if search.phase is Phase.FIND_OBJECT else PLACE_LAYER
    return ByOwnRule(search, layer, rule)


def act_on_best(things: Sequence[ObjectInstance], scores: Sequence[float], why: str) -> Decision:
    """What `Search.decide` returns: act on the thing with the highest score, or search on where
    there is none. why: in words, for `helios why`."""
    candidates = tuple(
        Candidate(
            "object", thing.class_name, position_of(thing),
            {"score": thing.score, "views": float(thing.views), "total": float(score)}, thing.id,
        )
        for thing, score in zip(things, scores, strict=True)
    )  # fmt: skip
    if not candidates:
        return Decision(why, Do.SEARCH_ON, (), None, f"search on: nothing is {why}")
    k = best_of(candidates)
    best = candidates[k]
    said = f"act on the {best.name}: {why}, with a score of {best.terms['total']:.3g}"
    return Decision(why, Do.ACT, candidates, k, said)
