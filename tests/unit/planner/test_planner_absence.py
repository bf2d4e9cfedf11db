"""Probability that the sought object is not in the home, and the end of the search for it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from helios_core.robot import Pick
from helios_planner.decisions.absence import absence_probability, right_probability
from helios_planner.decisions.decision import CompleteSearch, DecisionRule, Do
from helios_planner.search.object_search import ObjectSearch
from helios_planner.search.unnamed_things import FIRST_ID
from helios_planner.task import Cause, ObjectAbsent, TaskFailed
from hypothesis import given
from hypothesis import strategies as st
from planner_flat import coffee_table, counter, flat, mug
from planner_rig import TABLE_XY, Looks, Rig, instance
from planner_things import Thing
from planner_trouble import bring

MUG = instance(Thing(3, "mug", np.array([*TABLE_XY, 0.5]), np.full(3, 0.1)))
TABLE = instance(Thing(4, "coffee table", np.array([*TABLE_XY, 0.4]), np.full(3, 0.8)))
SCORES = st.lists(st.floats(-1, 1), max_size=6)


@given(SCORES, st.integers(1, 5), st.floats(0, 1))
def test_a_further_candidate_makes_absence_less_likely_and_a_further_search_more(
    scores: list[float], searches: int, start_score: float
) -> None:
    search = CompleteSearch(searches, 50.0, "table", start_score)
    probability = absence_probability(scores, search)
    assert 0 <= probability < 1
    assert absence_probability([*scores, 0.3], search) <= probability
    assert absence_probability(scores, replace(search, number=searches + 1)) >= probability


@given(SCORES, st.floats(0, 1), st.floats(0, 1))
def test_absence_is_likelier_where_the_named_receptacle_was_found(
    scores: list[float], one: float, other: float
) -> None:
    low, high = (
        absence_probability(scores, CompleteSearch(1, 50.0, "table", score))
        for score in sorted((one, other))
    )
    assert low <= high <= absence_probability(scores, CompleteSearch(1, 50.0))


def test_an_object_is_not_absent_because_its_receptacle_was_not_found() -> None:
    assert absence_probability([], CompleteSearch(2, 50.0, "table", 0.1)) < 0.25
    assert absence_probability([], CompleteSearch(1, 50.0, "table", 0.9)) > 0.7
    once, twice = (absence_probability([], CompleteSearch(n, 50.0)) for n in (1, 2))
    assert once < twice


@given(SCORES, st.integers(0, 8))
def test_a_thing_that_was_looked_at_in_the_hand_makes_absence_less_likely(
    scores: list[float], tried: int
) -> None:
    search = CompleteSearch(1, 50.0, "table", 0.9, tried)
    more = replace(search, tried=tried + 1)
    assert absence_probability(scores, more) < absence_probability(scores, search)


@given(SCORES, st.floats(0, 1))
def test_a_thing_that_was_put_back_counts_with_its_probability_in_the_hand(
    scores: list[float], probability: float
) -> None:
    search = CompleteSearch(1, 50.0, "table", 0.9)
    before, after = (
        absence_probability(scores, s) for s in (search, replace(search, set_aside=(probability,)))
    )
    assert after == pytest.approx(before * (1 - probability))


@given(st.floats(-1, 1), st.floats(-1, 1))
def test_a_higher_score_is_right_more_often(one: float, other: float) -> None:
    low, high = sorted((one, other))
    assert 0 <= right_probability(low) <= right_probability(high) <= 1


def test_absence_needs_a_complete_search() -> None:
    with pytest.raises(ValueError, match="wanted 1 or more"):
        absence_probability([], CompleteSearch(0, 50.0))


def searched_rig(score: float, absent_from: float) -> Rig:
    """A search with one candidate, with nothing left to explore."""
    rig = Rig(Looks([]), absent_from=absent_from, start_receptacle_first=False, cs_g=0.1, rounds=1)
    table = replace(TABLE, score=0.9, class_score=0.9)
    rig.known = [replace(MUG, score=score, class_score=0.3), table]
    rig.search.explore = rig.search.clear_way = lambda: False
    return rig


def test_the_search_ends_with_what_was_searched_when_the_object_is_probably_absent() -> None:
    rig = searched_rig(0.02, 0.5)
    said = r"mug is probably not here \(7\d%\).* m², .* once, the likeliest coffee table .*0\.90"
    with pytest.raises(TaskFailed, match=rf"{said}.*0\.02"):
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


def test_a_thing_that_was_put_back_in_this_task_is_brought_before_the_object_counts_as_absent() -> (
    None
):
    rig = searched_rig(0.02, 0.5)
    rig.search.set_aside(replace(MUG, score=0.02, class_score=0.3), 0.6)
    assert rig.search.set_aside_probabilities() == (0.6,)
    with pytest.raises(TaskFailed, match="every frontier and every candidate place"):
        rig.search.find()
    estimates = [d for d in rig.world.decisions if d.rule == DecisionRule.ABSENT]
    assert [d.settings["set_aside"] for d in estimates] == [1]
    assert all(d.do is Do.SEARCH_ON for d in estimates)


def test_things_without_the_name_do_not_take_the_place_of_candidates_in_the_estimate() -> None:
    rig = searched_rig(0.19, 0.5)
    rig.search.pick_unnamed(3)
    rig.search._searched = True
    spot = replace(MUG, id=FIRST_ID, score=0.5)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ObjectSearch, "_untried", lambda _: [spot])
        rig.search.end_if_absent()
    (estimate,) = [d for d in rig.world.decisions if d.rule == DecisionRule.ABSENT]
    assert [c.id for c in estimate.candidates] == [MUG.id]


def test_an_object_that_was_given_up_counts_against_absence_unless_it_was_seen_in_the_hand() -> (
    None
):
    rig = searched_rig(0.6, 0.5)
    rig.search.refused.add(rig.known[0])
    with pytest.raises(TaskFailed, match="every frontier and every candidate place"):
        rig.search.find()
    rig = searched_rig(0.6, 0.5)
    rig.search.refused.add(rig.known[0])
    rig.search.note_seen(rig.known[0])
    with pytest.raises(ObjectAbsent, match="probably not here"):
        rig.search.find()


def test_a_failed_pick_does_not_hide_that_the_object_is_absent() -> None:
    world = flat([coffee_table(), counter(), replace(mug(), slippery=99)])
    absent = "the mug is probably not here (70%): it was searched"

    def end(_: ObjectSearch) -> None:
        raise ObjectAbsent(absent)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ObjectSearch, "end_if_absent", end)
        with pytest.raises(TaskFailed, match=re.escape(absent)) as failure:
            bring(world, rounds=1)
    assert failure.value.cause is Cause.OBJECT_NOT_FOUND
    assert any(isinstance(action, Pick) for action in world.log)
