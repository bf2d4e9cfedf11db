"""Suggested tasks for a home."""

from __future__ import annotations

import pytest
from fastapi.testclient import TestClient
from helios_core.errors import Unavailable
from helios_core.topics import ROBOT_DESCRIPTION
from helios_detector.coco_classes import COCO_NAMES
from helios_gateway.task_suggestions import KnownObject, suggestions
from helios_sim.home.catalogs import CATALOGS
from hypothesis import given
from hypothesis import strategies as st

from tests.gateway_backend import Backend
from tests.gateway_home import description

MUG = KnownObject("mug", 0.7, (1.5, 1.4, 0.5), (0.1, 0.1, 0.1))
TABLE = KnownObject("coffee table", 0.8, (1.7, 1.5, 0.2), (1.0, 0.6, 0.4))
COUNTER = KnownObject("kitchen counter", 0.6, (7.4, 0.4, 0.45), (2.9, 0.6, 0.9))
EXAMPLE = "Move the mug from the coffee table to the kitchen counter"
KNOWN = ("bowl", "coffee_table", "kitchen_counter", "mug", "sofa")


def test_a_seen_object_is_suggested_for_a_move_to_another_receptacle() -> None:
    assert suggestions(False, KNOWN, True, [COUNTER, MUG, TABLE], 3) == [
        "Move the mug from the coffee table to the kitchen counter",
        "Find the mug",
        "Go to the coffee table",
    ]


def test_a_robot_without_an_arm_gets_no_move_suggestions() -> None:
    reported = suggestions(True, (), False, [COUNTER, MUG, TABLE], 20)
    assert not any(text.startswith("Move") for text in reported)


def test_a_doubtful_object_is_not_suggested() -> None:
    doubtful = KnownObject("sponge", 0.49, (1.5, 1.4, 0.5), (0.1, 0.1, 0.1))
    reported = suggestions(False, KNOWN, True, [doubtful, COUNTER, TABLE], 3)
    assert reported[0] == "Go to the coffee table"
    assert not any("sponge" in text for text in reported)


def test_examples_and_known_names_are_suggested_before_anything_is_seen() -> None:
    assert suggestions(False, KNOWN, True, [], 3) == [EXAMPLE, "Find the bowl", "Go to the sofa"]
    assert suggestions(False, ["box", "shelf"], True, [], 3) == ["Find the box", "Find the shelf"]
    assert suggestions(True, [], True, [], 3) == [EXAMPLE, "Find the apple", "Go to the sofa"]


def test_suggestions_for_a_new_home_are_not_in_alphabetical_order() -> None:
    of_coco = suggestions(False, sorted(COCO_NAMES), True, [], 5)
    assert of_coco == [
        "Move the apple from the dining table to the couch",
        "Find the cup",
        "Go to the bed",
        "Find the apple",
        "Find the bottle",
    ]
    for catalog in CATALOGS.values():
        known = sorted([*catalog.objects, *catalog.receptacles])
        reported = suggestions(False, known, True, [], 5)
        assert reported[0].startswith("Move the ")
        assert f"Find the {known[0]}" not in reported


def test_the_nearest_of_similarly_scored_objects_comes_first() -> None:
    far = KnownObject("cup", 0.73, (9.0, 9.0, 0.5), (0.1, 0.1, 0.1))
    reported = suggestions(False, KNOWN, False, [far, MUG], 1, (1.0, 1.0))
    assert reported == ["Find the mug"]
    assert suggestions(False, KNOWN, False, [far, MUG], 1, (8.0, 9.0)) == ["Find the cup"]


def test_an_object_with_a_low_score_is_not_suggested() -> None:
    doubtful = KnownObject("vase", 0.1, MUG.center_m, MUG.size_m)
    assert suggestions(False, [], True, [doubtful], 3) == []


NUMBERS = st.floats(-1e3, 1e3)
PLACES = st.tuples(NUMBERS, NUMBERS, NUMBERS)
THINGS = st.builds(KnownObject, st.sampled_from(KNOWN), NUMBERS, PLACES, PLACES)


@given(st.booleans(), st.booleans(), st.lists(THINGS, max_size=8), st.integers(1, 20))
def test_suggestions_are_unique_and_at_most_the_requested_number(
    any_name: bool, has_arm: bool, believed: list[KnownObject], most: int
) -> None:
    reported = suggestions(any_name, KNOWN, has_arm, believed, most)
    assert len(reported) == len(set(reported)) <= most


def test_the_interface_reports_seen_objects_and_suggested_tasks(
    backend: Backend, client: TestClient
) -> None:
    reported = client.get("/v1/suggestions").json()
    assert reported["tasks"][0] == "Move the mug from the coffee table to the kitchen counter"
    assert reported["seen"] == [
        {"name": "coffee table", "score": pytest.approx(0.82), "objects": 1},
        {"name": "mug", "score": pytest.approx(0.71), "objects": 2},
        {"name": "kitchen counter", "score": pytest.approx(0.58), "objects": 1},
    ]
    assert len(client.get("/v1/suggestions?limit=2").json()["tasks"]) == 2
    assert client.get("/v1/suggestions?limit=0").status_code == 400


def test_the_interface_suggests_no_moves_for_a_robot_without_an_arm(
    backend: Backend, client: TestClient
) -> None:
    armless = description()
    armless.can_pick = False
    backend.bus.publish(ROBOT_DESCRIPTION, armless)
    tasks = client.get("/v1/suggestions").json()["tasks"]
    assert tasks
    assert not any(text.startswith("Move") for text in tasks)


def test_a_missing_object_map_is_reported_as_null(
    backend: Backend, client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def away(*_: object) -> None:
        raise Unavailable("no object map")

    monkeypatch.setattr("helios_gateway.map_cache.MapCache.objects", away)
    reported = client.get("/v1/suggestions").json()
    assert reported["seen"] is None
    assert reported["tasks"]


@pytest.mark.parametrize("name", ["MUG", "Mug", " mug "])
def test_the_class_filter_ignores_case(name: str, backend: Backend, client: TestClient) -> None:
    found = client.get("/v1/objects", params={"class": name}).json()["objects"]
    assert [one["id"] for one in found] == [1, 4]


@pytest.mark.parametrize("name", ["Coffee Table", "coffee_table"])
def test_the_class_filter_accepts_a_space_or_an_underscore(
    name: str, backend: Backend, client: TestClient
) -> None:
    found = client.get("/v1/objects", params={"class": name}).json()["objects"]
    assert [one["id"] for one in found] == [2]
