"""Finding the goal receptacle (flow 3): candidates by score, frontiers by place value."""

from __future__ import annotations

import numpy as np
from helios_core.types import ObjectInstance

from helios_planner.decide import Decision, Do, act_or_look, frontier_by_value
from helios_planner.explore import Kit, Search, near_outline
from helios_planner.look import BestView, Places
from helios_planner.task import Cause, Phase, TaskFailed

LAYER = "place"


class ReceptacleSearch(Search):
    """What was learnt while the object was sought is used from the first moment."""

    def __init__(self, kit: Kit, name: str, not_at: np.ndarray | None = None) -> None:
        """not_at: where the object was taken from, when start and goal are of one class."""
        super().__init__(kit, Phase.FIND_RECEPTACLE, name, kit.settings.tau_b)
        self.refused = Places(kit.settings.same_place_m)
        self._not_at = not_at

    def find(self) -> ObjectInstance:
        """Look until a receptacle has Psi >= tau_b. Raises TaskFailed when nothing is left."""
        for round_number in range(self.settings.rounds):
            while True:
                decision, views = self._decide()
                self.body.tell_decision(decision)
                self.tell(decision.why)
                if decision.do is Do.ACT:
                    return self.chosen(decision)
                if decision.do is Do.LOOK:
                    self.extra_view(decision, views)
                    continue
                more = self._step() or self.clear_way()
                if not self.end_waiting() and not more:
                    break
            if round_number + 1 < self.settings.rounds:
                self.next_round()
        raise TaskFailed(
            Cause.RECEPTACLE_NOT_FOUND, f"no {self.name} was found: every frontier was explored"
        )

    def _step(self) -> bool:
        decision = frontier_by_value(self.frontier_options(LAYER), LAYER)
        self.body.tell_decision(decision)
        if decision.do is Do.NOTHING_LEFT:
            return False
        self.tell(decision.why)
        before = {o.id for o in self._candidates()}

        def found() -> bool:
            now = self._candidates()
            return any(o.score >= self.threshold or o.id not in before for o in now)

        self.visit_frontier(decision.chosen.position_m[:2], found)
        return True

    def _candidates(self) -> list[ObjectInstance]:
        return [
            o for o in self.body.objects(self.name)
            if o.class_score >= self.settings.cs_b
            and self.open(o)
            and (self._not_at is None or not near_outline(o, self._not_at, 0.2))
        ]  # fmt: skip

    def _decide(self) -> tuple[Decision, dict[int, BestView | None]]:
        s = self.settings
        things = self._candidates()
        pairs = [self.looking.option(o, self.name, s.tau_b) for o in things]
        decision = act_or_look([p[0] for p in pairs], s.tau_b, s.tau_inc, "receptacle", "place")
        return decision, {o.id: p[1] for o, p in zip(things, pairs, strict=True)}
