"""Parsing of instructions: accepted sentences, refusals, close names."""

from __future__ import annotations

import pytest
from helios_core.errors import InvalidInput
from helios_core.name_rules import closest
from helios_planner.instruction.parser import parse
from hypothesis import given, settings
from hypothesis import strategies as st

MOVES = [
    ("Move the mug from the coffee table to the kitchen counter",
     "mug", "coffee table", "kitchen counter"),
    ("move mug from coffee table to kitchen counter", "mug", "coffee table", "kitchen counter"),
    ("MOVE THE MUG FROM THE TABLE TO THE SOFA!", "mug", "table", "sofa"),
    ("bring the red coffee mug to the sofa", "red coffee mug", None, "sofa"),
    ("Bring me the mug from the desk to the sofa", "mug", "desk", "sofa"),
    ("Take the bowl on the dining table to the kitchen counter",
     "bowl", "dining table", "kitchen counter"),
    ("take the mug off the table and bring it to the couch", "mug", "table", "couch"),
    ("put the apple on the table", "apple", None, "table"),
    ("Put the apple from the fridge on the table", "apple", "fridge", "table"),
    ("put the mug on the table on the sofa", "mug", "table", "sofa"),
    ("put the spoon in the sink, please", "spoon", None, "sink"),
    ("put the book back on the shelf", "book", None, "shelf"),
    ("please place a toy airplane onto my bed", "toy airplane", None, "bed"),
    ("fetch the cup from the desk and put it on the stool", "cup", "desk", "stool"),
    ("grab the cup on the table and put it in the sink", "cup", "table", "sink"),
    ("grab the cup from the table, then put it down on the bench", "cup", "table", "bench"),
    ("pick up the mug from the table and place it onto the shelf", "mug", "table", "shelf"),
    ("find the mug and bring it to the sofa", "mug", None, "sofa"),
    ("get the book that is on the desk to the shelf", "book", "desk", "shelf"),
    ("move the cup which is standing on the stool to the bench", "cup", "stool", "bench"),
    ("carry the vase lying on the chair over to the cabinet", "vase", "chair", "cabinet"),
    ("Could you please bring my toy airplane from the chair to the bed, please?",
     "toy airplane", "chair", "bed"),
    ("hey robot, can you move the can to the counter?", "can", None, "counter"),
    ("transport the potted plant, from the stool to the tv stand.",
     "potted plant", "stool", "tv stand"),
    ("Return the book to the bookshelf", "book", None, "bookshelf"),
    ("take the can out of the cabinet and put it on the counter", "can", "cabinet", "counter"),
    ("move the coffee_mug from the coffee_table to the side-table",
     "coffee mug", "coffee table", "side-table"),
    ("To the sofa", None, None, None),
    ("deliver the towel into the laundry basket", "towel", None, "laundry basket"),
    ("relocate that pillow from the armchair to the chest of drawers",
     "pillow", "armchair", "chest of drawers"),
    ("bring a glass of water from the counter to the bedside table",
     "glass of water", "counter", "bedside table"),
]  # fmt: skip

OTHERS = [
    ("find the remote", "find", "remote", None),
    ("Where is the remote control?", "find", "remote control", None),
    ("look for my keys", "find", "keys", None),
    ("search for a book please", "find", "book", None),
    ("locate the blue vase", "find", "blue vase", None),
    ("go to the sofa", "go_to", None, "sofa"),
    ("move to the sofa", "go_to", None, "sofa"),
    ("Drive over to the kitchen counter now", "go_to", None, "kitchen counter"),
    ("please navigate to the bed", "go_to", None, "bed"),
]

REFUSED = [
    ("", "empty"),
    ("   ...", "empty"),
    ("x" * 10_000, "10000 characters"),
    ("bewege die Tasse zum Tisch", "no verb"),
    ("把杯子放到桌子上", "no verb"),
    ("the quick brown fox", "no verb"),
    ("bring the mug to me", "place to bring it to"),
    ("grab the spoon", "place to bring it to"),
    ("fetch me the cup from the desk", "place to bring it to"),
    ("move from the table to the sofa", "the object"),
    ("put it on the table", "the object"),
    ("move the mug from the table to the sofa and to the bed", "2 goals"),
    ("move the mug from the table from the desk to the bed", "2 places"),
    ("move the mug and the bowl to the bed", "several things"),
    ("move the mug to the bed or the sofa", "several things"),
    ("go to", "a piece of furniture"),
    ("find", "the object to find"),
    ("move", "the object to move"),
]


@pytest.mark.parametrize(("text", "thing", "start", "goal"), [m for m in MOVES if m[1]])
def test_a_move_is_understood(text: str, thing: str, start: str | None, goal: str) -> None:
    got = parse(text)
    assert (got.kind, got.object, got.start, got.goal) == ("move", thing, start, goal)


@pytest.mark.parametrize(("text", "kind", "thing", "goal"), OTHERS)
def test_find_and_go_to_are_understood(
    text: str, kind: str, thing: str | None, goal: str | None
) -> None:
    got = parse(text)
    assert (got.kind, got.object, got.goal) == (kind, thing, goal)


@pytest.mark.parametrize(("text", "says"), REFUSED)
def test_an_unreadable_instruction_is_refused_with_the_missing_part(text: str, says: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        parse(text)
    assert says in refusal.value.message
    assert len(refusal.value.message) < 500


def test_a_refusal_lists_the_understood_parts() -> None:
    with pytest.raises(InvalidInput, match="object “cup”, from “desk”"):
        parse("fetch me the cup from the desk")


@settings(deadline=None)
@given(st.text(max_size=300))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        got = parse(text)
    except InvalidInput:
        return
    assert got.object or got.goal or got.kind.only_moves


def test_close_names_are_those_that_share_words_or_letters() -> None:
    known = ["coffee table", "kitchen counter", "sofa", "cabinet"]
    assert closest("coffe table", known)[0] == "coffee table"
    assert closest("counter", known) == ["kitchen counter"]
    assert closest("unicorn", known) == []
