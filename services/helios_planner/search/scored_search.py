"""Searches by score: candidates of the object map, extra views where one would help (eq. 7, 11)."""

from __future__ import annotations

import heapq
import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from helios_core import proto as pb
from helios_core.codec import object_from_proto, object_to_proto
from helios_core.types import ObjectInstance

from helios_planner.decisions.acceptance import (
    AcceptanceThreshold,
    AcceptanceThresholds,
    Rule,
    act_or_look,
    with_final_fallback,
)
from helios_planner.decisions.decision import Act, Decision, Do
from helios_planner.decisions.explanations import less
from helios_planner.decisions.global_search import FrontierRule, highest_value
from helios_planner.match_radii import PICKED_PLACE_M, SAME_PLACE_M
from helios_planner.motion_planning.base_placement import near_outline
from helios_planner.refuted_things import RefutedThing
from helios_planner.search.base import PLACE_LAYER, Search, SearchTools
from helios_planner.search.frontier_exploration import Explorer, RuleExplorer
from helios_planner.search.view_selection import BestView, PlaceSet
from helios_planner.task import Phase

MOST_WRITTEN = 16
# Least factor by which a score is divided. A candidate with probability 0 in the hand would need an
# infinite score.
LEAST_IN_HAND = 1e-6


class ScoredSearch(Search):
    """Search that acts on a candidate once its score Psi reaches the current threshold."""

    kind: str  # kind of the sought object, as decision records name it
    action: Act  # action on an accepted candidate
    extra_views: ClassVar[bool] = True  # a candidate below the threshold may get one more view

    def __init__(
        self,
        tools: SearchTools,
        phase: Phase,
        name: str,
        thresholds: AcceptanceThresholds,
        refused_m: float,
    ) -> None:
        super().__init__(tools, phase, name, refused_m)
        self._thresholds, self._since = thresholds, tools.robot.budget_used()
        self._step = 0  # index into the acceptance thresholds
        self._decision_step = 0  # the same for the newest decision
        self._rated = True  # the image-text scorer rates the class, as far as is known
        self._known_home = False  # a candidate of a stored map is good enough
        self._views: dict[int, BestView | None] = {}
        self._set_aside: list[SetAside] = []
        self._past_candidates = CandidateMemory()
        self._from_memory = False  # True if its candidate is no longer in the object map
        self._chosen_place = 1.0  # place probability of its candidate

    @abstractmethod
    def candidates(self) -> list[ObjectInstance]:
        """Instances that may be the sought one, by class score."""

    def until_candidates(self, explorer: Explorer) -> bool:
        """Take one exploration step, until a new candidate appears or one reaches the threshold."""
        before = {o.id for o in self.candidates()}

        def found() -> bool:
            now = self.candidates()
            return any(o.score >= self.threshold or o.id not in before for o in now)

        return explorer.step(found)

    def in_place(self, candidate: ObjectInstance) -> bool:
        """True if the candidate lies on the receptacle that the instruction names."""
        return True

    def place_probability(self, candidate: ObjectInstance) -> float:
        """Relative probability, in (0, 1], that the candidate lies on the named receptacle; 1 for
        the most likely receptacle."""
        return 1.0

    @property
    def threshold(self) -> float:
        """Score from which a candidate is acted on now."""
        return self._standard.score

    @property
    def anywhere(self) -> bool:
        """True if a candidate outside the named place may be acted on now."""
        return self._standard.anywhere

    @property
    def _standard(self) -> AcceptanceThreshold:
        return self._thresholds.step(self._present_step(), self._rated)

    @property
    def _decision_threshold(self) -> AcceptanceThreshold:
        return self._thresholds.step(self._decision_step, self._rated)

    def _present_step(self) -> int:
        """Index of the threshold that applies now."""
        due = self._thresholds.least_at(self.robot.budget_used(), self._since)
        self._step = max(self._step, due)
        least = self._thresholds.in_known_home if self._known_home else None
        return self._step if least is None else max(self._step, least)

    def remembers(self) -> bool:
        """True if a stored map, found again, has a candidate that is good enough."""
        return self._remembered(self.candidates())

    def _remembered(self, things: Sequence[ObjectInstance]) -> bool:
        step = self._thresholds.in_known_home
        return step is not None and any(
            t.relocalised
            and self._meets(t, self._thresholds.step(step, t.image_text_nats is not None))
            for t in things
        )

    def _place(self, candidate: ObjectInstance) -> float:
        return self.place_probability(candidate) if self._thresholds.by_place else 1.0

    def confirmed(self, near: ObjectInstance | None) -> bool:
        """True if the candidate may still be acted on after the views from near.

        Its score may be tau_inc below the accepted threshold: views from near show only part of a
        large object. A candidate accepted above τ needs τ - tau_inc. A candidate that is no longer
        in the object map needs no score. Its place counts as when it was chosen, or better: the
        furniture below it shrinks in the map while only a part of it is in view.
        """
        if not self.checks_from_near:
            return True
        if self._from_memory or near is None:
            return self._from_memory
        known = any(o.id == near.id for o in self.candidates())
        return known and self._score_near(near) >= self._least_near and self._is_where_said(near)

    @property
    def checks_from_near(self) -> bool:
        return self.settings.confirm_from_near

    def may_stop(self, near: ObjectInstance | None) -> bool:
        return not self.checks_from_near or super().may_stop(near)

    def _score_near(self, near: ObjectInstance) -> float:
        return near.score * max(self._chosen_place, self._place(near))

    def _is_where_said(self, near: ObjectInstance) -> bool:
        return self._decision_threshold.anywhere or self.in_place(near)

    def why_not(self, near: ObjectInstance | None) -> str:
        if near is None:
            return super().why_not(near)
        score, least = self._score_near(near), self._least_near
        if score < least:
            place = score / near.score if near.score else 1.0
            of = f", {near.score:.2f} × {place:.2f} for its place" if place < 1 else ""
            return f"from near its score is {less(score, least)}{of}"
        if not self._is_where_said(near):
            return "from near it is not where it was said to be"
        return super().why_not(near)

    @property
    def _least_near(self) -> float:
        """Least score from near of the chosen candidate."""
        threshold = self._thresholds.step(self._thresholds.strict_count - 1, self._rated).score
        return min(self._decision_threshold.score, threshold) - self.settings.tau_inc

    @property
    def accepted_any_candidate(self) -> bool:
        """True if the newest decision used the threshold that accepts any candidate."""
        return self._accepts_any(self._decision_step)

    def _accepts_any(self, step: int) -> bool:
        last = len(self._thresholds.steps) - 1
        return self._thresholds.at_last is not None and step == last

    def set_aside(self, candidate: ObjectInstance, probability: float) -> None:
        """Leave a candidate until any is accepted; its score then counts with that probability."""
        self._past_candidates.note([candidate])
        x, y, z = (float(v) for v in candidate.center_m)
        self._set_aside.append(SetAside(candidate.id, (x, y, z), probability))

    def recall(self, thing: RefutedThing) -> None:
        if not thing.unnamed:
            self._set_aside.append(SetAside(FROM_EARLIER_TASK, thing.center_m, thing.probability))

    def was_set_aside(self, candidate: ObjectInstance) -> bool:
        return any(
            self._is_at(candidate, one) for one in self._set_aside if one.id != FROM_EARLIER_TASK
        )

    def has_one_refuted_earlier(self) -> bool:
        """True if a thing in the map is left for the end because of an earlier task alone."""
        for thing in self.robot.objects(self.name):
            earlier = self.in_hand(thing) < 1 and not self.was_set_aside(thing)
            if earlier and super().open(thing):
                return True
        return False

    def in_hand(self, candidate: ObjectInstance) -> float:
        near = (one.probability for one in self._set_aside if self._is_at(candidate, one))
        return min(near, default=1.0)

    def set_aside_probabilities(self) -> tuple[float, ...]:
        """Probability of each thing that looked wrong in the hand in this task."""
        here = [one for one in self._set_aside if one.id != FROM_EARLIER_TASK]
        return tuple(one.probability for one in here)

    def _is_at(self, candidate: ObjectInstance, one: SetAside) -> bool:
        return math.dist(one.center_m, candidate.center_m) < self.refused.same_m

    def _not_in_map(self, things: Sequence[ObjectInstance]) -> list[ObjectInstance]:
        """Candidates that the object map no longer holds but that may be accepted now."""
        if not self._accepts_any(self._present_step()):
            return []
        gone = (one.id for one in self._set_aside if not any(self._is_at(t, one) for t in things))
        past = (self._past_candidates.get(id) for id in gone)
        known = [thing for thing in past if thing is not None and self.open(thing)]
        if things or known:
            return known
        best = self._past_candidates.best(self.open)
        return [best] if best is not None else []

    def open(self, candidate: ObjectInstance) -> bool:
        left = self._set_aside and not self._accepts_any(self._present_step())
        return super().open(candidate) and not (left and self.in_hand(candidate) < 1)

    def _meets(self, thing: ObjectInstance, standard: AcceptanceThreshold) -> bool:
        sure = thing.score * self._place(thing) >= standard.score
        return sure and (standard.anywhere or self.in_place(thing))

    def accept_any_after_share(self, after: float) -> None:
        if after < 1:
            self._thresholds = with_final_fallback(self._thresholds, after)

    def accepted_as_likeliest(self, thing: ObjectInstance) -> bool:
        if not self.accepted_any_candidate:
            return False
        last_but_one = len(self._thresholds.steps) - 2
        return self._from_memory or not self._meets(
            thing, self._thresholds.step(last_but_one, self._rated)
        )

    def relax(self) -> bool:
        rounds = min(self.settings.rounds, self.rounds)
        again = self._round + 1 < rounds  # first search everything once more
        last = self._thresholds.strict_count if again else len(self._thresholds.steps)
        if self._step >= last - 1:
            return False
        self._step += 1
        return True

    def checkpoint(self) -> dict[str, Any]:
        return super().checkpoint() | {
            "standard": self._step,
            "since": self._since,
            "rated": self._rated,
            "remembered": self._past_candidates.checkpoint(),
            "set_aside": [[s.id, *s.center_m, s.probability] for s in self._set_aside],
        }

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        super().restore(checkpoint)
        self._step, self._since = int(checkpoint["standard"]), float(checkpoint["since"])
        self._decision_step, self._rated = self._step, bool(checkpoint.get("rated", True))
        self._past_candidates.restore(checkpoint.get("remembered", []))
        self._set_aside = [
            SetAside(int(id), (x, y, z), p) for id, x, y, z, p in checkpoint.get("set_aside", [])
        ]

    def decide(self) -> Decision:
        """Decision to act on a candidate, to look at one again, or to search on."""
        return self.judge(self.candidates())

    def judge(self, things: Sequence[ObjectInstance]) -> Decision:
        """Decision about some candidates, by their scores."""
        options = []
        self._views.clear()
        self._past_candidates.note(things)
        if things:
            self._rated = any(thing.image_text_nats is not None for thing in things)
        self._known_home = self._remembered(things)
        self._decision_step = self._present_step()
        remembered = self._not_in_map(things)
        for thing in [*things, *remembered]:
            in_place = self.in_place(thing)
            worth = self.extra_views and (in_place or self.anywhere)
            place, in_hand = self._place(thing), self.in_hand(thing)
            needed = self.threshold / (place * max(in_hand, LEAST_IN_HAND))
            option, self._views[thing.id] = self.looking.option(
                thing, self.name, needed, in_place=in_place, ask=worth
            )
            options.append(replace(option, place=place, in_hand=in_hand))
        decision = act_or_look(
            options, self.threshold, self.settings.tau_inc, self.kind, self.action, self.anywhere
        )
        winner = decision.winner
        self._from_memory = winner is not None and winner >= len(things)
        self._chosen_place = 1.0 if winner is None else options[winner].place
        return decision

    def chosen(self, decision: Decision) -> ObjectInstance:
        known_once = self._past_candidates.get(decision.chosen.id) if self._from_memory else None
        return known_once or super().chosen(decision)

    def decide_and_publish(self) -> Decision:
        """Look at candidates again as long as the decision orders it; returns the other one."""
        while (decision := self.publish(self.decide())).do is Do.LOOK:
            self._look_again(decision)
        return decision

    def _look_again(self, decision: Decision) -> None:
        """Go to the best view of the chosen candidate, unless one is accepted on the way."""
        view = self._views[decision.chosen.id]
        assert view is not None

        def sure() -> bool:
            return any(self._meets(o, self._standard) for o in self.candidates())

        purpose = f"another view of the {self.name}"
        self.looking.go_and_look(self.chosen(decision), view.gaze, purpose, sure)


