"""Stop-now is sent for any body and while other requests are open; so are commands to tasks."""

from __future__ import annotations

import asyncio
import json
import math
import threading
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import httpx
import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from helios_core import proto as pb
from helios_core.memory_bus import MemoryBus
from helios_core.topics import VOCABULARY
from helios_gateway.routes.robot import stop_reason
from hypothesis import given
from hypothesis import strategies as st

from tests.gateway_backend import Backend
from tests.gateway_process import Served, served
from tests.support import wait_until

SHARED_THREADS = 40  # the framework's threads for blocking requests
MOST_REQUESTS = 128  # by default
DEFAULT = "stop-now was asked for over HTTP"


@contextmanager
def blocked(readers: int, threads: int) -> Iterator[tuple[Served, httpx.Client]]:
    """A gateway and a client of it, while so many requests that only read are not answered.

    threads: number of them that have reached a service.
    """
    asked, answer = threading.Semaphore(0), threading.Event()

    def slow(_: pb.Empty) -> pb.VocabularyReply:
        asked.release()
        answer.wait(60)
        return pb.VocabularyReply()

    with (
        served("--call-timeout-s", "60") as gateway,
        ThreadPoolExecutor(readers) as people,
        httpx.Client(base_url=gateway.url, timeout=20) as client,
    ):
        MemoryBus(gateway.backend.hub).serve(VOCABULARY, slow)
        try:
            for _ in range(readers):
                people.submit(httpx.get, f"{gateway.url}/v1/vocabulary", timeout=60)
            for _ in range(threads):
                assert asked.acquire(timeout=20)
            yield gateway, client
            assert not answer.is_set()
        finally:
            answer.set()


def test_stop_now_does_not_wait_behind_blocked_requests() -> None:
    with blocked(SHARED_THREADS + 1, SHARED_THREADS) as (gateway, client):
        assert client.post("/v1/robot/stop").status_code == 200
        assert gateway.backend.stopped


def test_a_task_is_cancelled_and_a_stop_cleared_while_as_many_read_as_may() -> None:
    with blocked(MOST_REQUESTS + 20, SHARED_THREADS) as (gateway, client):
        wait_until(lambda: client.get("/v1/robot").status_code == 503, 60, "no more may read")
        first, second = (gateway.backend.submit("move the mug") for _ in range(2))
        for path, status in (
            (f"/v1/tasks/{first.id}/pause", 200),
            (f"/v1/tasks/{first.id}/resume", 200),
            (f"/v1/tasks/{second.id}/cancel", 200),
            ("/v1/fleet/tasks/none/cancel", 404),
            ("/v1/robot/stop", 200),
            ("/v1/robot/clear-stop", 200),
        ):
            assert client.post(path).status_code == status, path
        assert gateway.backend.tasks[second.id].state == "cancelled"
        assert not gateway.backend.stopped


def test_the_answer_tells_the_state_after_the_stop_even_if_that_arrives_late(
    client: TestClient, backend: Backend
) -> None:
    backend.state_late_s = 0.1
    assert client.post("/v1/robot/stop").json()["state"]["stopped"]
    assert not client.post("/v1/robot/clear-stop").json()["state"]["stopped"]


def test_a_state_that_never_arrives_does_not_hold_the_answer_back(
    client: TestClient, backend: Backend
) -> None:
    backend.state_late_s = math.inf
    answer = client.post("/v1/robot/stop")
    assert answer.status_code == 200
    assert not answer.json()["state"]["stopped"]


@pytest.mark.parametrize(
    ("body", "content_type", "reason"),
    [
        (b"", "application/json", DEFAULT),
        (b'{"reason": "a cat"}', "application/json", "a cat"),
        (b'{"reason": "a cat"}', "application/x-www-form-urlencoded", "a cat"),
        (b'{"reason": "a cat", "loud": true}', "application/json", "a cat"),
        (json.dumps({"reason": 501 * "x"}).encode(), "application/json", 500 * "x"),
        (b'{"reason": "a c', "application/json", DEFAULT),
        (b'{"reason": 5}', "application/json", DEFAULT),
        (b'{"reason": "\\ud800"}', "application/json", DEFAULT),
        (b"a cat", "text/plain", DEFAULT),
        (b"[" * 50_000, "application/json", DEFAULT),
        (b'{"reason": "' + 500_000 * b"x", "application/json", DEFAULT),
    ],
)
def test_the_robot_stops_for_any_request_body(
    backend: Backend, client: TestClient, body: bytes, content_type: str, reason: str
) -> None:
    headers = {"content-type": content_type}
    answer = client.post("/v1/robot/stop", content=body, headers=headers)
    assert answer.status_code == 200
    assert (backend.stopped, backend.stop_reason) == (True, reason)


def test_the_robot_stops_even_if_the_body_never_ends(
    app: FastAPI, client: TestClient, backend: Backend
) -> None:
    async def run() -> int:
        async def dribble() -> AsyncIterator[bytes]:
            yield b'{"reason": "a c'
            await asyncio.Event().wait()

        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as there:
            return (await there.post("/v1/robot/stop", content=dribble())).status_code

    assert asyncio.run(run()) == 200
    assert backend.stopped


@given(st.binary() | st.text().map(lambda text: json.dumps({"reason": text}).encode()))
def test_every_body_gives_a_stop_reason_that_can_be_serialized(body: bytes) -> None:
    assert len(pb.StopRequest(reason=stop_reason(body)).SerializeToString()) < 2100


def test_the_openapi_description_documents_the_body_of_stop_now(client: TestClient) -> None:
    stop = client.get("/openapi.json").json()["paths"]["/v1/robot/stop"]["post"]
    schema = stop["requestBody"]["content"]["application/json"]["schema"]
    assert list(schema["properties"]) == ["reason"]
    assert not stop["requestBody"]["required"]
