"""The record of changes over HTTP: who asked for what, when, and the answer."""

from __future__ import annotations

import asyncio
import datetime as dt
import json
import stat
import threading
from pathlib import Path
from typing import Any
from unittest.mock import AsyncMock

import pytest
from fastapi.testclient import TestClient
from helios_client.commands.api_keys import add_key
from helios_core.errors import InvalidInput
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway import audit_log
from helios_gateway.api_keys import ApiKeys
from helios_gateway.audit_log import AuditLog
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app
from hypothesis import given, settings
from hypothesis import strategies as st
from starlette.requests import ClientDisconnect
from starlette.testclient import WebSocketDenialResponse

from tests.gateway_backend import Backend

TASK = {"instruction": "move the mug to the kitchen counter"}


class Recorded:
    """An application with keys, and its record."""

    def __init__(self, hub: MemoryHub, live: RobotMonitor, folder: Path) -> None:
        self.file = folder / "audit.jsonl"
        keys = folder / "keys.toml"
        self.keys = {s: add_key(keys, s, s) for s in ("read", "task", "robot", "admin")}
        self.log = AuditLog(self.file)
        fleet = RobotRegistry({"robot": RobotEndpoint(MemoryBus(hub), live)})
        self.app = create_app(fleet, Settings.load([]), ApiKeys(keys), self.log)

    def client(self, who: str = "") -> TestClient:
        headers = {"authorization": f"Bearer {self.keys[who]}"} if who else {}
        return TestClient(self.app, "http://localhost", headers=headers)

    def lines(self) -> list[dict[str, Any]]:
        """All entries so far of requests with a key. Ends the record."""
        self.log.close()
        return read(self.file)

    def keyless(self) -> list[dict[str, Any]]:
        """All entries of the others, once the record has ended."""
        return read(self.file.with_name("audit-without-key.jsonl"))


def read(file: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in file.read_text("utf-8").splitlines()]


@pytest.fixture
def recorded(hub: MemoryHub, backend: Backend, live: RobotMonitor, tmp_path: Path) -> Recorded:
    return Recorded(hub, live, tmp_path)


def test_a_change_is_recorded_with_who_what_when_and_the_answer(recorded: Recorded) -> None:
    before = dt.datetime.now(dt.UTC)
    made = recorded.client("task").post("/v1/tasks?x=1", json=TASK)
    [entry] = recorded.lines()
    at = dt.datetime.fromisoformat(entry.pop("at"))
    assert before - dt.timedelta(milliseconds=1) <= at <= dt.datetime.now(dt.UTC)
    assert json.loads(entry.pop("request")) == TASK
    assert made.json()["id"] in entry.pop("answer")
    assert entry == {
        "who": "task",
        "scope": "task",
        "host": "testclient",
        "method": "POST",
        "path": "/v1/tasks?x=1",
        "status": 202,
    }


def test_refusals_and_stops_are_recorded_and_reading_is_not(recorded: Recorded) -> None:
    recorded.client("read").get("/v1/tasks")
    recorded.client("read").post("/v1/tasks", json=TASK)
    recorded.client().post("/v1/tasks", json=TASK)
    recorded.client("read").post("/v1/robot/stop", json={"reason": "a cat"})
    recorded.client("task").post("/v1/robot/clear-stop")
    recorded.client("admin").post("/v1/tasks", headers={"origin": "http://evil"}, json=TASK)
    entries = recorded.lines()
    assert [(e["who"], e["path"], e["status"]) for e in entries] == [
        ("read", "/v1/tasks", 403),
        ("read", "/v1/robot/stop", 200),
        ("task", "/v1/robot/clear-stop", 403),
        ("admin", "/v1/tasks", 403),
    ]
    assert "a cat" in entries[1]["request"]
    assert "scope robot" in entries[2]["answer"]
    assert [(e["path"], e["status"]) for e in recorded.keyless()] == [("/v1/tasks", 401)]


