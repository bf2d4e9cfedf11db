"""The search of an agent that trusts its detector: explore until it reports the thing, then act.

Paper, section 4, trusting agent: no 3D map, no gaze points, no objective. Nothing here asks the
object map.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from helios_core.types import ObjectInstance

from helios_planner.decisions import sentences
from helios_planner.decisions.decide import Candidate, Decision, Do, best_of, position_of
from helios_planner.searching.belief import SAME_THING_M
from helios_planner.searching.explore import PICK_LAYER, PLACE_LAYER, Kit, Search, near_outline
from helios_planner.searching.explorers import Explorer
from helios_planner.task import Phase


class TrustingSearch(Search):
    """Acts on the nearest thing that the detector has reported and that has not failed yet. Goal
    receptacles that it reported while the object was sought count too."""

    def __init__(
        self,
        kit: Kit,
        phase: Phase,
        name: str,
        explorer: Callable[[Search, str], Explorer],
        not_at: np.ndarray | None = None,
    ) -> None:
        """not_at: where the object was taken from, when start and goal are of one class."""
        super().__init__(kit, phase, name, SAME_THING_M)
        self._not_at = not_at
        layer = PICK_LAYER if phase is Phase.FIND_OBJECT else PLACE_LAYER
        self._explorer = explorer(self, layer)

    def reported(self) -> list[ObjectInstance]:
        return [
            thing for thing in self.belief.known(self.name)
            if self.open(thing)
            and (self._not_at is None or not near_outline(thing, self._not_at, 0.2))
        ]  # fmt: skip

    def decide(self) -> Decision:
        pose = self.body.pose()
        kind = "object" if self.phase is Phase.FIND_OBJECT else "receptacle"
        candidates = []
        for thing in self.reported():
            away_m = pose.distance_m(thing.center_m)
            terms = {"views": float(thing.views), "distance_m": away_m, "total": -away_m}
            candidates.append(
                Candidate(kind, thing.class_name, position_of(thing), terms, thing.id)
            )
        rule = "trust the detector"
        if not candidates:
            return Decision(rule, Do.SEARCH_ON, (), None, sentences.none_reported(self.name))
        k = best_of(candidates)
        why = sentences.trusted(candidates, k)
        return Decision(rule, Do.ACT, tuple(candidates), k, why)

    def explore(self) -> bool:
        return self._explorer.step(lambda: bool(self.reported()))

    def memory(self) -> dict[str, Any]:
        return super().memory() | {"explorer": self._explorer.memory()}

    def recall(self, memory: Mapping[str, Any]) -> None:
        super().recall(memory)
        self._explorer.recall(memory["explorer"])
