"""Matching of the class names of a context with the names that a detector knows."""

import pytest
from detector_scene import context_of
from helios_core.errors import InvalidInput
from helios_core.types import Role, SearchClass, SearchContext
from helios_detector.coco_classes import COCO_NAMES
from helios_detector.vocabulary_matching import (
    accepted_names,
    fixed_wanted,
    near_matches,
    open_wanted,
    refuse_unknown,
)


def served(*asked: str) -> dict[str, frozenset[str]]:
    return {w.name: w.names for w in fixed_wanted(context_of(*asked), COCO_NAMES)[0]}


@pytest.mark.parametrize(
    ("asked", "known"),
    [
        ("mug", "cup"),
        ("Sofa", "couch"),
        ("television", "tv"),
        ("TV", "tv"),
        ("fridge", "refrigerator"),
        ("coffee table", "dining table"),
        ("table", "dining table"),
        ("potted_plant", "potted plant"),
        ("remote control", "remote"),
        ("cup", "cup"),
    ],
)
def test_an_asked_name_maps_to_the_name_that_the_detector_knows(asked, known):
    assert served(asked) == {asked: frozenset({known})}


def test_coco_has_80_different_names():
    assert len(set(COCO_NAMES)) == 80


def test_unknown_class_is_refused_with_near_matches():
    refused = fixed_wanted(context_of("toothpick"), COCO_NAMES)[1]
    assert "toothbrush" in refused["toothpick"]
    with pytest.raises(InvalidInput, match="not among the 80 classes"):
        refuse_unknown(refused)


def test_known_and_unknown_classes_are_separated():
    wanted, refused = fixed_wanted(context_of("cup", "unicorn"), COCO_NAMES)
    assert [w.name for w in wanted] == ["cup"]
    assert list(refused) == ["unicorn"]


def test_a_detector_name_goes_to_the_exact_class_and_the_other_class_is_refused():
    wanted, refused = fixed_wanted(context_of("coffee table", "dining table"), COCO_NAMES)
    assert [w.name for w in wanted] == ["dining table"]
    assert "cannot tell them apart" in refused["coffee table"]


def test_mug_is_refused_if_mug_and_cup_are_asked_together():
    wanted, refused = fixed_wanted(context_of("mug", "cup"), COCO_NAMES)
    assert [w.name for w in wanted] == ["cup"]
    assert list(refused) == ["mug"]


def test_synonyms_of_the_context_are_used():
    context = SearchContext("c", (SearchClass("beaker", Role.OBJECT, 0.3, ("mug",)),))
    assert fixed_wanted(context, COCO_NAMES)[0][0].names == frozenset({"cup"})
    assert "mug" in open_wanted(context)[0].names


def test_an_open_vocabulary_accepts_a_subclass_for_a_class_but_never_a_sibling():
    assert "coffee table" in accepted_names("table")
    assert "dining table" not in accepted_names("coffee table")


def test_an_asked_name_is_not_accepted_for_another_class_of_the_context():
    by_name = {w.name: w for w in open_wanted(context_of("table", "coffee table"))}
    assert "coffee table" not in by_name["table"].names
    assert "dining table" in by_name["table"].names


def test_two_roles_of_a_class_merge_with_the_lower_threshold_and_keep_the_surface():
    context = SearchContext(
        "c",
        (
            SearchClass("table", Role.OBJECT, 0.4),
            SearchClass("table", Role.GOAL_RECEPTACLE, 0.3),
        ),
    )
    (only,) = open_wanted(context)
    assert (only.threshold, only.keep_surface, only.is_object) == (0.3, True, True)


def test_near_matches_share_words_or_letters():
    assert near_matches("wine bottle", COCO_NAMES)[:2] == ["bottle", "wine glass"]
    assert near_matches("qqq", COCO_NAMES) == []


def also(*names: str) -> SearchContext:
    classes = (SearchClass("mug", Role.OBJECT, 0.3), SearchClass("sofa", Role.GOAL_RECEPTACLE, 0.2))
    return SearchContext("c", classes, also=names)


def test_other_names_are_sought_unless_they_match_a_class():
    asked = {w.name: w for w in open_wanted(also("glass", "couch", "cup", "bed", "tumbler"))}
    assert set(asked) == {"mug", "sofa", "glass", "bed"}  # a couch is a sofa, a tumbler a glass
    assert [asked[n].is_also for n in ("mug", "sofa", "glass", "bed")] == [False] * 2 + [True] * 2
    assert asked["glass"].threshold == 0.2
    assert (asked["bed"].keep_surface, asked["glass"].keep_surface) == (True, False)


def test_a_fixed_vocabulary_seeks_the_other_names_that_it_knows_and_refuses_none():
    found, refused = fixed_wanted(also("bed", "couch", "teapot", "bowl"), COCO_NAMES)
    assert {w.name: w.names for w in found if w.is_also} == {
        "bed": frozenset({"bed"}),
        "bowl": frozenset({"bowl"}),
    }
    assert not refused
