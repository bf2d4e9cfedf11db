"""API keys and their scopes, and requests that are refused before their body is read."""

from __future__ import annotations

import asyncio
import errno
import re
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from helios_client.commands.api_keys import add_key, remove_key, replace_key
from helios_core.errors import Conflict, InvalidInput
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.api_keys import ApiKeys, Scope
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.service import check_open
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app
from starlette.websockets import WebSocketDisconnect

from tests.gateway_backend import Backend

TASK = {"instruction": "move the mug to the kitchen counter"}


class GatewayApp:
    """An application with these flags, and clients with or without a key."""

    def __init__(self, hub: MemoryHub, live: RobotMonitor, *flags: str) -> None:
        self.app: FastAPI = create_app(
            RobotRegistry({"robot": RobotEndpoint(MemoryBus(hub), live)}),
            Settings.load(list(flags)),
        )

    def client(self, key: str = "", **headers: str) -> TestClient:
        if key:
            headers["authorization"] = f"Bearer {key}"
        return TestClient(self.app, "http://localhost", headers=headers)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "keys.toml"


def private(file: Path) -> Path:
    """An empty file that only its owner may read."""
    file.touch(mode=0o600)
    return file


@pytest.fixture
def keys(file: Path) -> dict[str, str]:
    return {scope: add_key(file, scope, scope) for scope in ("read", "task", "robot", "admin")}


@pytest.fixture
def gateway(
    hub: MemoryHub, backend: Backend, live: RobotMonitor, keys: dict[str, str], file: Path
) -> GatewayApp:
    backend.serve_settings("planner", {"agent": "helios"})
    return GatewayApp(hub, live, "--keys", str(file))


@pytest.mark.parametrize(
    ("verb", "path", "least"),
    [
        ("GET", "/v1/tasks", "read"),
        ("GET", "/v1/objects", "read"),
        ("GET", "/v1/robots", "read"),
        ("GET", "/metrics", "read"),
        ("POST", "/v1/robot/stop", "read"),
        ("POST", "/v1/tasks", "task"),
        ("POST", "/v1/robot/clear-stop", "robot"),
        ("GET", "/v1/services/planner/settings", "admin"),
    ],
)
def test_each_address_needs_its_scope(
    gateway: GatewayApp, keys: dict[str, str], verb: str, path: str, least: str
) -> None:
    body = TASK if path == "/v1/tasks" and verb == "POST" else None
    for key in ("", "nonsense"):
        refused = gateway.client(key).request(verb, path, json=body)
        assert (refused.status_code, refused.headers["www-authenticate"]) == (401, "Bearer")
        assert "helios key" in refused.json()["detail"]
    for scope in Scope:
        answer = gateway.client(keys[scope.name.lower()]).request(verb, path, json=body)
        assert (answer.status_code == 403) == (scope < Scope[least.upper()]), answer.text
        assert answer.status_code in (200, 202, 403)


OPEN = ("/healthz", "/readyz", "/v1/session")  # no key is needed
LEAST = {  # every other address needs `read`
    "post /v1/tasks": "task", "post /v1/tasks/{id}/cancel": "task",
    "post /v1/tasks/{id}/pause": "task", "post /v1/tasks/{id}/resume": "task",
    "post /v1/fleet/tasks": "task", "post /v1/fleet/tasks/{id}/cancel": "task",
    "post /v1/faults/{fault}/clear": "task", "post /v1/robot/explore": "task",
    "post /v1/robot/go": "task", "post /v1/robot/home": "task",
    "post /v1/robot/checks": "robot", "post /v1/robot/clear-stop": "robot",
    "post /v1/robot/drive": "robot", "post /v1/frames": "robot",
    "put /v1/map.zip": "admin", "post /v1/map/reset": "admin",
    "get /v1/services/{name}/settings": "admin",
}  # fmt: skip


def test_every_address_refuses_every_lower_scope_and_no_other(
    gateway: GatewayApp, keys: dict[str, str]
) -> None:
    found = {}
    for path, operations in gateway.app.openapi()["paths"].items():
        if path in OPEN or path == "/v1/events":  # a stream that does not end
            continue
        for verb in operations:
            answers = [
                gateway.client(key).request(verb.upper(), re.sub(r"\{\w+\}", "x", path)).status_code
                for key in ("", *(keys[scope.name.lower()] for scope in Scope))
            ]
            assert answers[0] == 401, path
            found[f"{verb} {path}"] = [scope.name.lower() for scope in Scope][answers.count(403)]
            refused = answers.count(403)
            assert answers[1 : 1 + refused] == [403] * refused, path
    assert {name: least for name, least in found.items() if least != "read"} == LEAST
    assert len(found) > 50


