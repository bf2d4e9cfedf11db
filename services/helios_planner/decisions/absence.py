"""Probability that the sought object is not in the home (not in the paper).

After everything in reach was searched, an object has no right candidate for one of two reasons: it
is absent, or it is there and was missed. Bayes' rule weighs both by how often each happens, and
counts the probability that one of the candidates is right after all, also of those that looked
wrong in the hand and were put back. An object is missed, too, if
the receptacle that it is said to be on was not found, or if the robot held it without recognising
it.

The numbers were chosen on development homes: 600-649 with an absent object, 800-899 with a present
one (`helios_eval.studies.absence_reliability`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from helios_planner.decisions import explanations
from helios_planner.decisions.decision import Candidate, CompleteSearch, Decision, DecisionRule, Do

ABSENT = 0.2  # share of the tasks that ask for an object that is not there
MISSED = (0.08, 0.05)  # chance to miss a present object, after one and after more searches
FOUND_FROM = 0.5  # Ψ from which the start receptacle counts as found
UNRECOGNISED = 0.1  # chance that a thing looked at in the hand was the object all the same
# Chance that a candidate of a score Ψ is right: logistic in Ψ, by a regression over all candidate
# objects of the agent helios in 40 development homes (seeds 300-339), every 20 steps.
MIDDLE, WIDTH = 0.235, 0.086


def right_probability(score: float) -> float:
    """Probability that a candidate of this score Ψ is the sought object."""
    return 1 / (1 + math.exp(-min(max((score - MIDDLE) / WIDTH, -50.0), 50.0)))


def absence_probability(scores: Iterable[float], search: CompleteSearch) -> float:
    """Probability that the object is absent. scores: Ψ of its candidates. Raises ValueError without
    a complete search."""
    if search.number < 1:
        raise ValueError(f"{search.number} complete searches; wanted 1 or more")
    seen = 1 - MISSED[min(search.number, len(MISSED)) - 1]
    if search.start:
        seen *= min(1.0, max(search.start_score, 0.0) / FOUND_FROM)
    missed = 1 - seen * (1 - UNRECOGNISED) ** search.tried
    right = [*(right_probability(score) for score in scores), *search.set_aside]
    none_right = math.prod(1 - p for p in right)
    return none_right * ABSENT / (ABSENT + (1 - ABSENT) * missed)


def decide_absence(
    name: str, candidates: Sequence[Candidate], search: CompleteSearch, absent_from: float
) -> Decision:
    """Decision after a complete search: to end it, if the object is absent with the probability
    `absent_from` or more, or to search on."""
    probability = absence_probability((c.terms["total"] for c in candidates), search)
    ends = probability >= absent_from
    why = explanations.absence(name, candidates, probability, search, absent_from)
    settings = {
        "absence_probability": probability,
        "absent_from": absent_from,
        "searches": float(search.number),
        "start_score": search.start_score,
        "tried": float(search.tried),
        "set_aside": float(len(search.set_aside)),
    }
    do = Do.NOTHING_LEFT if ends else Do.SEARCH_ON
    return Decision(DecisionRule.ABSENT, do, tuple(candidates), None, why, settings)
