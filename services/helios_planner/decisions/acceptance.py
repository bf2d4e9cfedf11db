"""When a candidate is good enough to act on (eq. 7 and 11), and when the search ends.

The paper acts on the first candidate whose score passes one threshold. The patient agent acts at
once only above a higher one, keeps searching otherwise, and takes the best candidate when nothing
is left to search or when its share of the steps is used up.
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

# Shares of the threshold: at first, and down to what is taken when patience ends.
_OF_OBJECTS = (1.25, 1.0, 0.75, 0.5)
_OF_RECEPTACLES = (1.4, 1.2, 1.0, 0.75, 0.5)
PATIENCE = 0.6  # share of the steps that are left when the search begins


@dataclass(frozen=True)
class AcceptanceThreshold:
    """What a candidate must meet. anywhere: wherever it is, not only where it was said to be."""

    score: float
    anywhere: bool


@dataclass(frozen=True)
class AcceptanceThresholds:
    """From the highest down. firm: how many of them hold until everything was searched twice.
    patience: share of the steps that are left when the search begins, after which the lowest holds,
    the others at even distances before; None: steps do not count. by_place: a candidate's score
    counts times how likely it is where it was said to be. at_last: share of the task's steps after
    which the last one holds, which patience leaves out."""

    steps: tuple[AcceptanceThreshold, ...]
    firm: int
    patience: float | None = None
    by_place: bool = False
    at_last: float | None = None

    def least_at(self, used: float, since: float) -> int:
        """How far down to be by now. used, since: share of the task's steps, now and when the
        search began."""
        usual = len(self.steps) - (self.at_last is not None)
        if self.at_last is not None and used >= self.at_last:
            return usual
        if self.patience is None:
            return 0
        gone = max(used - since, 0.0) / max(self.patience * (1 - since), 1e-9)
        return min(int(gone * usual), usual - 1)


Rule = Callable[
    [float, bool], AcceptanceThresholds
]  # threshold of Table 3, whether its place is known


def paper(threshold: float, place_known: bool) -> AcceptanceThresholds:
    """One threshold (τ of Table 3); at first only in its place, where that is known."""
    anywhere = (AcceptanceThreshold(threshold, True),)
    steps = (AcceptanceThreshold(threshold, False), *anywhere) if place_known else anywhere
    return AcceptanceThresholds(steps, len(steps))


def patient(threshold: float, place_known: bool) -> AcceptanceThresholds:
    """Sure, then the threshold, then the best there is."""
    shares = _OF_OBJECTS if place_known else _OF_RECEPTACLES
    steps = tuple(AcceptanceThreshold(share * threshold, True) for share in shares)
    firm = sum(share >= 1 for share in shares)
    return AcceptanceThresholds(steps, firm, PATIENCE, by_place=place_known)


def in_the_end(within: AcceptanceThresholds, at_last: float) -> AcceptanceThresholds:
    """The same, and after that share of the task's steps anything that may be it at all.

    The paper is silent on what to do when everything has been searched in vain, or the steps run
    out: the likeliest thing is brought, to the likeliest place, and that is said.
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
    """Pick and place decisions: act at score >= threshold, else one more view where
    Psi' >= min(threshold, Psi + tau_inc), else search on (eq. 11 and the text below it). Unless
    `anywhere`, only what is in its place counts; the rest is remembered."""
    candidates = tuple(
        Candidate(
            kind, t.instance.class_name, position_of(t.instance),
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
            | ({} if t.best_score is None else {"score_after_view": t.best_score}),
            t.instance.id,
        )
        for t in things
    )  # fmt: skip
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
        if after is not None and after * t.place >= min(threshold, t.total + tau_inc):  # eq. 11
            worth.append((after * t.place, k))
    if worth:
        _, k = max(worth, key=lambda pair: (pair[0], -pair[1]))
        why = explanations.look(candidates[k], threshold, tau_inc)
        return Decision(what.rule, Do.LOOK, candidates, k, why, settings)
    why = explanations.search_on(what, candidates, threshold, tau_inc, anywhere)
    return Decision(what.rule, Do.SEARCH_ON, candidates, None, why, settings)


def best_view(
    instance: ObjectInstance, scores: Sequence[float], poses: Sequence[tuple[float, float]]
) -> Decision:
    """The gaze point from which the score would be highest (section 3.2)."""
    candidates = tuple(
        Candidate("gaze", f"view {k + 1} of {instance.class_name}", (*xy, 0.0),
                  {"score_after_view": s, "total": s}, k)
        for k, (s, xy) in enumerate(zip(scores, poses, strict=True))
    )  # fmt: skip
    k = best_of(candidates)
    why = explanations.best_view(instance.class_name, instance.score, candidates, k)
    return Decision(DecisionRule.BEST_VIEW, Do.LOOK, candidates, k, why)


def give_up(what: Act, thing: ObjectInstance, kind: str, reason: str) -> Decision:
    """What was chosen is not acted on after all, or was in vain. thing: as it was chosen."""
    terms = {
        "class_score": thing.class_score, "uncertainty": thing.uncertainty,
        "score": thing.score, "views": float(thing.views),
    }  # fmt: skip
    left = Candidate(kind, thing.class_name, position_of(thing), terms, thing.id)
    why = explanations.give_up(what, thing.class_name, reason)
    return Decision(DecisionRule.GIVEN_UP, Do.SEARCH_ON, (left,), None, why)


def best_of(candidates: Sequence[Candidate]) -> int:
    """Highest total; the nearer on a tie, then the first, so that replays decide alike."""
    return max(
        range(len(candidates)),
        key=lambda k: (
            candidates[k].terms["total"], -candidates[k].terms.get("distance_m", 0.0), -k,
        ),
    )  # fmt: skip


def position_of(instance: ObjectInstance) -> tuple[float, float, float]:
    """Its centre: x, y, z in the world, m."""
    x, y, z = (float(v) for v in instance.center_m)
    return x, y, z
