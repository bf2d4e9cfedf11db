"""Where something was seen: estimated objects and past views."""

from __future__ import annotations

import base64
import math
from typing import Any

import pytest
from fastapi.testclient import TestClient
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.name_rules import mentions_class

from tests.gateway_backend import Backend
from tests.gateway_home import picture_jpeg


def test_matching_objects_and_past_views_are_reported(client: TestClient, backend: Backend) -> None:
    answer = client.get("/v1/seen", params={"prompt": "the red mug", "limit": 2}).json()
    assert [found["id"] for found in answer["objects"]] == [1, 4]
    assert [view["score"] for view in answer["views"]] == [0.82, 0.64]
    best = answer["views"][0]
    assert base64.b64decode(best["jpeg_base64"]) == picture_jpeg(0)
    assert (best["center_m"], best["camera"]["x_m"]) == ([1.6, 1.5], 1.0)
    assert (answer["views_asked"], answer["views_note"]) == (7, "")


def test_objects_are_reported_even_if_past_views_are_unavailable(
    client: TestClient, backend: Backend
) -> None:
    backend.recalls = Unavailable("no view has been kept")
    answer = client.get("/v1/seen", params={"prompt": "coffee table"}).json()
    assert [found["class"] for found in answer["objects"]] == ["coffee table"]
    assert answer["views"] == []
    assert answer["views_note"] == "past views were not asked: no view has been kept"


def test_the_views_of_an_object_show_its_position(client: TestClient, backend: Backend) -> None:
    (view,) = client.get("/v1/objects/1/views").json()["views"]  # the other views look elsewhere
    assert base64.b64decode(view["jpeg_base64"]) == picture_jpeg(0)
    assert client.get("/v1/objects/4/views").json()["views"] == []
    missing = client.get("/v1/objects/9/views")
    assert (missing.status_code, "list them" in missing.json()["detail"]) == (404, True)


@pytest.mark.parametrize("query", ["", "?prompt=", "?prompt=mug&limit=0", "?prompt=" + 501 * "m"])
def test_an_invalid_prompt_or_limit_is_refused(
    client: TestClient, backend: Backend, query: str
) -> None:
    assert client.get(f"/v1/seen{query}").status_code == 400


@pytest.mark.parametrize(
    ("prompt", "class_name", "named"),
    [
        ("Mug", "mug", True),
        ("two mugs", "mug", True),
        ("where is my coffee-table?", "coffee table", True),
        ("table", "coffee table", False),
        ("smug", "mug", False),
        ("mug", "", False),
        ("a cup (of tea", "cup (of", True),
    ],
)
def test_a_prompt_mentions_a_class_only_as_whole_words(
    prompt: str, class_name: str, named: bool
) -> None:
    assert mentions_class(prompt, class_name) is named


def stored_mug(**place: Any) -> pb.StoredObjectsReply:
    mug = pb.ObjectInstance(
        class_name="mug", center_m=pb.Vector3(x=1.0, y=2.0, z=0.8), score=0.7, views=5
    )
    return pb.StoredObjectsReply(relocalisation=pb.Relocalisation(**place), objects=[mug])


def test_a_stored_object_without_a_known_place_has_no_coordinates(
    client: TestClient, backend: Backend
) -> None:
    backend.stored = stored_mug(state="unknown", attempts=2, reason="too little to compare")
    answer = client.get("/v1/objects", params={"class": "mug"}).json()
    (mug,) = answer["stored"]
    assert mug["relocalisation"] == "unknown"
    assert mug["center_m"] == [None, None, None]
    assert "id" not in mug  # nothing can name it, so nothing can drive to it
    assert answer["relocalisation"]["reason"] == "too little to compare"
    (seen,) = client.get("/v1/seen", params={"prompt": "the red mug"}).json()["stored"]
    assert seen == mug


def test_a_tentative_stored_object_is_shown_in_the_present_frame(
    client: TestClient, backend: Backend
) -> None:
    T = pb.Pose2(x_m=10.0, y_m=0.0, yaw_rad=math.pi / 2)
    backend.stored = stored_mug(state="tentative", T_present_stored=T)
    (mug,) = client.get("/v1/objects").json()["stored"]
    assert mug["relocalisation"] == "tentative"
    assert mug["center_m"] == [8.0, 1.0, 0.8]


def test_a_robot_without_a_stored_map_reports_none(client: TestClient, backend: Backend) -> None:
    answer = client.get("/v1/objects").json()
    assert (answer["stored"], answer["relocalisation"]) == ([], None)
    assert {found["relocalisation"] for found in answer["objects"]} == {None}
