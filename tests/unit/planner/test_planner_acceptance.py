"""Acceptance thresholds: their steps, and when an agent lowers them."""

from __future__ import annotations

import pytest
from helios_planner.decisions.acceptance import (
    PATIENCE,
    AcceptanceThreshold,
    Rule,
    paper,
    patient,
    with_final_fallback,
)
from helios_planner.decisions.decision import ANY_SCORE
from hypothesis import given
from hypothesis import strategies as st

shares = st.floats(0, 1)
thresholds = st.floats(0.05, 1)


@given(thresholds, shares, shares)
def test_the_paper_rule_has_one_threshold_for_the_whole_task(tau: float, used: float, since: float):
    for place_known in (False, True):
        standards = paper(tau, place_known)
        assert {s.score for s in standards.steps} == {tau}
        assert standards.least_at(used, since) == 0


def test_candidates_elsewhere_are_accepted_last_if_the_place_is_known():
    assert paper(0.5, True).steps == (
        AcceptanceThreshold(0.5, False),
        AcceptanceThreshold(0.5, True),
    )
    assert paper(0.5, False).steps == (AcceptanceThreshold(0.5, True),)
    anywhere = [s.anywhere for s in patient(0.5, True).steps]
    assert anywhere == sorted(anywhere)
    assert anywhere[-1]


@given(thresholds, st.booleans())
def test_a_patient_agent_begins_above_the_threshold_and_ends_below_it(tau: float, known: bool):
    scores = [s.score for s in patient(tau, known).steps]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] > tau > scores[-1] > 0


@given(st.floats(0, 0.9), st.lists(shares, min_size=2, max_size=10), st.booleans())
def test_a_patient_agent_only_ever_lowers_its_threshold(
    since: float, later: list[float], known: bool
):
    standards = patient(0.3, known)
    steps = [standards.least_at(since + (1 - since) * x, since) for x in sorted(later)]
    assert steps == sorted(steps)
    assert steps[0] >= 0
    assert steps[-1] < len(standards.steps)


@pytest.mark.parametrize("since", [0.0, 0.3, 0.9, 1.0])
def test_a_patient_agent_is_at_its_lowest_threshold_once_its_patience_is_used_up(since: float):
    standards = patient(0.3, True)
    assert standards.least_at(since, since) == 0
    end = since + PATIENCE * (1 - since) + 1e-6
    assert standards.least_at(end, since) == len(standards.steps) - 1


@given(st.sampled_from([paper, patient]), thresholds, shares, shares, shares, st.booleans())
def test_thresholds_hold_until_the_final_fallback_accepts_any_candidate(
    rule: Rule, tau: float, used: float, since: float, at_last: float, known: bool
) -> None:
    usual = rule(tau, known)
    to_the_end = with_final_fallback(usual, at_last)
    now = to_the_end.steps[to_the_end.least_at(used, since)]
    if used < at_last:
        assert now == usual.steps[usual.least_at(used, since)]
    else:
        assert now == AcceptanceThreshold(ANY_SCORE, True)
