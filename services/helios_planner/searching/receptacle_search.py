"""Finding the goal receptacle (flow 3): candidates by score, frontiers by place value."""

from __future__ import annotations

import numpy as np
from helios_core.types import ObjectInstance

from helios_planner.decisions.frontier_rules import highest_value
from helios_planner.decisions.standards import Rule
from helios_planner.searching.explore import PLACE_LAYER, Kit, near_outline
from helios_planner.searching.explorers import ByRule, Explorer
from helios_planner.searching.scored_search import ScoredSearch
from helios_planner.task import Phase


class ReceptacleSearch(ScoredSearch):
    """What was learnt while the object was sought is used from the first moment."""

    kind, what = "receptacle", "place"

    def __init__(self, kit: Kit, name: str, not_at: np.ndarray | None, standards: Rule) -> None:
        """not_at: where the object was taken from, when start and goal are of one class."""
        s = kit.settings
        within = standards(s.tau_b, False)
        super().__init__(kit, Phase.FIND_RECEPTACLE, name, within, s.same_place_m)
        self._not_at = not_at
        self._explorer: Explorer = ByRule(self, PLACE_LAYER, highest_value)

    def explore(self) -> bool:
        return self.until_candidates(self._explorer)

    def holds_up(self, near: ObjectInstance | None) -> bool:
        """At last there is no time for another, whatever this one looks like from near."""
        return self.at_last or super().holds_up(near)

    def candidates(self) -> list[ObjectInstance]:
        return [
            o for o in self.body.objects(self.name)
            if o.class_score >= self.settings.cs_b
            and self.open(o)
            and (self._not_at is None or not near_outline(o, self._not_at, 0.2))
        ]  # fmt: skip
