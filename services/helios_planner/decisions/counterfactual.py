"""A stored decision recomputed under other settings: "would it have gone there with alpha_d 0.01?"

It is a pure function of the stored record and calls the same functions that decided. The class
score thresholds (cs_a, cs_g, cs_b) are stored with a decision. A higher one drops candidates. A
lower one would admit candidates that are not stored, so the result is then not certain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.types import ObjectInstance

from helios_planner.decisions.acceptance import act_or_look
from helios_planner.decisions.decision import (
    ANY_SCORE,
    Act,
    Candidate,
    Decision,
    DecisionRule,
    Do,
    FrontierOption,
    ReceptacleOption,
    ViewOption,
)
from helios_planner.decisions.gain import Gain, normalised_gain
from helios_planner.decisions.global_search import (
    as_memory,
    by_objective,
    receptacles_first,
)
from helios_planner.settings import GainNorm, Settings

# Settings that a rule reads: its own name of each -> the setting's name.
_GLOBAL = {"alpha_d": "alpha_d", "class_threshold": "cs_a"}
_PICK = {"threshold": "tau_g", "tau_inc": "tau_inc", "class_threshold": "cs_g"}
_PLACE = {"threshold": "tau_b", "tau_inc": "tau_inc", "class_threshold": "cs_b"}
_READS: dict[str, dict[str, str]] = {
    DecisionRule.BY_OBJECTIVE: _GLOBAL,
    DecisionRule.RECEPTACLES_FIRST: _GLOBAL,
    DecisionRule.PICK: _PICK,
    DecisionRule.STOP: _PICK,
    DecisionRule.PLACE: _PLACE,
}
# Settings that the candidates of a rule depend on, but that it does not store.
_UNSTORED: dict[str, set[str]] = {
    DecisionRule.GAZE_POINTS_FIRST: {"cs_g", "tau_g"},
    DecisionRule.ABSENT: {"cs_g"},
}
_ACTS: dict[str, Act] = {act.rule: act for act in Act}
_TAU = "tau"  # τ of Table 3, as a stored decision names it
MOST = 1e6  # upper limit of every setting in a request
SETTINGS = ("alpha_d", "tau_g", "tau_b", "tau_inc", "cs_a", "cs_g", "cs_b")


@dataclass(frozen=True)
class Recomputed:
    """A recomputed decision. flips: True if it chooses another candidate or action. certain: False
    if it depends on values that were not queried at the time."""

    decision: Decision
    flips: bool
    certain: bool


def changes_of(texts: Mapping[str, str]) -> dict[str, float]:
    """Values of settings from their text, "alpha_d" -> "0.01". Raises InvalidInput."""
    changes = {}
    for name, text in texts.items():
        if name not in SETTINGS:
            raise InvalidInput(
                f"decisions cannot be recomputed under another {name!r}; choose among "
                f"{', '.join(SETTINGS)}"
            )
        try:
            changes[name] = float(text)
        except ValueError:
            changes[name] = math.nan
        if not 0 <= changes[name] <= MOST:
            raise InvalidInput(f"{name} is {text!r:.80}; wanted a number from 0 to {MOST:.0f}")
    return changes


def with_replay_settings(decision: Decision, settings: Settings) -> Decision:
    """The decision with the values needed to recompute it: the class score threshold of its
    candidates, and the τ of which its threshold is a share."""
    reads = _read_by(decision) or {}
    more = {
        name: float(getattr(settings, reads[own]))
        for name, own in (("class_threshold", "class_threshold"), (_TAU, "threshold"))
        if own in reads
    }
    return replace(decision, settings=decision.settings | more)


def _read_by(decision: Decision) -> dict[str, str] | None:
    """Settings that the decision's rule reads; None for a rule without settings. A task "go to
    the sofa" stops at a receptacle, which has the thresholds of receptacles."""
    at_receptacle = any(c.kind == "receptacle" for c in decision.candidates)
    if decision.rule == DecisionRule.STOP and at_receptacle:
        return _PLACE
    return _READS.get(decision.rule)


def _own_value(decision: Decision, own: str, value: float) -> float:
    """Value of a setting as a rule uses it. A patient agent's threshold is a share of τ, above 1 at
    first and below 1 later; the share stays."""
    then, tau = decision.settings.get(own, value), decision.settings.get(_TAU, 0.0)
    if own != "threshold" or tau <= 0 or then == tau:
        return value
    return then if value == tau else value * then / tau


