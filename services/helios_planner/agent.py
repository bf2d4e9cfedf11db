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

    belief: what it takes for true of things. seek_object: kit, class, start receptacle's class or
    None; seek_receptacle: kit, class, where the object was taken from if that must not be the goal,
    else None. retries: whether a failed pick is tried again from elsewhere, or that place is left
    alone. other_share: of what a local search is expected to see, what speaks for something else
    (Table 5); 0 is optimistic.
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
        lambda kit, name, _: TrustingSearch(kit, Phase.FIND_OBJECT, name, explorer),
        lambda kit, name, not_at: TrustingSearch(
            kit, Phase.FIND_RECEPTACLE, name, explorer, not_at
        ),
        retries=False,
    )
