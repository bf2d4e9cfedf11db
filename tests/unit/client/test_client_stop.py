"""`helios stop` by its two code paths: the quick stop and the full command."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
import typer
from helios_client import quick_stop
from helios_client.__main__ import main
from helios_client.cli import app, run

from tests.support import free_port

ANSWER = {"connected": True, "state": {"stopped": True, "message": "ü"}, "description": None}


def answer(**changes: Any) -> bytes:
    return json.dumps(ANSWER | changes).encode()


@dataclass
class Gateway:
    """Accepts every request and answers with `status` and `body`."""

    port: int
    status: int = 200
    body: bytes = json.dumps(ANSWER).encode()
    asked: list[tuple[str, str, str | None, Any]] = field(default_factory=list)


@pytest.fixture
def gateway() -> Iterator[Gateway]:
    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["content-length"])))
            key = self.headers["authorization"]
            known.asked.append((self.path, self.headers["content-type"], key, body))
            self.send_response(known.status)
            self.send_header("content-length", str(len(known.body)))
            self.end_headers()
            self.wfile.write(known.body)

        def log_message(self, format: str, *args: Any) -> None:
            return

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    known = Gateway(server.server_address[1])
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield known
    server.shutdown()
    server.server_close()


@dataclass(frozen=True)
class CommandResult:
    status: int
    out: str
    error: str


class StopPaths:
    """Runs a command line by either code path.

    HOME has no state folder; PORT in the arguments is the gateway's port.
    """

    def __init__(
        self, gateway: Gateway, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        self.gateway, self._patch, self._capsys = gateway, monkeypatch, capsys

    def words(self, args: list[str]) -> list[str]:
        return [arg.replace("PORT", str(self.gateway.port)) for arg in args]

    def full(self, args: list[str]) -> CommandResult:
        return self._said(run(self.words(args)))

    def quick(self, args: list[str]) -> CommandResult:
        self._patch.setattr(sys, "argv", ["helios", *self.words(args)])
        return self._said(main())

    def quick_alone(self, args: list[str]) -> int | None:
        """Exit status of the quick stop; None if the full command is needed."""
        status = quick_stop.quick_stop(self.words(args))
        self._said(0)
        return status

    def _said(self, status: int) -> CommandResult:
        said = self._capsys.readouterr()
        return CommandResult(status, said.out, said.err)


@pytest.fixture
def paths(
    gateway: Gateway,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Any,
) -> StopPaths:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for name in ("HELIOS_URL", "HELIOS_API_KEY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("signal.signal", lambda *_: None)  # keep the handlers of the tests
    return StopPaths(gateway, monkeypatch, capsys)


WELL: list[tuple[list[str], dict[str, str]]] = [
    (["stop", "--port", "PORT"], {}),
    (["stop", "--port=PORT", "--json"], {}),
    (["--port", "PORT", "stop"], {}),
    (["--port=PORT", "--robot", "two", "stop", "--json"], {}),
    (["stop", "--url", "127.0.0.1:PORT"], {}),
    (["stop", "--url", "http://127.0.0.1:PORT/"], {}),
    (["stop", "--url", "http://127.0.0.1:PORT/behind/a/proxy/"], {}),
    (["stop", "--url", "localhost:PORT", "--port", "PORT"], {}),
    (["stop"], {"HELIOS_URL": "127.0.0.1:PORT"}),
    (["stop", "--port", "PORT"], {"HELIOS_URL": "127.0.0.1:1"}),
    (["--port", "PORT", "stop"], {"HELIOS_URL": "no address"}),
    (["stop", "--url=127.0.0.1:PORT"], {"HELIOS_URL": "127.0.0.1:1"}),
    (["stop", "--port", "PORT"], {"HELIOS_URL": ""}),
    (["stop", "--port", "PORT", "--url", ""], {}),
    (["stop", "--port", "PORT", "--reason", "a child — ü"], {}),
    (["stop", "--port", "PORT", "--reason", "--json"], {}),
    (["stop", "--port", "PORT", "--reason="], {}),
    (["stop", "--port", "PORT", "--robot", "a/b ü"], {}),
    (["stop", "--port", "PORT", "--key", "secret"], {}),
    (["stop", "--port", "PORT"], {"HELIOS_API_KEY": "secret"}),
    (["stop", "--port", "PORT", "--key", ""], {"HELIOS_API_KEY": "secret"}),
    (["stop", "--port", "1", "--port", "PORT"], {}),
]


@pytest.mark.parametrize(("args", "variables"), WELL)
def test_quick_stop_and_full_command_send_and_print_the_same(
    args: list[str], variables: dict[str, str], paths: StopPaths, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in variables.items():
        monkeypatch.setenv(name, *paths.words([value]))
    assert paths.quick_alone(args) == 0
    full, quick = paths.full(args), paths.quick(args)
    assert quick == full
    assert (quick.status, quick.error) == (0, "")
    first, second, third = paths.gateway.asked
    assert first == second == third


ILL: list[list[str]] = [
    ["stop", "--help"],
    ["stop", "--port", "many"],
    ["stop", "--port", "0"],
    ["stop", "--port", "65536"],
    ["stop", "--port"],
    ["stop", "now"],
    ["stop", "--json=1"],
    ["stop", "--pot", "PORT"],
    ["stop", "--url", "ftp://127.0.0.1:PORT"],
    ["stop", "--url", "127.0.0.1:PORT?a=b"],
    ["stop", "--url", "127.0.0.1:PORT", "--port", "1"],
    ["stop", "--key", "ключ", "--port", "PORT"],
    ["stop", "--key", "a\nb", "--port", "PORT"],
    ["--port", "stop"],
    ["--json", "stop"],
]


@pytest.mark.parametrize("args", ILL)
def test_the_full_command_reports_a_usage_error(args: list[str], paths: StopPaths) -> None:
    assert paths.quick_alone(args) is None
    assert paths.gateway.asked == []
    full = paths.full(args)
    assert paths.quick(args) == full
    assert full.status != 0 or "Usage" in full.out


@pytest.mark.parametrize(
    ("status", "body", "exit_status", "words"),
    [
        (404, b'{"detail": "there is no robot x"}', 2, "there is no robot x"),
        (401, b'{"detail": "a key is needed"}', 1, "a key is needed"),
        (409, b'{"detail": "no bridge"}', 1, "no bridge"),
        (503, b'{"detail": "starting"}', 1, "starting"),
        (500, b"oh", 1, "answered 500"),
        (200, b"<html>", 1, "no JSON"),
        (200, b"{}", 1, "is HELIOS there?"),
        (200, b"[]", 1, "is HELIOS there?"),
        (200, answer(state=None), 1, "did not confirm that the robot is stopped"),
        (200, answer(state=[]), 1, "did not confirm that the robot is stopped"),
        (200, answer(state={"stopped": False}), 1, "did not confirm that the robot is stopped"),
    ],
)
def test_the_full_command_reports_a_refusal(
    status: int, body: bytes, exit_status: int, words: str, paths: StopPaths
) -> None:
    paths.gateway.status, paths.gateway.body = status, body
    args = ["stop", "--port", "PORT"]
    full = paths.full(args)
    assert (full.status, full.out) == (exit_status, "")
    assert words in full.error
    assert paths.quick(args) == full
    assert paths.quick_alone(args) is None


def test_both_code_paths_report_an_unreachable_gateway(paths: StopPaths) -> None:
    args = ["stop", "--port", str(free_port())]
    full = paths.full(args)
    assert (full.status, full.out) == (1, "")
    assert "helios up" in full.error
    assert paths.quick(args) == full


def test_the_quick_stop_has_the_options_of_the_full_command() -> None:
    group: Any = typer.main.get_command(app)
    command = group.commands["stop"]
    options = {p.opts[0]: p for p in command.params if p.name != "help"}
    assert set(options) == {*quick_stop.VALUES, *quick_stop.FLAGS}
    assert {name for name, p in options.items() if p.is_flag} == set(quick_stop.FLAGS)
    assert {name: p.envvar for name, p in options.items() if p.envvar} == quick_stop.VARIABLES
    assert options["--reason"].default == quick_stop.REASON


def test_a_stop_imports_no_third_party_package(gateway: Gateway) -> None:
    code = f"""
import json, sys
before = set(sys.modules)
from helios_client.__main__ import main
sys.argv = ["helios", "stop", "--json", "--port", "{gateway.port}"]
status = main()
print(json.dumps([status, sorted(set(sys.modules) - before - sys.stdlib_module_names)]))
"""
    child = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    status, imported = json.loads(child.stdout.splitlines()[-1])
    assert status == 0
    others = [name for name in imported if name.partition(".")[0] not in sys.stdlib_module_names]
    assert others == [
        "helios_client",
        "helios_client.__main__",
        "helios_client.http",
        "helios_client.http.address",
        "helios_client.interrupt_signals",
        "helios_client.leading_options",
        "helios_client.quick_stop",
    ]


def test_an_overlong_port_is_left_to_the_full_command(paths: StopPaths) -> None:
    assert paths.quick_alone(["stop", "--port", "9" * 5000]) is None


def test_the_full_command_runs_if_certifi_cannot_be_imported(
    paths: StopPaths, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "certifi", None)
    assert paths.quick_alone(["stop", "--url", "https://127.0.0.1:PORT"]) is None
