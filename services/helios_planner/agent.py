"""What an agent is: how it differs from the others. Flow, motion, pick and place are the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from helios_planner.search.base import Search, SearchTools
from helios_planner.search.baselines import TrustingSearch
from helios_planner.search.candidate_beliefs import Belief
from helios_planner.search.frontier_exploration import Explorer
from helios_planner.task import Phase


@dataclass(frozen=True)
class Agent:
    """How an agent differs from the others.

    belief: what it takes for true of things. seek_object: tools, class, start receptacle's class or
    None; seek_receptacle: tools, class, where the object was taken from if that must not be the
    goal, else None. retries: whether a failed pick is tried again from another pose.
    other_share: share of an expected view that speaks for something else (Table 5); 0 is
    optimistic.
    """

    belief: type[Belief]
    seek_object: Callable[[SearchTools, str, str | None], Search]
    seek_receptacle: Callable[[SearchTools, str, np.ndarray | None], Search]
    retries: bool = True
    other_share: float = 0.0


def trusting(belief: type[Belief], explorer: Callable[[Search, str], Explorer]) -> Agent:
    """One that goes by detections alone. explorer: of a search and its value layer."""
    return Agent(
        belief,
        lambda tools, name, _: TrustingSearch(tools, Phase.FIND_OBJECT, name, explorer),
        lambda tools, name, not_at: TrustingSearch(
            tools, Phase.FIND_RECEPTACLE, name, explorer, not_at
        ),
        retries=False,
    )
