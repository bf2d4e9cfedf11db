"""Untrusted text is made safe to show."""

from __future__ import annotations

import unicodedata

import pytest
from helios_core.printable_text import counted, printable
from hypothesis import given
from hypothesis import strategies as st


def test_an_escape_sequence_loses_its_escape() -> None:
    assert printable("find the \x1b[31mcup\x9b2J\x00\x7f") == "find the �[31mcup�2J��"


def test_line_breaks_and_tabs_become_spaces() -> None:
    assert printable("one\ntwo\r\nthree\tfour") == "one two  three four"


@given(st.text())
def test_no_control_character_is_left_and_no_other_is_changed(text: str) -> None:
    shown = printable(text)
    assert len(shown) == len(text)
    for was, now in zip(text, shown, strict=True):
        assert unicodedata.category(now) != "Cc"
        assert now == was or unicodedata.category(was) == "Cc"


@pytest.mark.parametrize(("number", "said"), [(0, "0 steps"), (1, "1 step"), (2, "2 steps")])
def test_a_noun_is_singular_or_plural_as_its_number_requires(number: int, said: str) -> None:
    assert counted(number, "step") == said
    assert counted(1, "match", "matches") == "1 match"
    assert counted(2, "match", "matches") == "2 matches"
