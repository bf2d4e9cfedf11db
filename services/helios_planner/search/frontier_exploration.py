"""Exploration of frontiers: by a rule that keeps a frontier until it was seen, or as VLFM does,
which chooses again after every move."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from helios_planner.decisions.decision import Decision, Do
from helios_planner.decisions.global_search import (
    KEPT_VALUE,
    ChosenFrontier,
    FrontierRule,
    kept,
)
from helios_planner.match_radii import SAME_FRONTIER_M
from helios_planner.search.base import Search


class Explorer(ABC):
    """Explorer of the frontiers of one search, in one value layer."""

    def __init__(self, search: Search, layer: str) -> None:
        self.search, self.layer = search, layer

    @abstractmethod
    def step(self, found: Callable[[], bool]) -> bool:
        """Explore one frontier, until `found()` is true; False when none is left."""

    @abstractmethod
    def checkpoint(self) -> list[float]:
        """State that must outlive a restart, for `restore`."""

    @abstractmethod
    def restore(self, checkpoint: Sequence[float]) -> None:
        """Restore the state that `checkpoint` returned."""

    def _visit(self, decision: Decision, found: Callable[[], bool]) -> bool:
        """Publish a decision and carry it out; False if nothing is left."""
        self.search.robot.listener.on_decision(decision)
        if decision.do is Do.NOTHING_LEFT:
            return False
        self.search.tell(decision.why)
        self.search.visit_frontier(decision.chosen.position_m[:2], found)
        return True


class RuleExplorer(Explorer):
    """Explorer that visits the frontier that a rule chose until it is gone."""

    def __init__(self, search: Search, layer: str, rule: FrontierRule) -> None:
        super().__init__(search, layer)
        self._rule = rule

    def step(self, found: Callable[[], bool]) -> bool:
        options = self.search.frontier_options(self.layer)
        return self._visit(self._rule(options, self.layer, self.search.tools.rng), found)

    def checkpoint(self) -> list[float]:
        return []

    def restore(self, checkpoint: Sequence[float]) -> None:
        """Do nothing: the rule has no state."""


class TargetPursuit(Explorer):
    """VLFM's explorer: drives to the frontier of the highest value, and chooses again as soon as
    its value falls."""

    def __init__(self, search: Search, layer: str) -> None:
        super().__init__(search, layer)
        self.last: ChosenFrontier | None = None

    def step(self, found: Callable[[], bool]) -> bool:
        decision = kept(self.search.frontier_options(self.layer), self.layer, self.last)
        if decision.winner is not None:
            chosen = decision.chosen
            self.last = ChosenFrontier(chosen.position_m[:2], chosen.terms["value"])
        return self._visit(decision, lambda: found() or self._fell())

    def checkpoint(self) -> list[float]:
        return [] if self.last is None else [*self.last.xy_m, self.last.value_when_chosen]

    def restore(self, checkpoint: Sequence[float]) -> None:
        if checkpoint:
            x_m, y_m, value = checkpoint
            self.last = ChosenFrontier((x_m, y_m), value)

    def _fell(self) -> bool:
        """True if the value of the target frontier has fallen since the last move. Else the target
        follows the frontier, which moves as ground is seen."""
        assert self.last is not None
        last = self.last
        near = [
            f
            for f in self.search.robot.frontiers()
            if math.dist(f.xy_m, last.xy_m) <= SAME_FRONTIER_M
        ]
        if not near:
            return False
        same = min(near, key=lambda f: math.dist(f.xy_m, last.xy_m))
        value = same.values.get(self.layer, 0.0)
        if value + KEPT_VALUE <= last.value_when_chosen:
            return True
        self.last = ChosenFrontier(same.xy_m, value)
        return False
