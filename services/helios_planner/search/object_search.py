"""Search for the object: candidates on start receptacles, global and local search."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from helios_core.errors import InvalidInput
from helios_core.types import ObjectInstance

from helios_planner.decisions.absence import decide_absence
from helios_planner.decisions.acceptance import Rule, try_unnamed
from helios_planner.decisions.decision import (
    Act,
    CompleteSearch,
    Decision,
    Do,
    FrontierOption,
    ReceptacleOption,
)
from helios_planner.decisions.gain import Gain, normalised_gain
from helios_planner.decisions.global_search import (
    ChosenFrontier,
    FirstSeen,
    SearchMemory,
    SearchRule,
)
from helios_planner.match_radii import (
    ON_OUTLINE_M,
    SAME_INSTANCE_M,
    SAME_PLACE_M,
    SAME_SPOT_M,
)
from helios_planner.motion_planning.base_placement import near_outline
from helios_planner.motion_planning.unknown_borders import floor_m2
from helios_planner.refuted_things import RefutedThing
from helios_planner.search.base import PICK_LAYER, SearchTools
from helios_planner.search.scored_search import ScoredSearch
from helios_planner.search.unnamed_things import FIRST_ID, is_unnamed, unnamed_things
from helios_planner.search.view_selection import PlaceSet
from helios_planner.task import Cause, ObjectAbsent, Phase, TaskFailed

# Ψ of a start receptacle whose unnamed things are tried as soon as it was searched in vain, and
# the least score of such a thing.
SURE_FROM, LIKELY_FROM = 0.9, 0.25
UNSEEN_PLACE_SCORE = 0.05  # score of an unseen start receptacle, which may be anywhere
# Score of a start receptacle still to be found, unless a known one has more.
EXPECTED_RECEPTACLE_SCORE = 0.4


def is_on_any(thing: ObjectInstance, starts: Sequence[ObjectInstance]) -> bool:
    """True if the object is on or near any start receptacle, whatever that one's score."""
    return any(near_outline(start, thing.center_m, ON_OUTLINE_M) for start in starts)


def place_probability(thing: ObjectInstance, starts: Sequence[ObjectInstance]) -> float:
    """Relative probability, in (0, 1], that an object is on a start receptacle: the Ψ of the one
    under it against the highest Ψ known or expected. Beyond the paper: (0.05 + Ψ_here) / (0.05 +
    max(0.4, max Ψ))."""
    likeliest = max([EXPECTED_RECEPTACLE_SCORE, *(start.score for start in starts)])
    here = [max(s.score, 0.0) for s in starts if near_outline(s, thing.center_m, ON_OUTLINE_M)]
    return (UNSEEN_PLACE_SCORE + max(here, default=0.0)) / (UNSEEN_PLACE_SCORE + likeliest)


