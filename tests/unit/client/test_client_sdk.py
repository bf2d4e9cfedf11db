"""The SDK against answers in the form that the gateway sends."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from helios_client.answer_types import Decision, Event, FoundObject, Task
from helios_client.http.address import base_url
from helios_client.http.errors import WrongRequest
from helios_client.http.server_sent_events import EventParser
from helios_client.sdk import Helios
from helios_client.sdk_async import AsyncHelios
from helios_core.errors import (
    Conflict,
    DeadlineExceeded,
    HeliosError,
    Internal,
    InvalidInput,
    Unavailable,
)
from hypothesis import given
from hypothesis import strategies as st

from tests.support import free_port

Answer = Callable[[httpx.Request], httpx.Response]


NEXT_EVENT = 'id: b-2\nevent: map\ndata: {"map2d": 2}\n\n'


class QuietHour(httpx.SyncByteStream):
    """A stream of keepalives that breaks off after an hour, and the clock that measures it."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __iter__(self) -> Iterator[bytes]:
        for _ in range(240):
            self.now_s += 15
            yield b": still here\n\n"
        raise httpx.ReadError("reset by peer")

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


def helios(answer: Answer) -> Helios:
    return Helios("http://robot", transport=httpx.MockTransport(answer))


def task_json(**changes: Any) -> dict[str, Any]:
    task = {"id": "t1", "instruction": "move it", "state": "running", "phase": "pick",
            "message": "drives to the mug", "steps": 3, "max_steps": 10, "progress": 0.4,
            "started_s": None, "something_new": 1}  # fmt: skip
    return task | changes


def test_submit_sends_the_instruction_and_returns_the_task() -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        assert (request.method, request.url.path) == ("POST", "/v1/tasks")
        assert json.loads(request.content) == {"instruction": "move it", "max_steps": 9}
        return httpx.Response(202, json=task_json(state="queued"))

    task = helios(answer).submit("move it", max_steps=9)
    assert (task.id, task.state, task.started_s) == ("t1", "queued", 0.0)
    assert task.raw["something_new"] == 1


@pytest.mark.parametrize(
    ("status", "kind"),
    [
        (400, InvalidInput),
        (404, InvalidInput),
        (409, Conflict),
        (503, Unavailable),
        (504, DeadlineExceeded),
        (500, Internal),
    ],
)
def test_a_problem_response_raises_a_typed_error_with_its_detail(
    status: int, kind: type[HeliosError]
) -> None:
    problem = {"type": "helios:x", "title": "x", "status": status, "detail": "say what to move"}
    with pytest.raises(kind, match="say what to move"):
        helios(lambda _: httpx.Response(status, json=problem)).task("t1")


def test_a_response_that_is_not_json_raises_an_error() -> None:
    with pytest.raises(Internal, match="502"):
        helios(lambda _: httpx.Response(502, text="<html>")).task("t1")
    with pytest.raises(InvalidInput, match="is HELIOS there") as refused:
        helios(lambda _: httpx.Response(404, text="<html>")).task("t1")
    assert not isinstance(refused.value, WrongRequest)  # only for HELIOS's own refusals
    with pytest.raises(Internal, match="no JSON"):
        helios(lambda _: httpx.Response(200, text="<html>")).task("t1")


def test_an_unreachable_gateway_raises_unavailable() -> None:
    with (
        Helios(f"http://127.0.0.1:{free_port()}") as client,
        pytest.raises(Unavailable, match="helios up"),
    ):
        client.tasks()


def test_a_task_id_is_escaped_and_cannot_reach_another_address() -> None:
    seen: list[str] = []

    def answer(request: httpx.Request) -> httpx.Response:
        seen.append(request.url.raw_path.decode())
        return httpx.Response(200, json=task_json())

    helios(answer).cancel("../robot/stop?x=")
    assert seen == ["/v1/tasks/..%2Frobot%2Fstop%3Fx%3D/cancel"]


def test_wait_survives_a_gateway_restart() -> None:
    answers = iter(
        [
            httpx.Response(200, json=task_json()),
            httpx.Response(503, json={"detail": "starting"}),
            httpx.Response(200, json=task_json(state="succeeded", message="done")),
        ]
    )
    heard: list[str] = []
    ended = helios(lambda _: next(answers)).wait("t1", 30, lambda t: heard.append(t.state))
    assert ended.succeeded
    assert heard == ["running", "succeeded"]


def test_wait_ends_at_its_deadline() -> None:
    with pytest.raises(DeadlineExceeded, match="still running"):
        helios(lambda _: httpx.Response(200, json=task_json())).wait("t1", 0.0)


def test_map_arrays_are_returned_as_numpy_arrays() -> None:
    stream = io.BytesIO()
    np.savez_compressed(stream, occupancy=np.array([[0, 100], [-1, 0]], np.int8))
    arrays = helios(lambda _: httpx.Response(200, content=stream.getvalue())).occupancy()
    np.testing.assert_array_equal(arrays["occupancy"], [[0, 100], [-1, 0]])


def test_the_class_field_of_an_object_becomes_class_name() -> None:
    answer = {"objects": [{"id": 4, "class": "cup", "center_m": [1, 2, 0.8], "score": None}]}
    (found,) = helios(lambda _: httpx.Response(200, json=answer)).objects()
    assert (found.id, found.class_name, found.center_m, found.score) == (4, "cup", [1, 2, 0.8], 0.0)


