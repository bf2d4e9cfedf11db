"""Phrases, token spans and one class per box: text-prompted detection without a model."""

import numpy as np
import pytest
from helios_core.types import Role, SearchClass, SearchContext
from helios_detector.detection_filtering import one_class_each
from helios_detector.hf.text_prompts import phrases_of
from helios_detector.hf.zero_shot_detection import corners, joined, token_spans
from hypothesis import given
from hypothesis import strategies as st


def context(*classes: SearchClass) -> SearchContext:
    return SearchContext("c", classes)


def test_a_class_gives_phrases_for_its_name_and_its_synonyms():
    phrases = phrases_of(
        context(
            SearchClass("Mug", Role.OBJECT, 0.25, ("coffee cup", "tea-cup")),
            SearchClass("table", Role.START_RECEPTACLE, 0.35),
        )
    )
    assert phrases.texts == ("mug", "table", "coffee cup", "tea cup")
    assert phrases.owner.tolist() == [0, 1, 0, 0]
    assert phrases.thresholds.tolist() == pytest.approx([0.25, 0.35])


def test_a_synonym_never_takes_the_name_of_another_class():
    phrases = phrases_of(
        context(
            SearchClass("mug", Role.OBJECT, 0.2, ("cup",)),
            SearchClass("cup", Role.WATCH, 0.2),
        )
    )
    assert dict(zip(phrases.texts, phrases.owner.tolist(), strict=True)) == {"mug": 0, "cup": 1}


def test_landmarks_already_in_the_context_are_not_added_twice():
    phrases = phrases_of(
        context(SearchClass("sofa", Role.WATCH, 0.2)), ("couch", "bed", "bed", "sink")
    )
    assert phrases.landmarks == ("bed", "sink") or set(phrases.landmarks) == {"bed", "sink"}
    assert phrases.texts == ("sofa", "bed", "sink")


def test_phrase_separators_are_removed_from_a_phrase():
    phrases = phrases_of(context(SearchClass("no. 5, perfume", Role.OBJECT, 0.2)))
    assert phrases.texts == ("no 5 perfume",)


def test_a_box_gets_the_best_class_whose_threshold_it_passes():
    boxes = np.array([[0, 0, 10, 10], [50, 50, 60, 60]], np.float32)
    scores = np.array([[0.5, 0.4], [0.3, 0.2]], np.float32)
    # The first box passes only the second class, the second box none.
    assert one_class_each(boxes, scores, np.array([0.6, 0.35], np.float32)) == [(0, 1)]


def test_overlapping_boxes_of_one_class_become_one_detection():
    boxes = np.array([[0, 0, 10, 10], [1, 0, 10, 10], [30, 30, 40, 40]], np.float32)
    scores = np.array([[0.5], [0.7], [0.6]], np.float32)
    assert one_class_each(boxes, scores, np.array([0.2], np.float32)) == [(1, 0), (2, 0)]


@given(st.lists(st.floats(0, 1, width=32), min_size=1, max_size=12), st.floats(0.0625, 1, width=32))
def test_no_detection_is_below_its_threshold(values: list[float], threshold: float):
    scores = np.array(values, np.float32)[:, None]
    corner = 100 * np.arange(len(values), dtype=np.float32)
    boxes = np.stack([corner, corner, corner + 9, corner + 9], 1)
    kept = one_class_each(boxes, scores, np.array([threshold], np.float32))
    assert sorted(i for i, _ in kept) == np.flatnonzero(scores[:, 0] >= threshold).tolist()


def test_token_spans_assign_each_token_to_its_phrase():
    phrases = ("mug", "coffee table")
    assert joined(phrases) == "mug. coffee table."
    offsets = [(0, 0), (0, 3), (3, 4), (5, 8), (8, 11), (12, 17), (17, 18), (0, 0)]
    assert token_spans(offsets, phrases) == [[1], [3, 4, 5]]


def test_corners_converts_a_centred_box_to_pixel_corners():
    box = np.array([[0.5, 0.5, 0.5, 1.0]], np.float32)
    np.testing.assert_allclose(corners(box, 200, 100), [[50, 0, 150, 100]])
