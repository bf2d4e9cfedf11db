"""Tests that any text of a video stays within its area."""

import numpy as np
import pytest
from eval_constructed_scene import constructed_decision
from helios_eval.video.decision_panel import columns_of, number, rows_of
from helios_eval.video.drawing import (
    MOST_LETTERS,
    WHITE,
    Sheet,
    clean,
    cut,
    pill_size,
    width_of,
    wrapped,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st

hostile = "‮\x00\x1b[31m\n<b>é́́́" + "W" * 900 + "\u0301" * 40 + "漢字🤖"


@settings(deadline=None)
@given(st.text(max_size=300), st.integers(0, 400), st.integers(9, 22), st.booleans())
@example(hostile, 200, 14, True)
def test_a_cut_text_fits(text, most_px, size, bold):
    shown = cut(text, most_px, size, bold)
    assert width_of(shown, size, bold) <= most_px


@settings(deadline=None)
@given(st.text(max_size=300), st.integers(40, 400), st.integers(1, 5))
@example(hostile, 200, 3)
@example("word " * 200, 200, 3)
def test_a_wrapped_text_fits_in_its_lines(text, most_px, lines):
    shown = wrapped(text, most_px, 13, lines)
    assert len(shown) <= lines
    assert all(width_of(line, 13) <= most_px for line in shown)


def test_a_short_text_is_unchanged_and_a_cut_text_ends_with_an_ellipsis():
    assert cut("kitchen counter", 500, 14) == "kitchen counter"
    assert cut("kitchen counter", 60, 14).endswith("…")
    assert wrapped("look again at the mug", 500, 13, 3) == ["look again at the mug"]
    assert wrapped("one two three four five six", 60, 13, 2)[-1].endswith("…")


@settings(deadline=None)
@given(st.text())
@example(hostile)
def test_cleaned_text_is_one_line_without_control_characters(text):
    shown = clean(text)
    assert len(shown) <= MOST_LETTERS
    assert shown == " ".join(shown.split())
    assert not any(c in shown for c in "\n\r\t\x00\x1b‮‏\u0301")


@settings(max_examples=40, deadline=None)
@given(st.text(max_size=60), st.sampled_from(["l", "m", "r"]))
@example(hostile, "l")
def test_text_draws_no_pixel_outside_its_width(text, align):
    sheet = Sheet.blank(200, 40, WHITE)
    x = {"l": 50, "m": 100, "r": 150}[align]
    sheet.text(x, 20, text, 100, 14, align=align)
    drawn = np.flatnonzero((sheet.pixels != 255).any(axis=(0, 2)))
    assert not len(drawn) or (drawn.min() >= 47 and drawn.max() <= 153)  # overhang of slanted ends


@settings(deadline=None)
@given(st.text(max_size=100), st.integers(30, 200))
@example(hostile, 120)
def test_a_pill_is_at_most_as_wide_as_requested(text, most_px):
    sheet = Sheet.blank(300, 40, WHITE)
    assert sheet.pill(10, 20, text, most_px) <= most_px
    assert pill_size("mug", 12)[0] > width_of("mug", 12)


@settings(deadline=None)
@given(st.floats())
@example(-99_994.0)
@example(1e-300)
@example(-1e300)
def test_a_number_has_at_most_six_characters(value):
    assert 1 <= len(number(value)) <= 6


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.4567, "0.46"), (0.0312, "0.031"), (-0.5, "−0.50"), (3.0, "3"), (12.34, "12.3"),
        (123.4, "123"), (1e9, "1e9"), (float("nan"), "–"), (float("inf"), "∞"), (0.0, "0"),
    ],
)  # fmt: skip
def test_numbers_are_formatted_with_suitable_precision(value, text):
    assert number(value) == text


def test_the_chosen_candidate_is_always_shown():
    decision = constructed_decision(40)
    for c in decision.candidates:
        c.chosen = False
    worst = min(decision.candidates, key=lambda c: c.terms["total"])
    worst.chosen = True
    shown = rows_of(decision.candidates, 5)
    assert len(shown) == 5
    assert any(c.chosen for c in shown)
    totals = [c.terms["total"] for c in shown]
    assert totals == sorted(totals, reverse=True)


def test_columns_show_the_terms_that_differ_and_decide():
    candidates = constructed_decision().candidates
    assert columns_of(candidates)[-1] == "total"
    candidates[0].terms["frontier_scale"] = 1.4
    assert "frontier_scale" in columns_of(candidates[:1])
    assert "frontier_scale" not in columns_of(candidates, {"frontier_scale": 1.4})
    for c in candidates:
        for k in range(20):
            c.terms[f"x{k}"] = 1.0
    assert len(columns_of(candidates)) == 5
    for c in candidates:
        c.terms["score"] = c.terms["total"]
    assert "total" not in columns_of(candidates)  # Ψ is the same


def test_rows_are_ordered_despite_a_nan_total():
    decision = constructed_decision(6)
    decision.candidates[0].terms["total"] = float("nan")
    assert len(rows_of(decision.candidates, 10)) == 6