FROM_EARLIER_TASK = -1  # id of what looked wrong in an earlier task; it is looked at again


@dataclass(frozen=True)
class SetAside:
    """A candidate that looked wrong in the hand. center_m: where it was picked, world;
    probability: that it is right."""

    id: int
    center_m: tuple[float, float, float]
    probability: float


class ReceptacleSearch(ScoredSearch):
    """Search for the goal receptacle. It starts with the object map that the object search
    built."""

    kind, action = "receptacle", Act.PLACE

    def __init__(
        self,
        tools: SearchTools,
        name: str,
        not_at: np.ndarray | None,
        thresholds: Rule,
        frontiers: FrontierRule = highest_value,
    ) -> None:
        """not_at: point where the object was picked, if start and goal are of one class; frontiers:
        rule for the next one."""
        s = tools.settings
        within = thresholds(s.tau_b, False)
        super().__init__(tools, Phase.FIND_RECEPTACLE, name, within, SAME_PLACE_M)
        self._not_at = not_at
        self._failed = PlaceSet(SAME_PLACE_M)  # placing on them failed; for the rest of the round
        self._in_last_resort = False  # True once a decision accepted any candidate
        self._explorer: Explorer = RuleExplorer(self, PLACE_LAYER, frontiers)

    def explore(self) -> bool:
        return self.until_candidates(self._explorer)

    def next_round(self) -> None:
        self._failed.clear()  # other points of them may do
        super().next_round()

    def decide(self) -> Decision:
        """Decision about the candidates. The first one that accepts any candidate forgets on which
        ones a placing failed."""
        if not self._in_last_resort and self._accepts_any(self._present_step()):
            self._in_last_resort = True
            self._failed.clear()
        return super().decide()

    def reject_or_postpone(self, candidate: ObjectInstance, out_of_reach: bool) -> None:
        if out_of_reach:
            super().reject_or_postpone(candidate, out_of_reach)
        else:
            self._failed.add(candidate)

    def open(self, candidate: ObjectInstance) -> bool:
        return candidate not in self._failed and super().open(candidate)

    def checkpoint(self) -> dict[str, Any]:
        return super().checkpoint() | {
            "failed": self._failed.checkpoint(),
            "in_last_resort": self._in_last_resort,
        }

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        super().restore(checkpoint)
        if "failed" in checkpoint:
            self._failed.restore(checkpoint["failed"])
        self._in_last_resort = bool(checkpoint.get("in_last_resort"))

    def confirmed(self, near: ObjectInstance | None) -> bool:
        """Also True at the last threshold: no time is left for another receptacle."""
        return self.accepted_any_candidate or super().confirmed(near)

    def candidates(self) -> list[ObjectInstance]:
        return [
            o
            for o in self.robot.objects(self.name)
            if o.class_score >= self.settings.cs_b
            and self.open(o)
            and (self._not_at is None or not near_outline(o, self._not_at, PICKED_PLACE_M))
        ]


