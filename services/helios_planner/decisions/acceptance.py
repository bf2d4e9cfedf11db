"""Acceptance of candidates (eq. 7 and 11) and the end of a search.

The paper acts on the first candidate whose score passes one threshold. The patient agent acts at
once only above a higher threshold and searches on otherwise. Its threshold falls when nothing is
left to search and as its share of the steps is used up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from helios_core.types import ObjectInstance

from helios_planner.decisions import explanations
from helios_planner.decisions.decision import (
    ANY_SCORE,
    Act,
    Candidate,
    Decision,
    DecisionRule,
    Do,
    ViewOption,
)
from helios_planner.decisions.held_object import HeldObject

# Acceptance thresholds as shares of τ, from the first to the last.
_OF_OBJECTS = (1.25, 1.0, 0.75, 0.5)
_OF_RECEPTACLES = (1.4, 1.2, 1.0, 0.75, 0.5)
PATIENCE = 0.6  # see AcceptanceThresholds.patience
UNRATED = 0.8  # see AcceptanceThresholds.unrated


@dataclass(frozen=True)
class AcceptanceThreshold:
    """Least score of an accepted candidate. anywhere: True if it may lie elsewhere than on the
    receptacle that the instruction names."""

    score: float
    anywhere: bool


@dataclass(frozen=True)
class AcceptanceThresholds:
    """Acceptance thresholds `steps` of one search, from the highest to the lowest.

    The threshold falls as the search uses the budget that it had left at its start: it reaches the
    lowest threshold when the share `patience` of that budget is used, in equal intervals; with None
    it falls only when nothing is left to search. strict_count: number of thresholds that apply
    before the second search round. by_place: True if scores are multiplied by the relative
    probability that the candidate lies where the instruction says. unrated: factor of the
    thresholds for a class that the image-text scorer does not rate, whose scores stay lower.
    in_known_home: index of the first threshold if a candidate of a stored map reaches it: its home
    has been searched before; None: no difference. at_last: share of the task's budget from which
    the last threshold applies; None: no such share. With `at_last`, `patience` lowers the threshold
    only to the last but one.
    """

    steps: tuple[AcceptanceThreshold, ...]
    strict_count: int
    patience: float | None = None
    by_place: bool = False
    unrated: float = 1.0
    in_known_home: int | None = None
    at_last: float | None = None

    def step(self, index: int, rated: bool) -> AcceptanceThreshold:
        """Threshold that applies to a class. rated: True if the image-text scorer rates it."""
        one = self.steps[index]
        if rated or one.score == ANY_SCORE:
            return one
        return replace(one, score=self.unrated * one.score)

    def least_at(self, used: float, since: float) -> int:
        """Index into `steps` of the threshold that applies now, if nothing lowered it before. used,
        since: used share of the task's budget, now and at the start of the search."""
        usual = len(self.steps) - (self.at_last is not None)
        if self.at_last is not None and used >= self.at_last:
            return usual
        if self.patience is None:
            return 0
        gone = max(used - since, 0.0) / max(self.patience * (1 - since), 1e-9)
        return min(int(gone * usual), usual - 1)


Rule = Callable[
    [float, bool], AcceptanceThresholds
]  # (τ of Table 3, True if the instruction names the place)


def paper(threshold: float, place_known: bool) -> AcceptanceThresholds:
    """The paper's one threshold (τ of Table 3); first only for candidates in the named place, if
    there is one."""
    anywhere = (AcceptanceThreshold(threshold, True),)
    steps = (AcceptanceThreshold(threshold, False), *anywhere) if place_known else anywhere
    return AcceptanceThresholds(steps, len(steps))


def patient(threshold: float, place_known: bool) -> AcceptanceThresholds:
    """Thresholds that fall from above τ to half of it."""
    shares = _OF_OBJECTS if place_known else _OF_RECEPTACLES
    steps = tuple(AcceptanceThreshold(share * threshold, True) for share in shares)
    firm = sum(share >= 1 for share in shares)
    return AcceptanceThresholds(
        steps, firm, PATIENCE, by_place=place_known, unrated=UNRATED, in_known_home=firm - 1
    )


def with_final_fallback(within: AcceptanceThresholds, at_last: float) -> AcceptanceThresholds:
    """The same thresholds and, after that share of the task's steps, any candidate at all.

    The paper leaves open what to do after a search in vain, or when the budget runs out.
    HELIOS then brings the most likely object to the most likely place, and the task's message
    reports it.
    """
    return replace(
        within, steps=(*within.steps, AcceptanceThreshold(ANY_SCORE, True)), at_last=at_last
    )