def test_health_checks_and_pages_need_no_key(gateway: GatewayApp) -> None:
    for path in ("/healthz", "/readyz", "/", "/docs", "/openapi.json", "/static/main.js"):
        assert gateway.client().get(path).status_code == 200


def test_only_a_key_gets_the_reasons_why_a_robot_is_not_ready(
    gateway: GatewayApp, keys: dict[str, str]
) -> None:
    reader = gateway.client(keys["read"])
    reader.post("/v1/robot/stop", json={"reason": "grandma is in the bathroom"})
    for key in ("", "nonsense"):
        answer = gateway.client(key).get("/readyz")
        assert (answer.status_code, answer.json()) == (
            503,
            {
                "ready": False,
                "stopped": True,
                "stop_reason": "",
                "reasons": ["send an API key to get the reasons"],
            },
        )
    answer = reader.get("/readyz")
    assert answer.status_code == 503
    assert answer.json()["stop_reason"] == "grandma is in the bathroom"
    assert "the robot is stopped" in answer.json()["reasons"][0]


def test_a_browser_keeps_its_key_in_a_cookie_that_scripts_cannot_read(
    gateway: GatewayApp, keys: dict[str, str]
) -> None:
    browser = gateway.client()
    assert browser.get("/v1/session").json() == {"required": True, "name": "", "scope": None}
    assert browser.post("/v1/session", json={"key": "guess"}).status_code == 401
    opened = browser.post("/v1/session", json={"key": keys["robot"]})
    assert opened.json() == {"required": True, "name": "robot", "scope": "robot"}
    assert "HttpOnly" in opened.headers["set-cookie"]
    assert "SameSite=strict" in opened.headers["set-cookie"]
    assert browser.get("/v1/tasks").status_code == 200
    with browser.websocket_connect("ws://localhost/v1/events/ws") as socket:
        assert socket.receive_text() == ""
    browser.delete("/v1/session")
    assert browser.get("/v1/tasks").status_code == 401
    with (
        pytest.raises(WebSocketDisconnect),
        browser.websocket_connect("ws://localhost/v1/events/ws"),
    ):
        pass


def test_a_key_that_is_removed_from_the_file_is_refused(
    gateway: GatewayApp, keys: dict[str, str], file: Path
) -> None:
    assert gateway.client(keys["read"]).get("/v1/tasks").status_code == 200
    entries = file.read_text().split("\n\n")
    file.write_text("\n\n".join(e for e in entries if '"read"' not in e))
    assert gateway.client(keys["read"]).get("/v1/tasks").status_code == 401
    file.write_text("no TOML [")  # half written: the previous keys stay valid
    assert gateway.client(keys["robot"]).get("/v1/tasks").status_code == 200