class CandidateMemory:
    """Newest estimates of candidates by id, also of those that the object map no longer holds."""

    def __init__(self) -> None:
        self._things: dict[int, ObjectInstance] = {}

    def note(self, candidates: Iterable[ObjectInstance]) -> None:
        """Store the present estimates of candidates."""
        self._things |= {c.id: c for c in candidates}

    def get(self, id: int) -> ObjectInstance | None:
        return self._things.get(id)

    def best(self, allowed: Callable[[ObjectInstance], bool]) -> ObjectInstance | None:
        """Candidate with the largest class score times views; None if none is allowed."""
        return max(filter(allowed, self._things.values()), key=_evidence_key, default=None)

    def checkpoint(self) -> list[str]:
        """The best candidates as JSON, for `restore`; few, as every action stores them."""
        best = heapq.nlargest(MOST_WRITTEN, self._things.values(), key=_evidence_key)
        return [object_to_proto(c).SerializeToString().hex() for c in best]

    def restore(self, checkpoint: Sequence[str]) -> None:
        self.note(
            object_from_proto(pb.ObjectInstance.FromString(bytes.fromhex(m))) for m in checkpoint
        )


def _evidence_key(c: ObjectInstance) -> tuple[float, int]:
    """Sort key: class score times views; of equal ones the older."""
    return c.class_score * c.views, -c.id
