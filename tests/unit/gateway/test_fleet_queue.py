"""The fleet's queue over files that are damaged or cannot be used."""

from __future__ import annotations

import sqlite3
import time
from pathlib import Path
from typing import Any

import httpx
import pytest
from helios_core import proto as pb
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.api_keys import ApiKeys
from helios_gateway.fleet.queue import FleetQueue
from helios_gateway.fleet.records import FleetTask
from helios_gateway.service import Gateway, bind
from helios_gateway.settings import Settings

from tests.gateway_backend import Backend


def task(id: str) -> FleetTask:
    return FleetTask(id, pb.SubmitRequest(instruction=f"find the mug {'x' * 500}"), time.time())


def filled(file: Path) -> None:
    queue = FleetQueue(file)
    for number in range(100):
        queue.add(task(f"task {number}"))
    queue.close()


@pytest.mark.parametrize("damage", ["the head", "the middle"])
def test_a_damaged_file_is_put_aside_and_a_new_one_is_begun(tmp_path: Path, damage: str) -> None:
    file = tmp_path / "fleet.sqlite"
    filled(file)
    raw = bytearray(file.read_bytes())
    at = 0 if damage == "the head" else 4096
    raw[at : at + 20_000] = b"\xa5" * 20_000
    file.write_bytes(raw)
    queue = FleetQueue(file)
    assert queue.tasks() == []
    assert "fleet.sqlite.damaged-1" in queue.said
    assert (tmp_path / "fleet.sqlite.damaged-1").read_bytes() == bytes(raw)
    queue.add(task("new"))
    queue.close()
    again = FleetQueue(file)
    assert [one.id for one in again.tasks()] == ["new"]
    assert (again.said, again.fault) == ("", "")


def test_a_file_that_can_only_be_read_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, connect = tmp_path / "fleet.sqlite", sqlite3.connect
    filled(file)

    def read_only(path: Path | str, **kwargs: Any) -> sqlite3.Connection:
        return connect(f"file:{path}?mode=ro" if path == file else path, uri=True, **kwargs)

    monkeypatch.setattr(sqlite3, "connect", read_only)
    queue = FleetQueue(file)
    assert "make that file writable" in queue.fault
    queue.add(task("new"))
    assert [one.id for one in queue.tasks()] == ["new"]


@pytest.mark.parametrize("at", ["a folder", "below a file"])
def test_a_gateway_without_a_usable_queue_stops_its_robot_and_says_what_is_wrong(
    hub: MemoryHub, backend: Backend, tmp_path: Path, at: str
) -> None:
    file = tmp_path / "fleet.sqlite"
    if at == "a folder":
        file.mkdir()
    else:
        file.write_text("no folder")
        file = file / "fleet.sqlite"
    health, listener = Health(), bind("127.0.0.1", 0)
    settings = Settings.load(["--fleet-queue", str(file)])
    gateway = Gateway(
        MemoryBus(hub), health, settings, listener, ApiKeys(None), lambda name: MemoryBus(hub, name)
    )
    try:
        url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        assert httpx.post(f"{url}/v1/robot/stop", timeout=20).status_code == 200
        assert httpx.get(f"{url}/fleet", timeout=20).status_code == 200
    finally:
        gateway.close()
    assert backend.stopped
    state, reason = health.state
    assert state == "degraded"
    assert f"cannot be kept in {file}" in reason
    assert "--fleet-queue" in reason
