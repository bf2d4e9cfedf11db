"""Searches of HELIOS in which a plug-in's rule chooses the next place."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from helios_planner.decisions.acceptance import paper
from helios_planner.decisions.decision import Decision, FrontierOption, ReceptacleOption
from helios_planner.decisions.global_search import by_objective
from helios_planner.decisions.plugin_rule import ExplorationRule, by_own_rule
from helios_planner.search.base import PICK_LAYER, PLACE_LAYER, Search, SearchTools
from helios_planner.search.frontier_exploration import Explorer
from helios_planner.search.object_search import ObjectSearch
from helios_planner.search.scored_search import ReceptacleSearch


class PluginRuleExplorer(Explorer):
    """Explorer that visits the frontier with the rule's highest score until it is gone."""

    def __init__(self, search: Search, layer: str, rule: ExplorationRule) -> None:
        super().__init__(search, layer)
        self._rule = rule

    def step(self, found: Callable[[], bool]) -> bool:
        frontiers = self.search.frontier_options(self.layer)
        rng = self.search.tools.rng
        decision = by_own_rule(self._rule, None, frontiers, self.search.name, self.layer, rng)
        return self._visit(decision, found)

    def checkpoint(self) -> list[float]:
        return []

    def restore(self, checkpoint: Sequence[float]) -> None:
        """Do nothing: the rule has no state."""


class OwnObjectSearch(ObjectSearch):
    """Object search among candidate receptacles and frontiers by the rule's scores."""

    def __init__(
        self, tools: SearchTools, name: str, start: str | None, rule: ExplorationRule
    ) -> None:
        super().__init__(tools, name, start, by_objective, paper)
        self._own_rule = rule

    def next_place(
        self, receptacles: Sequence[ReceptacleOption], frontiers: Sequence[FrontierOption]
    ) -> Decision:
        rng = self.tools.rng
        return by_own_rule(self._own_rule, receptacles, frontiers, self.name, PICK_LAYER, rng)


class OwnReceptacleSearch(ReceptacleSearch):
    """Receptacle search that explores by the rule's scores until the goal is known."""

    def __init__(
        self, tools: SearchTools, name: str, not_at: np.ndarray | None, rule: ExplorationRule
    ) -> None:
        super().__init__(tools, name, not_at, paper)
        self._explorer = PluginRuleExplorer(self, PLACE_LAYER, rule)