def test_no_key_is_accepted_while_the_key_file_is_empty_or_missing(
    gateway: GatewayApp, keys: dict[str, str], file: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def answer() -> int:
        return gateway.client(keys["read"]).get("/v1/tasks").status_code

    entries = file.read_text()
    assert answer() == 200
    file.write_text("")
    assert answer() == 401
    file.write_text(entries)
    assert answer() == 200
    caplog.clear()
    file.unlink()
    assert (answer(), answer()) == (401, 401)
    said = [record.message for record in caplog.records if "none is accepted" in record.message]
    assert len(said) == 1
    private(file).write_text(entries)
    assert answer() == 200
    file.write_bytes(b"\xff\xfe no text")
    assert answer() == 200


@pytest.mark.parametrize("step", ["read_text", "stat"])
def test_a_removed_key_is_refused_as_soon_as_the_file_can_be_read_again(
    gateway: GatewayApp,
    keys: dict[str, str],
    file: Path,
    step: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def answer() -> int:
        return gateway.client(keys["read"]).get("/v1/tasks").status_code

    def fails(path: Path, *args: Any, **kwargs: Any) -> Any:
        if path == file:
            raise OSError(errno.EMFILE, "Too many open files")
        return works(path, *args, **kwargs)

    assert answer() == 200
    remove_key(file, "read")
    works = getattr(Path, step)
    with monkeypatch.context() as patch:
        patch.setattr(Path, step, fails)
        assert (answer(), answer()) == (200, 200)  # the keys of before
    assert answer() == 401
    said = [r.message for r in caplog.records if "Too many open files" in r.message]
    assert len(said) == 1


def test_the_key_file_contains_no_key_and_is_readable_only_by_its_owner(
    keys: dict[str, str], file: Path
) -> None:
    assert not any(key in file.read_text() for key in keys.values())
    assert file.stat().st_mode & 0o077 == 0
    with pytest.raises(Conflict, match="choose another name"):
        add_key(file, "read", "read")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "key"),
        ("key = 5", "key"),
        ("[[key]]\nname = 'a'\nscope = 'king'\nsha256 = '" + 64 * "0" + "'", "no scope"),
        ("[[key]]\nname = 'a'\nscope = ['read']\nsha256 = '" + 64 * "0" + "'", "no scope"),
        ("[[key]]\nname = 'a'\nscope = 'read'\nsha256 = 'short'", "sha256"),
        ("[[key", "no TOML"),
    ],
)
def test_an_invalid_key_file_is_refused(file: Path, text: str, says: str) -> None:
    private(file).write_text(text)
    with pytest.raises(InvalidInput, match=says):
        ApiKeys(file)
    with pytest.raises(InvalidInput, match="helios key"):
        ApiKeys(file.parent / "none.toml")


@pytest.mark.parametrize("mode", [0o604, 0o640, 0o660, 0o644])
def test_a_key_file_that_others_may_use_is_refused(
    gateway: GatewayApp, keys: dict[str, str], file: Path, mode: int
) -> None:
    file.chmod(mode)
    with pytest.raises(InvalidInput, match=f"mode {mode:04o}.*chmod 600 {file}"):
        ApiKeys(file)
    remove_key(file, "read")  # a running gateway keeps the keys of before
    assert gateway.client(keys["read"]).get("/v1/tasks").status_code == 200
    file.chmod(0o600)
    assert gateway.client(keys["read"]).get("/v1/tasks").status_code == 401


def test_a_key_is_replaced_and_removed_without_a_restart(
    gateway: GatewayApp, keys: dict[str, str], file: Path
) -> None:
    def answer(key: str) -> int:
        return gateway.client(key).post("/v1/tasks", json=TASK).status_code

    assert (answer(keys["task"]), answer(keys["robot"])) == (202, 202)
    fresh = replace_key(file, "task")
    assert (answer(keys["task"]), answer(fresh), answer(keys["robot"])) == (401, 202, 202)
    remove_key(file, "task")
    assert (answer(fresh), answer(keys["robot"])) == (401, 202)


def test_a_key_of_an_earlier_version_keeps_its_permissions(
    gateway: GatewayApp, keys: dict[str, str], file: Path
) -> None:
    file.write_text(file.read_text().replace('scope = "robot"', 'scope = "operate"'))
    client = gateway.client(keys["robot"])
    assert client.get("/v1/session").json()["scope"] == "robot"
    assert client.post("/v1/robot/clear-stop").status_code == 200
    assert client.get("/v1/services/planner/settings").status_code == 403


def test_a_binary_key_file_is_refused(file: Path) -> None:
    private(file).write_bytes(b"\xff\xfe")
    with pytest.raises(InvalidInput, match="no TOML"):
        ApiKeys(file)


def test_keys_are_required_beyond_loopback(file: Path, keys: dict[str, str]) -> None:
    check_open("127.0.0.1", Settings.load([]), ApiKeys(None))
    check_open("::1", Settings.load([]), ApiKeys(None))
    check_open("0.0.0.0", Settings.load([]), ApiKeys(file))
    check_open("0.0.0.0", Settings.load(["--without-keys"]), ApiKeys(None))
    with pytest.raises(InvalidInput, match="helios key"):
        check_open("0.0.0.0", Settings.load([]), ApiKeys(None))