def act_or_look(
    things: Sequence[ViewOption],
    threshold: float,
    tau_inc: float,
    kind: str,
    what: Act,
    anywhere: bool = True,
) -> Decision:
    """Pick or place decision: act at score >= threshold, else take one more view where
    Psi' >= min(threshold, Psi + tau_inc), else search on (eq. 11 and the text below it). Unless
    `anywhere`, only candidates in the named place count; the record lists all."""
    candidates = tuple(
        Candidate(
            kind,
            t.instance.class_name,
            position_of(t.instance),
            {
                "class_score": t.instance.class_score,
                "uncertainty": t.instance.uncertainty,
                "score": t.score,
                "views": float(t.instance.views),
                "distance_m": t.distance_m,
                "in_place": float(t.in_place),
                "total": t.total,
            }
            | ({} if t.place == 1 else {"place": t.place})
            | ({} if t.in_hand == 1 else {"in_hand": t.in_hand})
            | _image_text(t.instance)
            | ({} if t.best_score is None else {"score_after_view": t.best_score}),
            t.instance.id,
        )
        for t in things
    )
    settings = {"threshold": threshold, "tau_inc": tau_inc, "anywhere": float(anywhere)}
    sure = [  # eq. 7 against tau
        k for k, t in enumerate(things) if t.total >= threshold and (anywhere or t.in_place)
    ]
    if sure:
        k = max(sure, key=lambda k: (things[k].in_place, things[k].total, -things[k].distance_m))
        why = explanations.act(what, candidates[k], threshold, len(sure))
        return Decision(what.rule, Do.ACT, candidates, k, why, settings)
    worth: list[tuple[float, int]] = []
    for k, t in enumerate(things):
        after = t.best_score if anywhere or t.in_place else None
        if after is not None and after * t.factor >= min(threshold, t.total + tau_inc):  # eq. 11
            worth.append((after * t.factor, k))
    if worth:
        _, k = max(worth, key=lambda pair: (pair[0], -pair[1]))
        why = explanations.look(candidates[k], threshold, tau_inc)
        return Decision(what.rule, Do.LOOK, candidates, k, why, settings)
    why = explanations.search_on(what, candidates, threshold, tau_inc, anywhere)
    return Decision(what.rule, Do.SEARCH_ON, candidates, None, why, settings)


def best_view(
    instance: ObjectInstance, scores: Sequence[float], poses: Sequence[tuple[float, float]]
) -> Decision:
    """Decision for the gaze point with the highest expected score (section 3.2)."""
    candidates = tuple(
        Candidate(
            "gaze",
            f"view {k + 1} of {instance.class_name}",
            (*xy, 0.0),
            {"score_after_view": s, "total": s},
            k,
        )
        for k, (s, xy) in enumerate(zip(scores, poses, strict=True))
    )
    k = best_of(candidates)
    why = explanations.best_view(instance.class_name, instance.score, candidates, k)
    return Decision(DecisionRule.BEST_VIEW, Do.LOOK, candidates, k, why)


def try_unnamed(
    name: str, start: str, things: Sequence[ObjectInstance], distances_m: Sequence[float]
) -> Decision:
    """Decision to pick the likeliest unnamed thing on the start receptacle, and to look at it in
    the hand. things: likeliest first, at least one."""
    candidates = tuple(
        Candidate(
            "object",
            name,
            position_of(thing),
            {"score": thing.score, "distance_m": distance_m, "total": thing.score},
            thing.id,
        )
        for thing, distance_m in zip(things, distances_m, strict=True)
    )
    why = explanations.try_unnamed(name, start, candidates)
    return Decision(DecisionRule.UNNAMED, Do.ACT, candidates, 0, why)


def check_in_hand(
    thing: ObjectInstance, held: HeldObject, hand_from: float, kept_why: str = ""
) -> Decision:
    """Decision to keep the picked object or to put it back, by what its sides look like. kept_why:
    reason to keep it all the same."""
    terms = _scores(thing) | {
        "probability": held.probability,
        "sides": float(held.sides),
        "own_share": held.share(thing.class_name),
        "total": held.probability,
    }
    if held.image_text_nats is not None:
        terms["image_text_nats"] = held.image_text_nats
    candidate = Candidate("object", thing.class_name, position_of(thing), terms, thing.id)
    keeps = held.probability >= hand_from or bool(kept_why)
    why = explanations.in_hand(thing.class_name, held, hand_from, kept_why)
    return Decision(
        DecisionRule.IN_HAND,
        Do.ACT if keeps else Do.SEARCH_ON,
        (candidate,),
        0 if keeps else None,
        why,
        {"threshold": hand_from},
    )


def visit_first(things: Sequence[ObjectInstance], distances_m: Sequence[float]) -> Decision:
    """Decision to look at the nearest candidate from its gaze points before its score counts."""
    candidates = tuple(
        Candidate(
            "object",
            thing.class_name,
            position_of(thing),
            _scores(thing) | {"distance_m": distance_m, "total": -distance_m},
            thing.id,
        )
        for thing, distance_m in zip(things, distances_m, strict=True)
    )
    k = best_of(candidates)
    why = explanations.visit_first(candidates, k)
    return Decision(DecisionRule.GAZE_POINTS_FIRST, Do.LOOK, candidates, k, why)


def give_up(what: Act, thing: ObjectInstance, kind: str, reason: str) -> Decision:
    """Decision to leave a chosen candidate, before or after an attempt. thing: the candidate as
    it was chosen."""
    left = Candidate(kind, thing.class_name, position_of(thing), _scores(thing), thing.id)
    why = explanations.give_up(what, thing.class_name, reason)
    return Decision(DecisionRule.GIVEN_UP, Do.SEARCH_ON, (left,), None, why)


def _scores(thing: ObjectInstance) -> dict[str, float]:
    return {
        "class_score": thing.class_score,
        "uncertainty": thing.uncertainty,
        "score": thing.score,
        "views": float(thing.views),
    }


def _image_text(instance: ObjectInstance) -> dict[str, float]:
    nats = instance.image_text_nats
    return {} if nats is None else {"image_text_nats": nats}


def best_of(candidates: Sequence[Candidate]) -> int:
    """Index of the highest total; on a tie the nearer, then the first, so that a replay agrees."""
    return max(
        range(len(candidates)),
        key=lambda k: (
            candidates[k].terms["total"],
            -candidates[k].terms.get("distance_m", 0.0),
            -k,
        ),
    )


def position_of(instance: ObjectInstance) -> tuple[float, float, float]:
    """Centre of an instance: world x, y, z (m)."""
    x, y, z = (float(v) for v in instance.center_m)
    return x, y, z
