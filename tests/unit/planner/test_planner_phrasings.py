"""Tables of instructions: how each is parsed, or with which words it is refused."""

from __future__ import annotations

import pytest
from helios_core.errors import InvalidInput
from helios_planner.instruction.parser import NotRead, parse
from hypothesis import given, settings
from hypothesis import strategies as st
from planner_phrasings import FINDS, GOES, MOVES, REFUSED, rows


@pytest.mark.parametrize(("text", "thing", "start", "goal"), rows(MOVES))
def test_a_move_is_understood(text: str, thing: str, start: str, goal: str) -> None:
    got = parse(text)
    assert (got.kind, got.object, got.start or "", got.goal) == ("move", thing, start, goal)


@pytest.mark.parametrize(("text", "thing", "start"), rows(FINDS))
def test_a_find_is_understood(text: str, thing: str, start: str) -> None:
    got = parse(text)
    assert (got.kind, got.object, got.start or "", got.goal) == ("find", thing, start, None)


@pytest.mark.parametrize(("text", "goal"), rows(GOES))
def test_a_go_to_is_understood(text: str, goal: str) -> None:
    got = parse(text)
    assert (got.kind, got.object, got.start, got.goal) == ("go_to", None, None, goal)


@pytest.mark.parametrize(("text", "says"), rows(REFUSED))
def test_a_refusal_lists_the_understood_and_the_missing_parts(text: str, says: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        parse(text)
    assert says in refusal.value.message
    assert len(refusal.value.message) < 400


def test_the_tables_hold_at_least_120_different_instructions() -> None:
    texts = [row[0] for table in (MOVES, FINDS, GOES, REFUSED) for row in rows(table)]
    assert len(set(texts)) == len(texts) >= 120


@pytest.mark.parametrize(
    ("text", "unused"),
    [
        ("move the mug from the table in the kitchen to the sofa", ("in the kitchen",)),
        ("bring the mug with the blue handle to the sofa", ("with the blue handle",)),
        ("bring the mug to the sofa because I am thirsty", ("because i am thirsty",)),
        ("bring the mug from the table near the window to the sofa", ("near the window",)),
        ("I am thirsty. Bring the mug to the sofa", ("i am thirsty",)),
        ("search the kitchen for the mug", ("in the kitchen",)),
        ("bring the mug to the sofa", ()),
    ],
)
def test_unused_words_of_an_instruction_are_reported(text: str, unused: tuple[str, ...]) -> None:
    assert parse(text).unused == unused


def test_ten_thousand_characters_are_refused_with_their_number() -> None:
    with pytest.raises(InvalidInput, match="10000 characters"):
        parse("move the mug " * 769 + "now")


def test_only_unrecognised_sentences_raise_not_read() -> None:
    with pytest.raises(NotRead):
        parse("bewege die Tasse vom Tisch zum Sofa")
    with pytest.raises(InvalidInput) as refusal:
        parse("move the mug to the sofa and to the bed")
    assert not isinstance(refusal.value, NotRead)


WORDS = (
    "move bring take put find go the a mug bowl red sofa table from to on in and then , or it me "
    "that is next not kitchen with for two please of"
)


@settings(deadline=None)
@given(st.lists(st.sampled_from(WORDS.split()), max_size=14).map(" ".join))
def test_any_sequence_of_words_is_read_or_refused(text: str) -> None:
    try:
        got = parse(text)
    except InvalidInput:
        return
    named = [name for name in (got.object, got.start, got.goal) if name]
    assert named
    plain = [name.replace("red and red", "red") for name in named]  # adjectives may be joined
    assert all(" and " not in name and "," not in name for name in plain)
    assert got.object is None or got.object not in (got.start, got.goal)


@settings(deadline=None)
@given(
    st.sampled_from(["mug", "red coffee mug", "glass of water", "can"]),
    st.sampled_from(["desk", "chest of drawers", "TV stand", "side-table"]),
    st.sampled_from(["sofa", "kitchen counter", "washing machine"]),
    st.sampled_from(["move", "bring", "take", "put", "carry", "Please transport", "get"]),
)
def test_the_canonical_sentence_is_understood_with_any_names(
    thing: str, start: str, goal: str, verb: str
) -> None:
    got = parse(f"{verb} the {thing} from the {start} to the {goal}")
    assert (got.object, got.start, got.goal) == (thing, start.lower(), goal)
