"""Reset of both maps or of one, and the class filter of the objects."""

from __future__ import annotations

from typing import NoReturn

import pytest
from fastapi.testclient import TestClient
from helios_core.errors import DeadlineExceeded, InvalidInput
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import RESET_MAP2D, RESET_OBJECTS, Method

from tests.gateway_backend import Backend

BEFORE = {"map2d": b"walls", "objects": b"things"}


@pytest.mark.parametrize(
    ("query", "reset", "left"),
    [
        ("", ["objects", "occupancy"], {"map2d": b"", "objects": b""}),
        ("?only=objects", ["objects"], {"map2d": b"walls", "objects": b""}),
        ("?only=occupancy", ["occupancy"], {"map2d": b"", "objects": b"things"}),
    ],
)
def test_reset_clears_only_the_requested_maps(
    client: TestClient, backend: Backend, query: str, reset: list[str], left: dict[str, bytes]
) -> None:
    answer = client.post(f"/v1/map/reset{query}")
    assert (answer.status_code, answer.json()) == (200, {"reset": reset})
    assert backend.kept == left


def test_reset_of_an_unknown_map_is_refused(client: TestClient, backend: Backend) -> None:
    assert client.post("/v1/map/reset?only=walls").status_code == 400
    assert backend.kept == BEFORE


def test_a_refused_reset_leaves_both_maps_unchanged(client: TestClient, backend: Backend) -> None:
    backend.refuses_maps = InvalidInput("a reason")
    answer = client.post("/v1/map/reset")
    assert (answer.status_code, answer.json()["detail"]) == (400, "a reason")
    assert backend.kept == BEFORE


def test_no_map_is_reset_while_a_task_is_open(client: TestClient, backend: Backend) -> None:
    backend.submit("move the mug to the kitchen counter")
    for state in ("queued", "running", "paused"):
        backend.change_task("t1", state)
        for query in ("", "?only=objects", "?only=occupancy"):
            answer = client.post(f"/v1/map/reset{query}")
            assert answer.status_code == 409
            assert f"t1 is {state}" in answer.json()["detail"]
    assert backend.kept == BEFORE
    backend.change_task("t1", "succeeded")
    assert client.post("/v1/map/reset").status_code == 200


@pytest.mark.parametrize("method", [RESET_OBJECTS, RESET_MAP2D])
def test_a_reset_without_an_answer_reports_an_unknown_outcome(
    client: TestClient, hub: MemoryHub, backend: Backend, method: Method
) -> None:
    def late(_: object) -> NoReturn:
        raise DeadlineExceeded("no answer came in 60 s")

    MemoryBus(hub).serve(method, late)
    answer = client.post("/v1/map/reset")
    assert (answer.status_code, "is not known" in answer.json()["detail"]) == (504, True)


@pytest.mark.parametrize("said", ["mug", "Mug", " MUGS ", "Coffee_Table", "coffee  table"])
def test_the_class_filter_ignores_case_plural_and_separators(
    client: TestClient, backend: Backend, said: str
) -> None:
    found = client.get("/v1/objects", params={"class": said}).json()["objects"]
    assert {o["class"] for o in found} == {"mug" if "mug" in said.lower() else "coffee table"}


def test_an_unknown_class_is_reported_with_similar_names(
    client: TestClient, backend: Backend
) -> None:
    assert client.get("/v1/objects?class=Sofa").json()["objects"] == []
    answer = client.get("/v1/objects?class=Coffe_Table")
    assert answer.status_code == 404
    assert "did you mean coffee table" in answer.json()["detail"]
    answer = client.get("/v1/objects?class=unicorn")
    assert answer.status_code == 404
    assert "did you mean" not in answer.json()["detail"]
