"""Probability that the sought object is not in the home, and the end of the search for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helios_planner.decisions.absence import absence_probability, right_probability
from helios_planner.decisions.decision import DecisionRule, Do
from helios_planner.task import Cause, TaskFailed
from hypothesis import given
from hypothesis import strategies as st
from planner_rig import TABLE_XY, Looks, Rig, instance
from planner_things import Thing

MUG = instance(Thing(3, "mug", np.array([*TABLE_XY, 0.5]), np.full(3, 0.1)))
SCORES = st.lists(st.floats(-1, 1), max_size=6)


@given(SCORES, st.integers(1, 5))
def test_a_further_candidate_makes_absence_less_likely_and_a_further_search_more(
    scores: list[float], searches: int
) -> None:
    probability = absence_probability(scores, searches)
    assert 0 <= probability < 1
    assert absence_probability([*scores, 0.3], searches) <= probability
    assert absence_probability(scores, searches + 1) >= probability


@given(st.floats(-1, 1), st.floats(-1, 1))
def test_a_higher_score_is_right_more_often(one: float, other: float) -> None:
    low, high = sorted((one, other))
    assert 0 <= right_probability(low) <= right_probability(high) <= 1


def test_absence_needs_a_complete_search() -> None:
    with pytest.raises(ValueError, match="wanted 1 or more"):
        absence_probability([], 0)


def searched_rig(score: float, absent_from: float) -> Rig:
    """A search with one candidate, with nothing left to explore."""
    rig = Rig(Looks([]), absent_from=absent_from, start_receptacle_first=False, cs_g=0.1, rounds=1)
    rig.known = [replace(MUG, score=score, class_score=0.3)]
    rig.search.explore = rig.search.clear_way = lambda: False
    return rig


def test_the_search_ends_with_what_was_searched_when_the_object_is_probably_absent() -> None:
    rig = searched_rig(0.02, 0.5)
    with pytest.raises(TaskFailed, match=r"mug is probably not here \(5\d%\).* m², .* once.*0\.02"):
        rig.search.find()
    last = rig.world.decisions[-1]
    assert (last.rule, last.do) == (DecisionRule.ABSENT, Do.NOTHING_LEFT)


@pytest.mark.parametrize(("score", "absent_from"), [(0.4, 0.5), (0.02, 0.9), (0.02, 1.0)])
def test_it_goes_on_to_its_usual_end_otherwise(score: float, absent_from: float) -> None:
    rig = searched_rig(score, absent_from)
    with pytest.raises(TaskFailed, match="every frontier and every candidate place") as failure:
        rig.search.find()
    assert failure.value.cause is Cause.OBJECT_NOT_FOUND
    estimates = [d for d in rig.world.decisions if d.rule == DecisionRule.ABSENT]
    assert len(estimates) == (absent_from < 1)
    for d in estimates:
        assert d.do is Do.SEARCH_ON
        assert (
            f"absent only with probability 0.{d.settings['absence_probability'] * 100:02.0f}"
            in d.why
        )
        assert d.settings["absence_probability"] < d.settings["absent_from"]
