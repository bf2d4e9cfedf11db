"""Definition of an agent: its rules for belief and search. Task flow, motion, pick and place are
the same for all agents."""

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
    """The rules in which agents differ.

    belief: class of its belief about objects. seek_object: creates the object search from tools,
    class and start receptacle's class (or None). seek_receptacle: creates the receptacle search
    from tools, class and the point where the object was picked, if that receptacle must not be the
    goal, else None. retries: True if a failed pick is tried again from another pose. other_share:
    share of the evidence of an expected view that goes to the *other* class (Table 5); 0 is
    optimistic; None: by the object map's setting `assumption`.
    """

    belief: type[Belief]
    seek_object: Callable[[SearchTools, str, str | None], Search]
    seek_receptacle: Callable[[SearchTools, str, np.ndarray | None], Search]
    retries: bool = True
    other_share: float | None = None


def trusting(belief: type[Belief], explorer: Callable[[Search, str], Explorer]) -> Agent:
    """Agent that acts on detections alone. explorer: creates it for a search and value layer."""
    return Agent(
        belief,
        lambda tools, name, _: TrustingSearch(tools, Phase.FIND_OBJECT, name, explorer),
        lambda tools, name, not_at: TrustingSearch(
            tools, Phase.FIND_RECEPTACLE, name, explorer, not_at
        ),
        retries=False,
    )