class ObjectSearch(ScoredSearch):
    """Search for the object. It keeps which receptacles and frontiers were visited, chosen and
    first seen.

    If the instruction names a start receptacle, the paper's thresholds accept a candidate elsewhere
    only when nothing is left to search. The patient agent's thresholds lower its score by
    `place_probability`.
    """

    kind, action = "object", Act.PICK

    def __init__(
        self, tools: SearchTools, name: str, start: str | None, rule: SearchRule, thresholds: Rule
    ) -> None:
        place_counts = start is not None and tools.settings.start_receptacle_first
        within = thresholds(tools.settings.tau_g, place_counts)
        super().__init__(tools, Phase.FIND_OBJECT, name, within, refused_m=SAME_INSTANCE_M)
        self.start, self._rule = start, rule
        self.seen = SearchMemory()
        self.visited = PlaceSet(SAME_PLACE_M)
        self._most_unnamed = 0
        self._searched = False  # True once everything was searched in vain
        self._tried = PlaceSet(SAME_SPOT_M)  # unnamed things that were looked at in the hand
        self._seen_in_hand = PlaceSet(SAME_INSTANCE_M)  # the same for things with the name
        self._refuted_earlier: list[tuple[float, float]] = []  # unnamed things of earlier tasks
        self._unnamed: dict[int, ObjectInstance] = {}  # of the newest decision
        self._last_seen: tuple = ()

    def checkpoint(self) -> dict[str, Any]:
        return super().checkpoint() | {
            "visited": self.visited.checkpoint(),
            "objective": self.seen.as_json(),
            "searched": self._searched,
            "tried": self._tried.checkpoint(),
            "seen_in_hand": self._seen_in_hand.checkpoint(),
        }

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        super().restore(checkpoint)
        self.visited.restore(checkpoint["visited"])
        self.seen = SearchMemory.of_json(checkpoint["objective"])
        self._searched = bool(checkpoint.get("searched", False))
        if "tried" in checkpoint:
            self._tried.restore(checkpoint["tried"])
        if "seen_in_hand" in checkpoint:
            self._seen_in_hand.restore(checkpoint["seen_in_hand"])

    def end_waiting(self) -> bool:
        self._last_seen = ()
        return super().end_waiting()

    def next_round(self) -> None:
        self.visited.clear()
        super().next_round()

    # --- the object ----------------------------------------------------------------------------
    def candidates(self) -> list[ObjectInstance]:
        return [o for o in self._named() if self.open(o)]

    def _named(self) -> list[ObjectInstance]:
        """Instances with the sought name, also those that were given up."""
        known = self.robot.objects(self.name)
        return [o for o in known if o.class_score >= self.settings.cs_g]

    def in_place(self, candidate: ObjectInstance) -> bool:
        if self.start is None or not self.settings.start_receptacle_first:
            return True
        return is_on_any(candidate, self.robot.objects(self.start))

    def place_probability(self, candidate: ObjectInstance) -> float:
        return (
            1.0
            if self.start is None
            else place_probability(candidate, self.robot.objects(self.start))
        )

    def relax(self) -> bool:
        self._last_seen = ()
        if super().relax():
            return True
        first, self._searched = not self._searched, True
        return first and bool(self._untried())

    # --- things without the sought name --------------------------------------------------------
    def pick_unnamed(self, most: int) -> None:
        self._most_unnamed = most

    def decide(self) -> Decision:
        """Decision about the candidates; in vain, to try what lies on a start receptacle."""
        decision = super().decide()
        self._unnamed = {}
        if decision.do is Do.LOOK or (decision.do is Do.ACT and not self.accepted_any_candidate):
            return decision
        things = self._untried()
        if not things or (
            decision.do is Do.ACT and decision.chosen.terms["total"] >= things[0].score
        ):
            return decision
        self._unnamed, self._from_memory = {thing.id: thing for thing in things}, True
        pose = self.robot.pose()
        away_m = [pose.distance_m(thing.center_m[:2]) for thing in things]
        return try_unnamed(self.name, self.start or "", things, away_m)

    def _untried(self) -> list[ObjectInstance]:
        """Unnamed things that may be tried now, likeliest first: likely ones on a sure receptacle
        once it was looked at from all sides; all of them once everything was searched."""
        if self.start is None or len(self._tried.points) >= self._most_unnamed:
            return []
        starts, least = self.robot.objects(self.start), 0.0
        if not (self._searched or self.accepted_any_candidate):
            starts = [s for s in starts if s.score >= SURE_FROM and s in self.visited]
            least = LIKELY_FROM
        things = unnamed_things(self.name, starts, self.robot.ground(), self.robot.probability_at)
        left = [*self._tried.points, *self.refused.points]
        left += [] if self._searched else self._refuted_earlier  # tried again at the end
        named = [one.center_m[:2] for one in self._set_aside if one.id < FIRST_ID]
        named += self._seen_in_hand.points
        return [
            t
            for t in things
            if t.score >= least
            and t not in self.unreachable
            and all(math.dist(p, t.center_m[:2]) > SAME_SPOT_M for p in left)
            and all(math.dist(p, t.center_m[:2]) > SAME_INSTANCE_M for p in named)
        ]

    def chosen(self, decision: Decision) -> ObjectInstance:
        return self._unnamed.get(decision.chosen.id) or super().chosen(decision)

    def recall(self, thing: RefutedThing) -> None:
        super().recall(thing)
        if thing.unnamed:
            self._refuted_earlier.append(thing.center_m[:2])

    def note_seen(self, candidate: ObjectInstance) -> None:
        (self._tried if is_unnamed(candidate) else self._seen_in_hand).add(candidate)

    def was_set_aside(self, candidate: ObjectInstance) -> bool:
        if is_unnamed(candidate):  # another one may lie beside it
            return any(one.id == candidate.id for one in self._set_aside)
        return super().was_set_aside(candidate)

    def end_if_absent(self) -> None:
        untried = self._most_unnamed > 0 and not self._searched
        if self.settings.absent_from >= 1 or untried or self.has_one_refuted_earlier():
            return
        unseen = [o for o in self._named() if o not in self._seen_in_hand]
        candidates = self.judge(unseen).candidates
        starts = self.robot.objects(self.start) if self.start else []
        search = CompleteSearch(
            self._latest_round + 1,
            floor_m2(self.robot.ground()),
            self.start or "",
            max((start.score for start in starts), default=0.0),
            len(self._tried.points),
            self.set_aside_probabilities(),
        )
        decision = decide_absence(self.name, candidates, search, self.settings.absent_from)
        self.robot.listener.on_decision(decision)
        if decision.do is Do.NOTHING_LEFT:
            raise ObjectAbsent(decision.why)

    def _something_to_do(self) -> bool:
        """True if a candidate object interrupts the search."""
        found = self.robot.objects(self.name)
        seen = tuple((o.id, o.views, round(o.score, 3)) for o in found)
        if not seen or self._last_seen == seen:
            return False
        self._last_seen = seen
        return self.decide().do in (Do.ACT, Do.LOOK)

    # --- global and local search ---------------------------------------------------------------
    def explore(self) -> bool:
        """Take one step of the global search."""
        options = self._receptacle_options()
        frontiers = self.frontier_options(PICK_LAYER)
        decision = self.next_place(options, frontiers)
        self.robot.listener.on_decision(decision)
        if decision.do is Do.NOTHING_LEFT:
            return False
        self.tell(decision.why)
        chosen = decision.chosen
        if decision.do is Do.GO_TO_FRONTIER:
            xy = chosen.position_m[:2]
            self.seen.choose(ChosenFrontier(xy, chosen.terms["value"]))
            self.visit_frontier(xy, self._something_to_do)
        else:
            self._local_search(next(o.instance for o in options if o.instance.id == chosen.id))
        return True

    def _receptacles(self) -> list[ObjectInstance]:
        if not self.start:
            return []
        return [o for o in self.robot.objects(self.start) if o.class_score >= self.settings.cs_a]

    def _receptacle_options(self) -> list[ReceptacleOption]:
        pose = self.robot.pose()
        options = []
        for r in self._receptacles():
            if r in self.visited:
                continue
            gain = self.looking.information_gain(r, r.class_name)
            if gain is None:
                continue
            normalised = self._normalised(gain)
            centre = (float(r.center_m[0]), float(r.center_m[1]))
            self.seen.note(r.id, FirstSeen(r.class_score, normalised, centre, gain))
            away_m, bearing_rad = pose.distance_m(centre), pose.bearing_rad(centre)
            option = ReceptacleOption(r, r.class_score, normalised, away_m, bearing_rad, gain)
            options.append(option)
        return options

    def _normalised(self, gain: Gain) -> float:
        try:
            return normalised_gain(gain, self.settings.gain_norm)
        except InvalidInput as error:
            raise TaskFailed(Cause.SYSTEM_ERROR, error.message) from error

    def next_place(
        self, receptacles: Sequence[ReceptacleOption], frontiers: Sequence[FrontierOption]
    ) -> Decision:
        """Decision for the next place to search; either list may be empty."""
        return self._rule(receptacles, frontiers, self.seen, self.settings.alpha_d)

    def _local_search(self, receptacle: ObjectInstance) -> None:
        """Look at a receptacle from all its gaze points, nearest first, and mark it as visited."""
        purpose = f"look for the {self.name} on the {receptacle.class_name}"
        if self.looking.visit_gaze_points(receptacle, purpose, self._something_to_do):
            self.visited.add(receptacle)
