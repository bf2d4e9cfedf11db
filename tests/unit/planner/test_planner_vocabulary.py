"""Mapping of instructions to the names of a detector with a closed vocabulary."""

from __future__ import annotations

import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_planner.instruction.parser import parse
from helios_planner.tasks.search_context import in_vocabulary

NAMES = ("mug", "bowl", "orange", "pan", "coffee_table", "sofa", "bed")


def named(text: str, names: tuple[str, ...] = NAMES) -> tuple:
    reply = pb.VocabularyReply(open=not names, names=names, detector="a few")
    got = in_vocabulary(parse(text), reply)
    return got.object, got.start, got.goal, got.unused


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("bring the mugs to the sofa", ("mug", None, "sofa", ())),
        ("bring the red coffee mug to the sofa", ("mug", None, "sofa", ("red coffee",))),
        ("bring the mug from the coffee table to the sofa", ("mug", "coffee_table", "sofa", ())),
        ("bring the bowl of oranges to the bed", ("bowl", None, "bed", ("of oranges",))),
    ],
)
def test_names_are_mapped_to_those_of_the_detector_and_unused_words_are_reported(
    text: str, wanted: tuple
) -> None:
    assert named(text) == wanted


def test_an_open_vocabulary_takes_every_name() -> None:
    assert named("bring the lid of the pan to the sofa", ()) == ("lid of the pan", None, "sofa", ())


def test_a_part_of_a_known_object_is_not_mapped_to_the_object() -> None:
    with pytest.raises(InvalidInput, match="does not know the object “lid of the pan”") as refusal:
        named("bring the lid of the pan to the sofa")
    assert "did you mean pan?" in refusal.value.message
    with pytest.raises(InvalidInput, match="does not know the start “edge of the bed”"):
        named("find the mug on the edge of the bed")


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("put the small mug on the big mug", "big mug"),
        ("bring the mug from the blue mug to the sofa", "blue mug"),
        ("find the white bowl on the red bowl", "red bowl"),
    ],
)
def test_an_object_and_a_place_with_one_name_for_the_detector_are_refused(
    text: str, place: str
) -> None:
    assert named(text, ())[0] != place  # an open vocabulary tells them apart
    with pytest.raises(InvalidInput, match=f"the place “{place}” only as “(mug|bowl)”"):
        named(text)


KNOWN = ("can", "candle", "banana", "scissors", "bookcase", "kitchen counter", "refrigerator")


@pytest.mark.parametrize(
    ("said", "wanted"),
    [
        ("cann", "did you mean can?"),
        ("bannana", "did you mean banana?"),
        ("scisors", "did you mean scissors?"),
        ("bookcsae", "did you mean bookcase?"),
        ("fridge", "all that it knows: `helios names` (HTTP: GET /v1/vocabulary)"),
        ("unicorn", "all that it knows: `helios names` (HTTP: GET /v1/vocabulary)"),
        ("unicorns", "all that it knows: `helios names` (HTTP: GET /v1/vocabulary)"),
    ],
)
def test_a_refusal_suggests_a_close_name_or_else_where_to_list_all_names(
    said: str, wanted: str
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        named(f"find the {said}", KNOWN)
    assert f"does not know the object “{said}”; {wanted}" in refusal.value.message
    assert refusal.value.message.count("helios names") == 1