def test_events_are_parsed_and_keepalives_are_skipped() -> None:
    text = ': still here\n\nid: b-1\nevent: task\ndata: {"id": "t1"}\n\nevent: x\ndata: no JSON\n\n'
    events = helios(lambda _: httpx.Response(200, text=text)).events(silence_s=0)
    assert next(events) == Event("task", {"id": "t1"}, "b-1")
    with pytest.raises(Unavailable, match="ended the stream"):
        next(events)


def test_events_resume_where_the_connection_broke_off() -> None:
    def event(number: int) -> str:
        return f'id: b-{number}\nevent: map\ndata: {{"map2d": {number}}}\n\n'

    answers = iter(
        [
            httpx.Response(200, text=event(1) + event(2)),
            httpx.Response(503, json={"detail": "starting"}),
            httpx.Response(200, text=event(3)),
        ]
    )
    asked: list[str | None] = []

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(request.headers.get("last-event-id"))
        return next(answers)

    events = helios(answer).events()
    assert [next(events).data["map2d"] for _ in range(3)] == [1, 2, 3]
    assert asked == [None, "b-2", "b-2"]


def test_keepalives_count_as_contact_when_a_quiet_connection_is_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = QuietHour()
    monkeypatch.setattr("helios_client.sdk.time", clock)
    answers = iter([httpx.Response(200, stream=clock), httpx.Response(200, text=NEXT_EVENT)])
    events = helios(lambda _: next(answers)).events(silence_s=30)
    assert next(events).data == {"map2d": 2}


def test_the_events_of_a_task_end_with_the_task() -> None:
    text = "".join(
        f'event: task\ndata: {{"id": "t1", "state": "{state}"}}\n\n'
        for state in ("running", "succeeded")
    )

    def answer(request: httpx.Request) -> httpx.Response:
        assert dict(request.url.params) == {"types": "task", "task_id": "t1"}
        return httpx.Response(200, text=text)

    events = list(helios(answer).events(types=["task"], task_id="t1"))
    assert [event.data["state"] for event in events] == ["running", "succeeded"]


def test_every_call_sends_the_key_and_the_robot_name() -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        assert request.headers["authorization"] == "Bearer secret"
        assert request.url.path == "/v1/robots/spot/tasks"
        return httpx.Response(200, json={"tasks": []})

    transport = httpx.MockTransport(answer)
    assert Helios("http://robot", transport=transport, key="secret", robot="spot").tasks() == ()


@given(st.lists(st.text(alphabet=st.characters(exclude_characters="\n\r"))))
def test_the_event_parser_accepts_any_line(lines: list[str]) -> None:
    parser = EventParser()
    for line in lines:
        parser.feed(line)


@given(st.dictionaries(st.text(), st.integers() | st.text()))
def test_events_round_trip(data: dict[str, Any]) -> None:
    lines = ["id: 7", "event: map", f"data: {json.dumps(data)}", ""]
    parser = EventParser()
    assert [parser.feed(line) for line in lines] == [None, None, None, Event("map", data, "7")]


@pytest.mark.parametrize(
    ("said", "url"),
    [
        ("localhost:8191", "http://localhost:8191"),
        ("robot", "http://robot"),
        ("http://robot:80/", "http://robot:80"),
        (" https://robot/behind/a/proxy/ ", "https://robot/behind/a/proxy"),
        ("[::1]:8080", "http://[::1]:8080"),
        ("127.0.0.1:1", "http://127.0.0.1:1"),
    ],
)
def test_an_address_may_lack_its_scheme(said: str, url: str) -> None:
    assert base_url(said) == url
    asked: list[str] = []

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(str(request.url))
        return httpx.Response(200, json={"tasks": []})

    Helios(said, transport=httpx.MockTransport(answer)).tasks()
    assert asked == [str(httpx.URL(f"{url}/v1/tasks"))]


@pytest.mark.parametrize("said", ["", "ftp://robot", "http://", "robot:port", "robot:70000", "[::"])
def test_an_invalid_address_raises_an_error_with_the_expected_form(said: str) -> None:
    for kind in (Helios, AsyncHelios):
        with pytest.raises(InvalidInput, match="wanted http://HOST:PORT or HOST:PORT"):
            kind(said)


@given(st.text(max_size=30))
def test_base_url_refuses_a_text_or_is_idempotent(said: str) -> None:
    with contextlib.suppress(ValueError):
        assert base_url(base_url(said)) == base_url(said)


@pytest.mark.parametrize("key", ["ключ", "a\nb"])
def test_a_key_that_no_header_can_hold_is_refused(key: str) -> None:
    with pytest.raises(InvalidInput, match="helios key"):
        Helios("robot", key=key)


def test_unknown_fields_of_a_newer_gateway_are_kept_in_raw() -> None:
    newer = {"new": {"a": 1}, "raw": "x", "id": "t1", "state": "running", "eta_s": None}
    task = Task.from_json(newer)
    assert (task.id, task.eta_s, task.time_limit_s, task.raw) == ("t1", None, None, newer)
    found = {"id": 3, "class": "mug", "new": 1}
    assert FoundObject.from_json(found).class_name == "mug"
    assert FoundObject.from_json(found).raw == found
    decision = Decision.from_json({"index": 2, "new": []})
    assert (decision.index, decision.raw["new"]) == (2, [])
