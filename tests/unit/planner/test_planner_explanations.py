"""Comparisons in explanations hold for the numbers as they are printed."""

from __future__ import annotations

import math
import re

from helios_planner.decisions.decision import Act, Candidate
from helios_planner.decisions.explanations import act, less, look, search_on
from hypothesis import assume, example, given
from hypothesis import strategies as st

NUMBER = r"(\d+\.\d+)(?: × place \d+\.\d+ = (\d+\.\d+))?"
scores = st.floats(0.0, 1.0)
nearly = st.floats(-0.02, 0.02)
places = st.none() | st.floats(0.05, 1.0)


def mug_candidate(score: float, after: float | None, place: float | None) -> Candidate:
    factor = 1.0 if place is None else place
    terms = {
        "score": score,
        "class_score": 0.6,
        "uncertainty": 0.1,
        "views": 3.0,
        "in_place": 1.0,
        "total": score * factor,
    }
    terms |= {} if after is None else {"score_after_view": after}
    terms |= {} if place is None else {"place": place}
    return Candidate("object", "mug", (0.0, 0.0, 0.0), terms, 1)


def printed(sentence: str, before: str) -> float:
    """Return the number, or the product, that follows these words."""
    found = re.search(re.escape(before) + NUMBER, sentence)
    assert found is not None, sentence
    return float(found[2] or found[1])


@given(scores, nearly, scores, places)
@example(0.4996, 0.0004, 0.6, None)
def test_the_printed_numbers_of_a_look_are_below_the_threshold_and_worth_a_view(
    score: float, below: float, after: float, place: float | None
) -> None:
    factor = 1.0 if place is None else place
    threshold = score * factor + abs(below)
    worth = min(threshold, score * factor + 0.05)
    assume(threshold - score * factor > 1e-9)
    assume(after * factor - worth > 1e-9)
    said = look(mug_candidate(score, after, place), threshold, 0.05)
    assert printed(said, "score ") < printed(said, " < "), said
    assert printed(said, "bring it to ") >= printed(said, "worth it from "), said


def test_an_accepted_candidate_tells_what_image_text_scores_did_to_its_odds() -> None:
    mug = mug_candidate(0.5, None, None)
    assert "image-text" not in act(Act.PICK, mug, 0.3, 1)
    mug.terms["image_text_nats"] = math.log(3)
    assert "odds × 3 by image-text scores" in act(Act.PICK, mug, 0.3, 1)


@given(scores, nearly, st.none() | scores, places)
@example(0.4999, 0.0001, None, None)
def test_the_printed_numbers_of_searching_on_are_below_their_limits(
    score: float, below: float, after: float | None, place: float | None
) -> None:
    factor = 1.0 if place is None else place
    threshold = score * factor + abs(below)
    need = min(threshold, score * factor + 0.05)
    assume(threshold - score * factor > 1e-9)
    assume(after is None or need - after * factor > 1e-9)
    said = search_on(Act.PICK, [mug_candidate(score, after, place)], threshold, 0.05, True)
    assert printed(said, "score ") < printed(said, " < "), said
    if after is not None:
        assert printed(said, "bring only ") < printed(said, "worth it from "), said


@given(scores, nearly, places)
@example(1 / 3, 0.0, 0.5)
def test_the_printed_score_of_an_accepted_candidate_passes_the_threshold(
    score: float, above: float, place: float | None
) -> None:
    threshold = max(score * (1.0 if place is None else place) - abs(above), 0.0)
    said = act(Act.PICK, mug_candidate(score, None, place), threshold, 1)
    assert printed(said, "score ") >= printed(said, " ≥ "), said


@given(scores, scores)
def test_less_prints_a_lower_number_before_a_higher_one(one: float, other: float) -> None:
    low, high = sorted((one, other))
    assume(high - low > 1e-12)
    left, right = less(low, high).split(" < ")
    assert float(left) < float(right)
    assert math.isclose(float(left), low, abs_tol=0.006)


def test_numbers_that_differ_enough_have_two_decimals() -> None:
    assert less(0.42, 0.5) == "0.42 < 0.50"
    assert less(0.4996, 0.5) == "0.4996 < 0.5000"
