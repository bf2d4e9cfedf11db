"""Answers of the HTTP interface that are none of HELIOS': redirects and foreign content."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx
import pytest
from helios_client.cli import run
from helios_client.http import requests
from helios_client.sdk import Helios
from helios_client.sdk_async import AsyncHelios
from helios_core.errors import Internal

ASKED = httpx.Request("GET", "http://robot/v1/map.zip")
TASK = requests.submit("move it", None, None, None, 0, None)
FOREIGN = (b"{}", b"[]", b'"up"', b"null", b'{"tasks": 1, "objects": [7], "settings": {}}')


def answer(status: int, kind: str, **headers: str) -> httpx.Response:
    fields = {"content-type": kind} | headers
    return httpx.Response(status, headers=fields, content=b"x", request=ASKED)


def test_a_redirect_is_no_answer_and_its_goal_is_named() -> None:
    moved = answer(301, "text/html", location="https://robot/v1/map.zip")
    with pytest.raises(
        Internal, match=r"redirects to https://robot/v1/map\.zip; give that address"
    ):
        requests.save_map().answer(moved)


@pytest.mark.parametrize(
    ("call", "kind"),
    [(requests.save_map(), "application/zip"), (requests.camera(), "image/jpeg")],
    ids=["map", "camera"],
)
def test_content_of_another_kind_is_refused(call: requests.Call[bytes], kind: str) -> None:
    assert call.answer(answer(200, kind)) == b"x"
    with pytest.raises(Internal, match=rf"answered text/html; charset=utf-8, not {kind}"):
        call.answer(answer(200, "text/html; charset=utf-8"))


@pytest.mark.parametrize("body", [*FOREIGN, b""])
@pytest.mark.parametrize(
    "call",
    [
        TASK, requests.task("t1"), requests.tasks(None, None), requests.cancel("t1"),
        requests.decisions("t1"), requests.trace("t1"), requests.faults(),
        requests.clear_fault("f"), requests.fleet(), requests.submit_to_fleet(TASK, "any"),
        requests.fleet_tasks(None, None), requests.vocabulary(), requests.suggestions(3),
        requests.objects(None, None), requests.stored_objects(None, None),
        requests.found_object(1), requests.map_info(), requests.frontiers(),
        requests.arrays("occupancy"), requests.ros_map(), requests.load_map(b"", False),
        requests.reset_map(None), requests.seen("mug", 5), requests.object_views(1, 5),
        requests.robot(), requests.stop_robot("x"), requests.clear_stop(), requests.home(),
        requests.drive(0.1, 0.0), requests.robot_checks(False), requests.status(None),
        requests.status("second"),
    ],
    ids=lambda call: f"{call.verb} {call.path}",
)  # fmt: skip
def test_an_answer_of_another_form_is_refused(call: requests.Call[Any], body: bytes) -> None:
    with pytest.raises(Internal, match=r"http://robot/v1/map\.zip answered .*; is HELIOS there\?"):
        call.answer(httpx.Response(200, content=body, request=ASKED))


def test_both_clients_refuse_an_answer_of_another_form() -> None:
    def empty(_: httpx.Request) -> httpx.Response:
        return httpx.Response(200, json={})

    with pytest.raises(Internal, match="something else than expected"):
        Helios("robot", transport=httpx.MockTransport(empty)).status()
    with pytest.raises(Internal, match="something else than expected"):
        asyncio.run(AsyncHelios("robot", transport=httpx.MockTransport(empty)).status())


class ForeignServer(BaseHTTPRequestHandler):
    """Answers every request with the JSON `body`."""

    body = b"{}"

    def _answer(self) -> None:
        self.rfile.read(int(self.headers["content-length"] or 0))
        self.send_response(200)
        self.send_header("content-length", str(len(self.body)))
        self.end_headers()
        self.wfile.write(self.body)

    do_GET = do_POST = do_PUT = _answer

    def log_message(self, format: str, *args: Any) -> None:
        return


@pytest.fixture
def foreign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ThreadingHTTPServer]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), ForeignServer) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()


@pytest.mark.parametrize("body", FOREIGN)
def test_every_command_reports_a_server_that_is_not_helios_in_one_sentence(
    body: bytes,
    foreign: ThreadingHTTPServer,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.setattr(ForeignServer, "body", body)
    (tmp_path / "map.zip").write_bytes(b"")
    for words in (
        ["status"], ["tasks"], ["tasks", "--robot", "any"], ["objects"], ["fleet"], ["faults"],
        ["names"], ["names", "--here"], ["why"], ["cancel", "t1"], ["cancel", "--all"],
        ["go", "1", "2"], ["task", "x", "--no-wait"], ["seen", "mug"], ["stop"], ["clear-stop"],
        ["map", "export", "--out", str(tmp_path)], ["map", "reset", "--yes"],
        ["map", "export", "--ros", "--out", str(tmp_path)],
        ["map", "load", str(tmp_path / "map.zip")], ["doctor", "--robot"],
    ):  # fmt: skip
        assert run([*words, "--port", str(foreign.server_address[1])]) == 1
        said = capsys.readouterr()
        assert "is HELIOS there?" in said.err
        assert said.err.count("\n") == 1
