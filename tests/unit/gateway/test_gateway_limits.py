"""Requests that the gateway refuses: before it reads their content, or while another one runs."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from helios_client.commands.api_keys import add_key
from helios_core import proto as pb
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import SAVE_MAP2D
from helios_gateway.api_keys import ApiKeys
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.request_limits import LimitSettings, RequestLimits
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app
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


# --- requests without a key, or with too low a scope ----------------------------------------------
FEW = 3  # concurrent requests of each kind


class Guarded:
    """An application that requires keys and answers FEW requests of each kind at a time."""

    def __init__(self, hub: MemoryHub, live: RobotMonitor, folder: Path) -> None:
        file = folder / "keys.toml"
        self.keys = {scope: add_key(file, scope, scope) for scope in ("read", "task", "robot")}
        flags = ["--keys", str(file), "--max-requests", str(FEW), "--requests-per-s", "20"]
        flags += ["--body-timeout-s", "600"]
        robots = RobotRegistry({"robot": RobotEndpoint(MemoryBus(hub), live)})
        self.app: FastAPI = create_app(robots, Settings.load(flags))

    def client(self, who: str = "", host: str = "10.0.0.1") -> httpx.AsyncClient:
        headers = {"authorization": f"Bearer {self.keys[who]}"} if who else {}
        transport = httpx.ASGITransport(self.app, client=(host, 1))
        return httpx.AsyncClient(transport=transport, base_url="http://localhost", headers=headers)

    async def status(self, who: str, verb: str, path: str) -> int:
        """Status of a request from a second machine."""
        async with self.client(who, "10.0.0.2") as client:
            return (await client.request(verb, path)).status_code


@pytest.fixture
def guarded(
    hub: MemoryHub,
    backend: Backend,
    live: RobotMonitor,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Guarded:
    monkeypatch.setattr("helios_gateway.request_limits.STALL_S", 600)
    return Guarded(hub, live, tmp_path)


@asynccontextmanager
async def slow_requests(guarded: Guarded, who: str, path: str) -> AsyncIterator[list[int]]:
    """Twice as many requests as may run, each with a body without an end; yields their statuses."""
    begun, end = [asyncio.Event() for _ in range(2 * FEW)], asyncio.Event()
    statuses: list[int] = []

    async def body(number: int) -> AsyncIterator[bytes]:
        begun[number].set()
        yield b"{"
        await end.wait()

    async def send(client: httpx.AsyncClient, number: int) -> None:
        answer = await client.post(path, content=body(number))
        begun[number].set()  # it was refused before its body was read
        if not end.is_set():
            statuses.append(answer.status_code)

    async with guarded.client(who) as client:
        tasks = [asyncio.create_task(send(client, number)) for number in range(2 * FEW)]
        for one in begun:
            await asyncio.wait_for(one.wait(), 60)
        yield statuses
        end.set()
        await asyncio.gather(*tasks)


@pytest.mark.parametrize(
    ("path", "refused"),
    [
        ("/v1/tasks", [401] * 2 * FEW),
        ("/v1/robot/clear-stop", [401] * 2 * FEW),
        ("/v1/robots/robot/tasks/t1/cancel", [401] * 2 * FEW),
        ("/v1/nothing", [401] * 2 * FEW),
        ("/v1/session", [503] * FEW),  # the sign-in: as many as may wait
    ],
)
def test_slow_requests_without_a_key_block_no_request_with_one(
    guarded: Guarded, path: str, refused: list[int]
) -> None:
    async def run() -> None:
        async with slow_requests(guarded, "", path) as statuses:
            assert await guarded.status("read", "GET", "/v1/status") == 200
            assert await guarded.status("task", "POST", "/v1/robot/stop") == 200
            assert await guarded.status("robot", "POST", "/v1/robot/clear-stop") == 200
            assert await guarded.status("", "GET", "/healthz") == 200
            assert await guarded.status("", "GET", "/readyz") == 200
            assert statuses == refused

    asyncio.run(run())


def test_slow_readers_without_a_key_block_no_request_with_one(guarded: Guarded) -> None:
    async def run() -> None:
        read, begun = asyncio.Event(), []

        async def send(message: Message) -> None:
            if "status" in message:
                begun.append(message["status"])
            await read.wait()

        async def receive() -> Message:
            await read.wait()
            return {"type": "http.disconnect"}

        scope = {"type": "http", "method": "GET", "path": "/", "headers": [], "query_string": b""}
        readers = [
            asyncio.create_task(guarded.app(dict(scope), receive, send)) for _ in range(2 * FEW)
        ]
        async with asyncio.timeout(60):
            while len(begun) < 2 * FEW:
                await asyncio.sleep(0.01)
        assert sorted(begun) == [200] * FEW + [503] * FEW
        assert await guarded.status("", "GET", "/") == 503
        assert await guarded.status("read", "GET", "/") == 200
        assert await guarded.status("", "GET", "/readyz") == 200
        read.set()
        await asyncio.gather(*readers)

    asyncio.run(run())


def test_a_key_of_too_low_a_scope_cannot_block_a_cleared_stop(guarded: Guarded) -> None:
    async def run() -> None:
        for who, path in (("read", "/v1/tasks/t1/cancel"), ("task", "/v1/robot/clear-stop")):
            async with slow_requests(guarded, who, path) as statuses:
                assert await guarded.status("robot", "POST", "/v1/robot/clear-stop") == 200
                assert statuses == [403] * 2 * FEW

    asyncio.run(run())


@pytest.mark.parametrize("path", ["/healthz", "/readyz"])
def test_no_limit_applies_to_the_probes(guarded: Guarded, path: str) -> None:
    async def run() -> None:
        async with slow_requests(guarded, "task", "/v1/tasks"), guarded.client() as client:
            assert await guarded.status("read", "GET", "/v1/status") == 503
            answers = [await client.get(path) for _ in range(100)]
            assert {answer.status_code for answer in answers} == {200}

    asyncio.run(run())