def test_requests_without_a_key_replace_no_line_about_a_change(
    hub: MemoryHub,
    backend: Backend,
    live: RobotMonitor,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(audit_log, "FILE_BYTES", 4000)
    monkeypatch.setattr(audit_log, "KEYLESS_BYTES", 1000)
    recorded = Recorded(hub, live, tmp_path)
    assert recorded.client("task").post("/v1/tasks", json=TASK).status_code == 202
    stranger = recorded.client()
    for path in ("/v1/tasks", "/v1/tasks/", "/v1/session", "/v1/nothing"):
        for _ in range(20):
            stranger.post(path, json=TASK, follow_redirects=False)
            stranger.delete(path)
    assert [(e["who"], e["status"]) for e in recorded.lines()] == [("task", 202)]
    kept = sorted(tmp_path.glob("audit-without-key.jsonl*"))
    assert len(kept) == audit_log.OLD_FILES + 1
    assert sum(file.stat().st_size for file in kept) < 10_000


def test_no_key_is_written_to_the_record(recorded: Recorded) -> None:
    client = recorded.client()
    assert client.post("/v1/session", json={"key": recorded.keys["admin"]}).status_code == 200
    recorded.client().post("/v1/session", json={"key": "guessed-key"})
    recorded.client().post("/v1/session/", json={"key": "guessed-key"}, follow_redirects=False)
    client.post("/v1/robot/stop")
    entries = recorded.lines()
    assert [e["who"] for e in entries] == ["admin"]
    assert [(e["who"], e["status"]) for e in recorded.keyless()] == [
        (None, 200),
        (None, 401),
        (None, 307),
    ]
    text = "".join(file.read_text() for file in recorded.file.parent.glob("audit*"))
    assert not any(key in text for key in (*recorded.keys.values(), "guessed-key"))


def test_a_socket_is_recorded_when_it_opens_ends_and_is_refused(recorded: Recorded) -> None:
    url = "ws://localhost/v1/robot/teleop"
    with recorded.client("robot").websocket_connect(url) as socket:
        socket.receive_json()
        socket.send_json({"forward": 0, "turn": 0})
        socket.send_json({})
    with (
        pytest.raises(WebSocketDenialResponse),
        recorded.client("task").websocket_connect(url),
    ):
        pass
    assert [(e["who"], e["method"], e["status"], e["answer"]) for e in recorded.lines()] == [
        ("robot", "WEBSOCKET", 101, "opened"),
        ("robot", "WEBSOCKET", 0, "ended, 2 messages"),
        ("task", "WEBSOCKET", 403, "refused"),
    ]


def test_only_the_owner_can_read_the_record_and_its_old_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(audit_log, "FILE_BYTES", 200)
    log = AuditLog(tmp_path / "audit.jsonl")
    for number in range(20):
        log.write({"path": f"/v1/tasks/{number}"})
    log.close()
    files = sorted(tmp_path.iterdir())
    assert len(files) == audit_log.OLD_FILES + 2
    assert {stat.S_IMODE(file.stat().st_mode) for file in files} == {0o600}
    files[0].chmod(0o644)
    with pytest.raises(InvalidInput, match="chmod 600"):
        AuditLog(files[0])
    with pytest.raises(InvalidInput, match="choose another with --audit"):
        AuditLog(tmp_path / "none" / "audit.jsonl")


@given(body=st.binary(max_size=3000), kind=st.sampled_from(["application/json", "image/png", ""]))
@settings(max_examples=40)
def test_every_body_becomes_one_short_line_of_json(
    body: bytes, kind: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    async def app(scope: Any, receive: Any, send: Any) -> None:
        while (await receive()).get("more_body"):
            pass
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": body})

    file = tmp_path_factory.mktemp("audit") / "audit.jsonl"
    log = AuditLog(file)
    client = TestClient(audit_log.AuditMiddleware(app, log, ApiKeys(None)))
    client.post("/v1/tasks", content=body, headers={"content-type": kind})
    log.close()
    [line] = file.read_text("utf-8").split("\n")[:-1]
    entry = json.loads(line)
    assert (entry["status"], entry["who"]) == (200, None)
    assert len(entry["request"]) <= audit_log.KEPT_BYTES + 1


@pytest.mark.parametrize(
    ("began", "raised", "recorded"),
    [
        (False, RuntimeError, 500),
        (True, RuntimeError, 202),
        (False, ClientDisconnect, 0),
        (False, asyncio.CancelledError, 0),
    ],
)
def test_a_fault_of_the_gateway_is_recorded_as_500_and_a_client_that_has_gone_as_0(
    tmp_path: Path, began: bool, raised: type[BaseException], recorded: int
) -> None:
    async def app(scope: Any, receive: Any, send: Any) -> None:
        if began:
            await send({"type": "http.response.start", "status": 202, "headers": []})
        raise raised

    log = AuditLog(tmp_path / "audit.jsonl")
    middleware = audit_log.AuditMiddleware(app, log, ApiKeys(None))
    scope = {"type": "http", "method": "POST", "path": "/v1/tasks", "headers": []}
    with pytest.raises(raised):
        asyncio.run(middleware(scope, AsyncMock(), AsyncMock()))
    log.close()
    assert [entry["status"] for entry in read(tmp_path / "audit.jsonl")] == [recorded]


class SlowDisk:
    """Lets the threads of a record write only once `goes_on` is set."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.goes_on = threading.Event()
        emit = audit_log._File.emit

        def slow(handler: Any, record: Any) -> None:
            self.goes_on.wait(60)
            emit(handler, record)

        monkeypatch.setattr(audit_log._File, "emit", slow)
        monkeypatch.setattr(audit_log, "WAITING", 5)


def test_all_lines_that_wait_are_written_at_the_end_even_if_the_queue_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    disk = SlowDisk(monkeypatch)
    monkeypatch.setattr(audit_log, "CLOSE_S", 60.0)
    log = AuditLog(tmp_path / "audit.jsonl")
    while not caplog.records:  # until one finds no place
        log.write({"path": "/v1/tasks"})
    threading.Timer(0.2, disk.goes_on.set).start()
    log.close()
    assert len(read(tmp_path / "audit.jsonl")) >= audit_log.WAITING
    assert len(caplog.records) == 1


def test_a_disk_that_hangs_delays_the_end_for_a_bounded_time_and_the_log_says_what_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    disk = SlowDisk(monkeypatch)
    monkeypatch.setattr(audit_log, "CLOSE_S", 0.05)
    log = AuditLog(tmp_path / "audit.jsonl")
    for _ in range(3):
        log.write({"path": "/v1/tasks"})
    log.close()
    disk.goes_on.set()
    said = [record.message for record in caplog.records if " of " in record.message]
    assert any(f" of {tmp_path / 'audit.jsonl'} are lost" in one for one in said)
