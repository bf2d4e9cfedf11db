"""Answers of the HTTP interface that are none of HELIOS': redirects and foreign content."""

from __future__ import annotations

import httpx
import pytest
from helios_client.http import requests
from helios_core.errors import Internal

ASKED = httpx.Request("GET", "http://robot/v1/map.zip")


def answer(status: int, kind: str, **headers: str) -> httpx.Response:
    fields = {"content-type": kind} | headers
    return httpx.Response(status, headers=fields, content=b"x", request=ASKED)


def test_a_redirect_is_no_answer_and_its_goal_is_named() -> None:
    moved = answer(301, "text/html", location="https://robot/v1/map.zip")
    with pytest.raises(
        Internal, match=r"redirects to https://robot/v1/map\.zip; give that address"
    ):
        requests.save_map().answer(moved)


@pytest.mark.parametrize(
    ("call", "kind"),
    [(requests.save_map(), "application/zip"), (requests.camera(), "image/jpeg")],
    ids=["map", "camera"],
)
def test_content_of_another_kind_is_refused(call: requests.Call[bytes], kind: str) -> None:
    assert call.answer(answer(200, kind)) == b"x"
    with pytest.raises(Internal, match=rf"answered text/html; charset=utf-8, not {kind}"):
        call.answer(answer(200, "text/html; charset=utf-8"))
