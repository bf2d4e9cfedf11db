"""`supervisor.json` and the lock of the state directory."""

from __future__ import annotations

import json
import os
import subprocess
import threading
import time
from pathlib import Path

import httpx
import pytest
from helios_client.answer_types import Status
from helios_client.commands.status import closing_lines, find_status
from helios_client.sdk import Helios
from helios_client.supervision import state_file
from helios_core.errors import HeliosError, Internal, InvalidInput, Unavailable

from tests.gateway_process import served
from tests.support import free_port, wait_until

STATUS = {"ready": True, "services": []}


def test_a_written_status_is_read_back(tmp_path: Path) -> None:
    state_file.write([tmp_path / "a", tmp_path / "b"], STATUS)
    for folder in ("a", "b"):
        read = state_file.read(tmp_path / folder)
        assert read is not None
        assert read["ready"] is True
        assert read["supervisor_pid"] == os.getpid()


def test_a_reader_never_sees_a_partial_file(tmp_path: Path) -> None:
    ending = threading.Event()

    def write() -> None:
        while not ending.is_set():
            state_file.write([tmp_path], {"ready": True, "services": ["x" * 200_000]})

    state_file.write([tmp_path], STATUS)
    writer = threading.Thread(target=write)
    writer.start()
    try:
        for _ in range(100):
            assert json.loads((tmp_path / state_file.FILE_NAME).read_text())["ready"] is True
    finally:
        ending.set()
        writer.join()


def test_the_file_of_an_ended_supervisor_is_ignored(tmp_path: Path) -> None:
    gone = subprocess.Popen(["true"])
    gone.wait()
    text = json.dumps(STATUS | {"supervisor_pid": gone.pid, "updated_s": time.time()})
    (tmp_path / state_file.FILE_NAME).write_text(text)
    assert state_file.read(tmp_path) is None


def test_a_stale_file_is_ignored(tmp_path: Path) -> None:
    old = time.time() - state_file.STALE_S - 1
    text = json.dumps(STATUS | {"supervisor_pid": os.getpid(), "updated_s": old})
    (tmp_path / state_file.FILE_NAME).write_text(text)
    assert state_file.read(tmp_path) is None


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"updated_s": "x"}'])
def test_a_corrupt_file_is_ignored(tmp_path: Path, text: str) -> None:
    (tmp_path / state_file.FILE_NAME).write_text(text)
    assert state_file.read(tmp_path) is None


def test_a_state_directory_has_only_one_lock_holder(tmp_path: Path) -> None:
    with state_file.lock(tmp_path), pytest.raises(state_file.StateDirLocked):
        state_file.lock(tmp_path)
    state_file.lock(tmp_path).close()


def test_the_default_directory_depends_on_the_port(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert state_file.default_state_dir(8080) == tmp_path / "helios" / "8080"
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert state_file.default_state_dir(1) == tmp_path / ".local" / "state" / "helios" / "1"


def test_status_comes_from_the_file_while_the_gateway_is_unreachable(tmp_path: Path) -> None:
    state_file.write([tmp_path], STATUS | {"address": "http://127.0.0.1:1"})
    port = free_port()
    with Helios(f"http://127.0.0.1:{port}") as nobody:
        found = find_status(nobody, port, tmp_path)
        assert found == STATUS | {"stopped": None, "stop_reason": ""}
        (line,) = closing_lines(found)
        assert line.startswith("all processes are ready; the gateway does not answer, so it is not")
        state_file.remove([tmp_path])
        with pytest.raises(Unavailable, match="helios up"):
            find_status(nobody, port, tmp_path)


@pytest.mark.parametrize(
    ("status", "body", "kind"),
    [
        (401, {"detail": "a key is needed"}, InvalidInput),
        (403, {"detail": "the key is of another scope"}, InvalidInput),
        (500, {}, Internal),
        (200, {}, Internal),
    ],
)
def test_a_refusal_by_the_gateway_is_reported_despite_the_file(
    status: int, body: dict, kind: type[HeliosError], tmp_path: Path
) -> None:
    state_file.write([tmp_path], STATUS)
    answer = httpx.MockTransport(lambda _: httpx.Response(status, json=body))
    with Helios("http://robot", transport=answer) as helios, pytest.raises(kind):
        find_status(helios, 8080, tmp_path)


def test_a_gateway_that_is_starting_leaves_the_status_to_the_file(tmp_path: Path) -> None:
    state_file.write([tmp_path], STATUS)
    answer = httpx.MockTransport(lambda _: httpx.Response(503, json={"detail": "starting"}))
    with Helios("http://robot", transport=answer) as helios:
        assert find_status(helios, 8080, tmp_path)["stopped"] is None


def test_the_gateway_says_whether_a_task_can_be_done_and_the_file_lists_the_processes(
    tmp_path: Path,
) -> None:
    with served() as gateway, Helios(gateway.url) as helios:

        def found() -> Status:
            return find_status(helios, gateway.port, tmp_path)

        for processes_run in (True, False):
            state_file.write([tmp_path], STATUS | {"ready": processes_run})
            wait_until(lambda: found()["ready"], 60, "the gateway is ready")
            assert found()["services"] == []
        helios.stop_robot("a child")
        wait_until(lambda: not found()["ready"], 60, "it is stopped, so not ready")
        assert found()["stopped"]
