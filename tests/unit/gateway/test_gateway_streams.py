"""Streams end with their task, and with the key that opened them."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from helios_client.commands.api_keys import add_key
from helios_core import proto as pb
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import GET_TASK
from helios_gateway.bus_listener import RobotMonitor
from starlette.websockets import WebSocketDisconnect
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from tests.gateway_backend import Backend
from tests.gateway_process import Served, served
from tests.support import read_to_the_end, wait_until
from tests.unit.gateway.gateway_frames import COLOR, DEPTH, META, Bridge

INSTRUCTION = "move the mug to the kitchen counter"


def test_the_end_of_a_task_ends_a_stream_without_task_events(
    backend: Backend, client: TestClient
) -> None:
    backend.submit(INSTRUCTION)
    with client.websocket_connect("ws://localhost/v1/events/ws?types=plan&task_id=t1") as socket:
        assert socket.receive_text() == ""
        backend.publish_plan()
        assert socket.receive_json()["type"] == "plan"
        backend.decide()
        backend.change_task("t1", "running")
        backend.change_task("t1", "succeeded")
        backend.publish_plan()
        with pytest.raises(WebSocketDisconnect):
            socket.receive_text()


def test_a_task_that_ends_during_the_request_ends_the_stream(
    app: FastAPI, client: TestClient, hub: MemoryHub, backend: Backend, live: RobotMonitor
) -> None:
    backend.submit(INSTRUCTION)
    backend.submit(INSTRUCTION)

    def ends_meanwhile(request: pb.TaskRequest) -> pb.Task:
        asked = pb.Task()
        asked.CopyFrom(backend.tasks[request.id])
        backend.change_task("t1", "succeeded")
        backend.change_task("t2", "running")  # the newest state is of another task
        return asked

    MemoryBus(hub).serve(GET_TASK, ends_meanwhile)

    async def run() -> str:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as there:
            async with asyncio.timeout(10):
                return (await there.get("/v1/events?types=task&task_id=t1")).text

    reported = [line for line in asyncio.run(run()).splitlines() if line.startswith("data: ")]
    states = [json.loads(line.removeprefix("data: "))["state"] for line in reported]
    assert states == ["queued", "succeeded"]
    assert live.events.viewers == 0


def test_a_stream_of_an_unknown_task_leaves_no_viewer(
    client: TestClient, backend: Backend, live: RobotMonitor
) -> None:
    assert client.get("/v1/events?task_id=none").status_code == 404
    assert live.events.viewers == 0


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "keys.toml"


@pytest.fixture
def key(file: Path) -> str:
    return add_key(file, "tablet", "robot")


@pytest.fixture
def gateway(file: Path, key: str) -> Iterator[Served]:
    with served("--keys", str(file), "--keepalive-s", "0.2") as out:
        yield out


def _send(socket: Connection) -> None:
    for message in (json.dumps(META), COLOR, DEPTH):
        socket.send(message)


def bearer(key: str) -> dict[str, str]:
    return {"authorization": f"Bearer {key}"}


def test_a_revoked_key_ends_its_event_stream(gateway: Served, file: Path, key: str) -> None:
    with httpx.stream("GET", f"{gateway.url}/v1/events", headers=bearer(key), timeout=20) as stream:
        lines = stream.iter_lines()
        assert next(line for line in lines if line == ": still here")
        rest = read_to_the_end(lines)
        file.write_text("")
        assert rest.wait(20), "the stream has not ended"


def test_a_revoked_key_ends_a_stream_that_is_never_silent(
    gateway: Served, file: Path, key: str
) -> None:
    address = f"ws://127.0.0.1:{gateway.port}/v1/events/ws?types=task"
    with connect(address, additional_headers=bearer(key)) as socket:
        assert socket.recv(timeout=10) == ""
        file.write_text("")

        def goes_on() -> bool:
            gateway.backend.submit(INSTRUCTION)
            with contextlib.suppress(ConnectionClosed):
                socket.recv(timeout=10)
                return True
            return False

        wait_until(lambda: not goes_on(), 60, "the stream has ended")


def test_a_revoked_key_ends_its_frame_socket(gateway: Served, file: Path, key: str) -> None:
    bridge = Bridge(gateway.backend.hub)
    address = f"ws://127.0.0.1:{gateway.port}/v1/frames/ws"
    with connect(address, additional_headers=bearer(key)) as socket:
        _send(socket)
        assert json.loads(socket.recv(timeout=10))["integrated"]
        file.write_text("")
        _send(socket)
        assert json.loads(socket.recv(timeout=10))["status"] == 401
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=10)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1008
    assert len(bridge.requests) == 1
