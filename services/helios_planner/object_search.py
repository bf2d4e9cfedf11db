"""Finding the object (flow 1 and 2): global search, local search, extra views."""

from __future__ import annotations

from helios_core.types import ObjectInstance

from helios_planner.decide import (
    Decision,
    Do,
    ReceptacleOption,
    act_or_look,
    global_search,
)
from helios_planner.explore import Kit, Search, near_outline
from helios_planner.legs import Outcome
from helios_planner.look import BestView, Places
from helios_planner.objective import ChosenFrontier, FirstSeen, SearchMemory, normalised_gain
from helios_planner.task import Cause, Phase, TaskFailed

LAYER = "pick"


class ObjectSearch(Search):
    """Remembers over a task what was visited, chosen and first seen."""

    def __init__(self, kit: Kit, name: str, start: str | None) -> None:
        super().__init__(kit, Phase.FIND_OBJECT, name, kit.settings.tau_g)
        self.start = start
        self.memory = SearchMemory()
        self.visited = Places(kit.settings.same_place_m)
        self._last_seen: tuple = ()

    def find(self) -> ObjectInstance:
        """Look until an object has Psi >= tau_g. Raises TaskFailed when nothing is left."""
        for round_number in range(self.settings.rounds):
            while True:
                decision, views = self._decide()
                if decision.do in (Do.ACT, Do.LOOK):
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
                self.visited.clear()
                self.next_round()
        raise TaskFailed(
            Cause.OBJECT_NOT_FOUND,
            f"no {self.name} was found: every frontier and every candidate place was searched",
        )

    def end_waiting(self) -> bool:
        self._last_seen = ()
        return super().end_waiting()

    # --- the object ----------------------------------------------------------------------------
    def _decide(self) -> tuple[Decision, dict[int, BestView | None]]:
        s = self.settings
        things = [
            o for o in self.body.objects(self.name) if o.class_score >= s.cs_g and self.open(o)
        ]
        starts = self._receptacles()
        pairs = [
            self.looking.option(
                o, self.name, s.tau_g, any(near_outline(r, o.center_m, 0.15) for r in starts)
            )
            for o in things
        ]
        decision = act_or_look([p[0] for p in pairs], s.tau_g, s.tau_inc, "object", "pick")
        return decision, {o.id: p[1] for o, p in zip(things, pairs, strict=True)}

    def _something_to_do(self) -> bool:
        """Whether the search is to be interrupted for a candidate object."""
        found = self.body.objects(self.name)
        seen = tuple((o.id, o.views, round(o.score, 3)) for o in found)
        if not seen or self._last_seen == seen:
            return False
        self._last_seen = seen
        return self._decide()[0].do in (Do.ACT, Do.LOOK)

    # --- where it may be -----------------------------------------------------------------------
    def _step(self) -> bool:
        """One step of the global search; False when nothing is left."""
        options = self._receptacle_options()
        frontiers = self.frontier_options(LAYER)
        decision = global_search(options, frontiers, self.memory, self.settings.alpha_d)
        self.body.tell_decision(decision)
        if decision.do is Do.NOTHING_LEFT:
            return False
        self.tell(decision.why)
        chosen = decision.chosen
        if decision.do is Do.GO_TO_FRONTIER:
            xy = chosen.position_m[:2]
            self.memory.chosen.append(ChosenFrontier(xy, chosen.terms["value"]))
            self.visit_frontier(xy, self._something_to_do)
        else:
            self._local_search(next(o.instance for o in options if o.instance.id == chosen.id))
        return True

    def _receptacles(self) -> list[ObjectInstance]:
        if not self.start:
            return []
        return [o for o in self.body.objects(self.start) if o.class_score >= self.settings.cs_a]

    def _receptacle_options(self) -> list[ReceptacleOption]:
        pose = self.body.pose()
        options = []
        for r in self._receptacles():
            if r in self.visited:
                continue
            gain = self.looking.information_gain_nats(r, r.class_name)
            if gain is None:
                continue
            normalised = normalised_gain(gain, r.gaussians, self.settings.gain_norm)
            centre = (float(r.center_m[0]), float(r.center_m[1]))
            self.memory.note(r.id, FirstSeen(r.class_score, normalised, centre))
            options.append(ReceptacleOption(r, r.class_score, normalised, pose.distance_m(centre)))
        return options

    def _local_search(self, receptacle: ObjectInstance) -> None:
        """All gaze points of a receptacle, nearest first; then it is visited."""
        purpose = f"look for the {self.name} on the {receptacle.class_name}"
        while points := self.looking.around(receptacle):
            outcome = self.looking.go_and_look(
                receptacle, points[0], purpose, self._something_to_do
            )
            if outcome is Outcome.INTERRUPTED or self._something_to_do():
                return
        self.visited.add(receptacle)
