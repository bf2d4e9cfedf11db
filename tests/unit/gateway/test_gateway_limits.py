"""Requests that the gateway refuses: before it reads their content, or while another one runs."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest
from fastapi.testclient import TestClient
from helios_core import proto as pb
from helios_core.memory_bus import MemoryBus
from helios_core.topics import SAVE_MAP2D
from helios_gateway.api_keys import ApiKeys
from helios_gateway.request_limits import LimitSettings, RequestLimits
from starlette.types import Message, Receive, Scope, Send

from tests.gateway_backend import Backend
from tests.gateway_process import served


@pytest.mark.parametrize("broken", ["[", "[::1", "]:80", "[x]"])
def test_a_malformed_host_or_origin_is_refused(client: TestClient, broken: str) -> None:
    assert client.get("/v1/robot", headers={"host": broken}).status_code == 403
    for origin in (broken, f"http://{broken}"):
        refused = client.post("/v1/robot/clear-stop", headers={"origin": origin})
        assert refused.status_code == 403


def test_only_the_exact_addresses_accept_large_bodies(client: TestClient, backend: Backend) -> None:
    body = bytes(100_000)
    for verb, path in (
        ("PUT", "/v1/tasks/map.zip"),
        ("POST", "/v1/tasks/frames"),
        ("DELETE", "/v1/map.zip"),
        ("PUT", "/v1/frames"),
        ("POST", "/v1/tasks/robot/stop"),
    ):
        assert client.request(verb, path, content=body).status_code == 413


@pytest.mark.parametrize("path", ["/v1/map.zip", "/v1/map/ros.zip"])
def test_a_second_file_of_a_map_is_refused_while_one_is_made(path: str) -> None:
    asked, answer = threading.Event(), threading.Event()

    def slow(_: pb.SaveMap2DRequest) -> pb.SaveMap2DReply:
        asked.set()
        answer.wait(60)
        return pb.SaveMap2DReply(files=[pb.Map2DFile(name="map.pgm", data=b"walls")])

    with served() as gateway, ThreadPoolExecutor(1) as people:
        MemoryBus(gateway.backend.hub).serve(SAVE_MAP2D, slow)
        try:
            first = people.submit(httpx.get, gateway.url + path, timeout=60)
            assert asked.wait(20)
            second = httpx.get(f"{gateway.url}/v1/map/ros.zip", timeout=20)
            assert (second.status_code, second.headers["retry-after"]) == (503, "1")
        finally:
            answer.set()
        assert first.result(20).status_code == 200


def test_a_request_whose_client_leaves_within_the_body_is_not_carried_out() -> None:
    received: list[Message] = [
        {"type": "http.request", "body": b'{"instruction": "find the mug"}', "more_body": True},
        {"type": "http.disconnect"},
    ]
    carried_out, sent = [], []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        carried_out.append(await receive())

    async def receive() -> Message:
        return received.pop(0)

    async def send(message: Message) -> None:
        sent.append(message)

    bounds = LimitSettings(
        body_bytes=1000, large_bytes=1000, map_bytes=1000, body_s=20, requests_per_s=9, requests=9
    )
    scope = {
        "type": "http",
        "method": "POST",
        "path": "/v1/tasks",
        "headers": [(b"host", b"localhost")],
    }
    asyncio.run(RequestLimits(app, bounds, ApiKeys(None))(scope, receive, send))
    assert carried_out == sent == []