def test_without_keys_only_local_host_names_are_accepted(client: TestClient) -> None:
    for host in ("evil.example", "localhost.evil.example", ""):
        refused = client.get("/v1/robot", headers={"host": host})
        assert (refused.status_code, refused.json()["title"]) == (403, "Forbidden")
    for host in ("localhost:8080", "127.0.0.1", "[::1]:8080", "robot.localhost"):
        assert client.get("/v1/robot", headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    ("verb", "path", "least"), [("PUT", "/v1/map.zip", "admin"), ("POST", "/v1/frames", "robot")]
)
@pytest.mark.parametrize("of_robot", ["/v1", "/v1/robots/robot"])
def test_a_large_body_is_not_read_before_its_key_is_checked(
    gateway: GatewayApp, keys: dict[str, str], verb: str, path: str, least: str, of_robot: str
) -> None:
    async def read_of(key: str) -> tuple[int, int]:
        read = 0

        async def body() -> AsyncIterator[bytes]:
            nonlocal read
            for _ in range(20):
                yield bytes(100_000)
                read += 100_000

        headers = {"authorization": f"Bearer {key}"}
        transport = httpx.ASGITransport(gateway.app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            answer = await client.request(
                verb, path.replace("/v1", of_robot), content=body(), headers=headers
            )
        return answer.status_code, read

    assert asyncio.run(read_of("")) == (401, 0)
    for scope in Scope:
        status, read = asyncio.run(read_of(keys[scope.name.lower()]))
        assert (status == 403, read == 0) == (2 * (scope < Scope[least.upper()],))


def test_requests_above_the_rate_limit_get_status_429_but_stop_now_does_not(
    hub: MemoryHub, backend: Backend, live: RobotMonitor
) -> None:
    client = GatewayApp(hub, live, "--requests-per-s", "3").client()
    answers = [client.get("/v1/robot") for _ in range(20)]
    [refused, *_] = [a for a in answers if a.status_code == 429]
    assert refused.headers["retry-after"] == "1"
    assert refused.headers["content-type"] == "application/problem+json"
    assert all(client.post("/v1/robot/stop").status_code == 200 for _ in range(10))


def test_concurrent_requests_are_limited_except_stop_now(
    hub: MemoryHub, backend: Backend, live: RobotMonitor
) -> None:
    gateway = GatewayApp(hub, live, "--max-requests", "1", "--body-timeout-s", "30")

    async def run() -> None:
        sent, done = asyncio.Event(), asyncio.Event()

        async def slow_body() -> AsyncIterator[bytes]:
            yield b'{"instruction": "move '
            sent.set()
            await done.wait()
            yield b'the mug"}'

        transport = httpx.ASGITransport(gateway.app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            headers = {"content-type": "application/json"}
            slow = asyncio.create_task(
                client.post("/v1/tasks", content=slow_body(), headers=headers)
            )
            await sent.wait()
            busy = await client.get("/v1/robot")
            assert (busy.status_code, busy.json()["type"]) == (503, "helios:busy")
            assert (await client.post("/v1/robot/stop")).status_code == 200
            done.set()
            assert (await slow).status_code == 202
            assert (await client.get("/v1/robot")).status_code == 200

    asyncio.run(run())


def test_a_slow_request_body_times_out_with_status_408(
    hub: MemoryHub, backend: Backend, live: RobotMonitor
) -> None:
    gateway = GatewayApp(hub, live, "--body-timeout-s", "0.05")

    async def run() -> httpx.Response:
        async def dribble() -> AsyncIterator[bytes]:
            yield b"{"
            await asyncio.sleep(30)

        transport = httpx.ASGITransport(gateway.app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.post("/v1/tasks", content=dribble())

    answer = asyncio.run(run())
    assert (answer.status_code, answer.json()["title"]) == (408, "Request Timeout")


def test_only_pages_of_listed_origins_may_send_requests(
    hub: MemoryHub, backend: Backend, live: RobotMonitor
) -> None:
    gateway = GatewayApp(hub, live, "--origins", "https://ops.example")
    ours, theirs = (
        gateway.client(origin="https://ops.example"),
        gateway.client(origin="https://x.example"),
    )
    assert ours.get("/v1/robot").headers["access-control-allow-origin"] == "https://ops.example"
    assert "access-control-allow-origin" not in theirs.get("/v1/robot").headers
    assert ours.post("/v1/robot/stop").status_code == 200
    assert theirs.post("/v1/robot/stop").status_code == 403
    asked = {"access-control-request-method": "POST"}
    assert ours.options("/v1/tasks", headers=asked).status_code == 200
    with (
        pytest.raises(WebSocketDisconnect),
        theirs.websocket_connect("ws://localhost/v1/events/ws"),
    ):
        pass
