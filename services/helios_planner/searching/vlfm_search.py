"""VLFM with the stop decision of HELIOS (paper, section 4.2, Table 2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from helios_core.types import ObjectInstance

from helios_planner.decisions.standards import paper
from helios_planner.searching.explore import PICK_LAYER, Kit
from helios_planner.searching.explorers import Pursuit
from helios_planner.searching.scored_search import ScoredSearch
from helios_planner.task import Phase


class StopSearch(ScoredSearch):
    """Explores as VLFM does until something may be what is sought, by its class score; then goes to
    gaze points around it, and stops there only where its score is high enough."""

    kind, what = "object", "stop"

    def __init__(self, kit: Kit, name: str) -> None:
        within = paper(kit.settings.tau_g, False)
        super().__init__(kit, Phase.FIND_OBJECT, name, within, refused_m=0.15)
        self._explorer = Pursuit(self, PICK_LAYER)

    def candidates(self) -> list[ObjectInstance]:
        return [
            o for o in self.body.objects(self.name)
            if o.class_score >= self.settings.cs_g and self.open(o)
        ]  # fmt: skip

    def explore(self) -> bool:
        return self.until_candidates(self._explorer)

    def memory(self) -> dict[str, Any]:
        return super().memory() | {"explorer": self._explorer.memory()}

    def recall(self, memory: Mapping[str, Any]) -> None:
        super().recall(memory)
        self._explorer.recall(memory["explorer"])