def recompute(decision: Decision, changes: Mapping[str, float]) -> Recomputed:
    """The decision under its own settings, except for `changes` (name of a setting -> value)."""
    reads = _read_by(decision)
    if reads is None:  # rules without settings: trusted detector, frontier by value, best view
        known = not changes.keys() & _UNSTORED.get(decision.rule, set())
        return Recomputed(decision, flips=False, certain=known)
    used = decision.settings | {
        own: _own_value(decision, own, changes[setting])
        for own, setting in reads.items()
        if setting in changes and not (own == "threshold" and decision.settings[own] == ANY_SCORE)
    }
    before, after = decision.settings.get("class_threshold"), used.get("class_threshold")
    lowered = after is not None and after != before and (before is None or after < before)
    unseen = any(  # eq. 8 would have first seen it at another time
        c.kind == "first_seen" and c.terms["class_score"] < (after or 0.0) for c in decision.memory
    )
    kept = tuple(
        c
        for c in decision.candidates
        if after is None or c.terms.get("class_score", math.inf) >= after
    )
    if reads is _GLOBAL:
        certain = not (unseen or _depends_on_agent(decision, kept))
        again = _global(decision, kept, used)
    else:
        again, certain = _act_or_look(decision, kept, used)
    again = replace(again, settings=used | again.settings)
    return Recomputed(again, flips(decision, again), certain and not lowered)


def under_gain_norm(decision: Decision, norm: GainNorm) -> Decision | None:
    """A decision of the global search with its gains in other units; None if they are not stored.

    Also None if the object map has not reported what the norm divides by.
    """
    gains = {c.id: Gain.of_terms(c.terms) for c in decision.memory if c.kind == "gain"}
    try:
        candidates = tuple(
            _in_units(c, gains.get(c.id), norm) if c.kind == "receptacle" else c
            for c in decision.candidates
        )
        memory = tuple(
            _in_units(c, Gain.of_terms(c.terms), norm) if c.kind == "first_seen" else c
            for c in decision.memory
        )
    except InvalidInput:
        return None
    again = _global(replace(decision, memory=memory), candidates, decision.settings)
    return replace(again, memory=memory, settings=decision.settings | again.settings)


def _in_units(candidate: Candidate, gain: Gain | None, norm: GainNorm) -> Candidate:
    if gain is None:
        raise InvalidInput(f"the gain of {candidate.kind} {candidate.id} is not stored")
    terms = candidate.terms | {"information_gain": normalised_gain(gain, norm)}
    return replace(candidate, terms=terms)


def flips(before: Decision, after: Decision) -> bool:
    """True if the decisions choose another candidate or action."""

    def what(d: Decision) -> tuple[Do, object]:
        return d.do, None if d.winner is None else (d.chosen.kind, d.chosen.id)

    return what(before) != what(after)


def _global(
    decision: Decision, candidates: Sequence[Candidate], used: Mapping[str, float]
) -> Decision:
    receptacles = [
        ReceptacleOption(
            _instance(c),
            c.terms["class_score"],
            c.terms["information_gain"],
            c.terms["distance_m"],
        )
        for c in candidates
        if c.kind == "receptacle"
    ]
    frontiers = [
        FrontierOption(c.id, c.position_m[:2], c.terms["value"], c.terms["distance_m"])
        for c in candidates
        if c.kind == "frontier"
    ]
    rule = by_objective if decision.rule == DecisionRule.BY_OBJECTIVE else receptacles_first
    return rule(receptacles, frontiers, as_memory(decision.memory), used["alpha_d"])


def _depends_on_agent(decision: Decision, kept: Sequence[Candidate]) -> bool:
    """True if all receptacles are dropped where two agents then choose differently among frontiers:
    one by eq. 10, one by the lengths of paths, which are not stored."""
    only_frontiers = all(c.kind == "frontier" for c in kept)
    return decision.rule == DecisionRule.RECEPTACLES_FIRST and only_frontiers and len(kept) > 1


def _act_or_look(
    decision: Decision, candidates: Sequence[Candidate], used: Mapping[str, float]
) -> tuple[Decision, bool]:
    """The decision, and True if it is certain. The score after one more view was queried only where
    the score was below the threshold of that time."""
    things = [
        ViewOption(
            _instance(c),
            c.terms["score"],
            c.terms.get("score_after_view"),
            c.terms["distance_m"],
            bool(c.terms["in_place"]),
            c.terms.get("place", 1.0),
            c.terms.get("in_hand", 1.0),
        )
        for c in candidates
    ]
    threshold, anywhere = used["threshold"], bool(used["anywhere"])
    kind = candidates[0].kind if candidates else "object"
    what = _ACTS[decision.rule]
    again = act_or_look(things, threshold, used["tau_inc"], kind, what, anywhere)
    unasked = any(
        decision.settings["threshold"] <= t.total < threshold and (anywhere or t.in_place)
        for t in things
    )
    if again.do is Do.ACT or not unasked:
        return again, True
    why = (
        f"not {what} yet: no score reaches {threshold:.2f}, and what one more view would bring was "
        "not asked for then"
    )
    return replace(again, why=why), False


def _instance(c: Candidate) -> ObjectInstance:
    """Instance with the fields that a decision reads."""
    return ObjectInstance(
        id=c.id, class_name=c.name, center_m=np.array(c.position_m), size_m=np.zeros(3),
        score=c.terms.get("score", 0.0), class_score=c.terms["class_score"],
        uncertainty=c.terms.get("uncertainty", 0.0), views=int(c.terms.get("views", 0)),
        gaussians=0, probabilities={}, top_m=c.position_m[2], outline_m=np.empty((0, 2)),
    )  # fmt: skip
