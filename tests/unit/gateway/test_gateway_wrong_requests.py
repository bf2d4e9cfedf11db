"""Errors of invalid requests name the received value, the expected value and what to do."""

from __future__ import annotations

import json
import unicodedata
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from helios_core.printable_text import printable
from helios_gateway.api_models import TaskRequest
from helios_gateway.error_responses import add_problems
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.gateway_backend import Backend

ANYTHING = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=6,
)
JSON = {"content-type": "application/json"}


@pytest.mark.parametrize(
    ("verb", "path", "body", "said"),
    [
        ("POST", "/tasks", b"{instruction: find}",
         'the body is no JSON (Expecting property name enclosed in double quotes at character 1); '
         'send a JSON object such as {"instruction": "Move the mug'),
        ("POST", "/tasks", b"{}",
         "instruction is missing; send it: task in natural language; at most 400 characters; for "
         'example {"instruction": "Move the mug'),
        ("POST", "/tasks", b"", "the body is empty; send a JSON object such as"),
        ("POST", "/tasks", b"[]", "the body is no JSON object; send a JSON object such as"),
        ("POST", "/tasks", b'{"instruction": 5}', "instruction is 5; wanted a valid string"),
        ("POST", "/tasks", b'{"instruction": "find it", "priority": 1000}',
         "priority is 1000; wanted less than or equal to 100"),
        ("POST", "/tasks", b'{"instruction": "find it", "speed": 1}',
         "speed is not known here; leave it out"),
        ("POST", "/tasks", b'{"instruction": " "}', "the instruction is empty; say what to move"),
        ("POST", "/tasks", b'{"instruction": "' + b"x" * 401 + b'"}',
         "the instruction has 401 characters; send at most 400"),
        ("PUT", "/map.zip", b"",
         "the body is empty; send a map file from GET /v1/map.zip or `helios map save`"),
        ("GET", "/seen", b"", "prompt is missing; send it"),
        ("GET", "/seen?prompt=cup&limit=many", b"", "limit is 'many'; wanted a valid integer"),
        ("GET", "/tasks?state=asleep", b"", "state is 'asleep'; wanted 'queued', 'running'"),
        ("GET", "/objects/x", b"", "id is 'x'; wanted a valid integer"),
        ("GET", "/objects/0", b"", "id is '0'; wanted greater than or equal to 1"),
        ("POST", "/session", b"{}", "key is missing; send it"),
    ],
)  # fmt: skip
def test_an_invalid_request_error_names_the_received_and_the_expected_value(
    client: TestClient, backend: Backend, verb: str, path: str, body: bytes, said: str
) -> None:
    answer = client.request(verb, f"/v1{path}", content=body or None, headers=JSON)
    assert answer.status_code == 400
    assert said in answer.json()["detail"]


@pytest.mark.parametrize("spoiled", ["find the \x1b[31mcup", "find\x00", "a\x9b2Jb", "\x7f"])
def test_control_characters_in_an_instruction_are_refused(
    client: TestClient, backend: Backend, spoiled: str
) -> None:
    answer = client.post("/v1/tasks", json={"instruction": spoiled})
    assert answer.status_code == 400
    assert "holds the control character U+00" in answer.json()["detail"]
    assert "submit" not in backend.calls


def test_line_breaks_and_tabs_in_an_instruction_are_accepted(
    client: TestClient, backend: Backend
) -> None:
    answer = client.post("/v1/tasks", json={"instruction": "move the mug\n\tto the counter"})
    assert answer.status_code == 202
    assert answer.json()["instruction"] == "move the mug  to the counter"


def test_control_characters_in_a_task_from_the_bus_are_replaced(
    client: TestClient, backend: Backend
) -> None:
    backend.submit("move the \x1b[31mmug")
    backend.change_task("t1", "running", message="drives\x9b2J")
    task = client.get("/v1/tasks/t1").json()
    assert (task["instruction"], task["message"]) == ("move the \ufffd[31mmug", "drives\ufffd2J")


@given(st.text(min_size=1).filter(str.strip))
def test_an_instruction_is_accepted_exactly_if_it_is_printable(text: str) -> None:
    shown = all(unicodedata.category(c) not in ("Cc", "Cs") or c in "\t\n\r" for c in text)
    try:
        TaskRequest(instruction=text)
    except ValidationError:
        assert not shown
    else:
        assert shown


@given(ANYTHING)
def test_the_error_message_for_any_body_is_printable(wrong: Any) -> None:
    app = FastAPI()
    add_problems(app)

    @app.post("/")
    def post(task: TaskRequest) -> None: ...

    body = json.dumps(wrong)
    answer = TestClient(app).post("/", content=body, headers=JSON)
    if answer.status_code == 400:
        detail = answer.json()["detail"]
        assert printable(detail) == detail


@pytest.mark.parametrize(
    ("content_type", "why"),
    [
        ("multipart/form-data", "Missing boundary in multipart"),
        ("multipart/form-data; boundary=a", "Invalid multipart data"),
    ],
)
def test_a_broken_form_error_names_the_content_type_and_the_parts_to_send(
    client: TestClient, backend: Backend, content_type: str, why: str
) -> None:
    headers = {"content-type": content_type}
    answer = client.post("/v1/frames", content=b"x", headers=headers)
    assert answer.status_code == 400
    assert answer.json()["detail"] == (
        f"the body cannot be read ({why}); it came with content-type {content_type!r}; send meta, "
        "color, depth as multipart/form-data with a boundary, as curl -F does"
    )
