"""`--classes` and `--thresholds` of `helios replay` become a search context."""

from __future__ import annotations

import pytest
from helios_client.replay.class_thresholds import DEFAULT_THRESHOLD, search_context_from_flags
from helios_client.usage_errors import UsageError
from helios_core.types import Role
from hypothesis import given
from hypothesis import strategies as st


def test_flags_give_classes_with_their_thresholds_by_name() -> None:
    context = search_context_from_flags(" cup, dining  table", "dining table=0.35")
    assert [(c.name, c.threshold, c.role) for c in context.classes] == [
        ("cup", DEFAULT_THRESHOLD, Role.WATCH),
        ("dining table", 0.35, Role.WATCH),
    ]


def test_class_names_ignore_case_and_accept_underscores() -> None:
    context = search_context_from_flags("Cup,Dining_Table", "DINING table=0.35")
    assert [(c.name, c.threshold) for c in context.classes] == [
        ("cup", DEFAULT_THRESHOLD),
        ("dining table", 0.35),
    ]


@pytest.mark.parametrize("classes", ["", ",", "cup,", "cup,cup", "cup, Cup"])
def test_invalid_classes_raise_a_usage_error(classes: str) -> None:
    with pytest.raises(UsageError, match="--classes"):
        search_context_from_flags(classes, "")


@pytest.mark.parametrize("text", ["cup", "cup=", "cup=x", "cup=1.5", "cup=nan", "=0.3", "fork=0.2"])
def test_invalid_thresholds_raise_a_usage_error(text: str) -> None:
    with pytest.raises(UsageError, match="--thresholds"):
        search_context_from_flags("cup", text)


@given(st.text(), st.text())
def test_any_text_gives_a_valid_context_or_a_usage_error(classes: str, thresholds: str) -> None:
    try:
        context = search_context_from_flags(classes, thresholds)
    except UsageError:
        return
    assert context.classes
    assert all(0 <= c.threshold <= 1 and c.name for c in context.classes)
