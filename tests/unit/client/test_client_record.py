"""`helios record` finds the router of the robot that it is told of."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from helios_client.cli import run
from helios_client.supervision import state_file

from tests.support import free_port

ROUTER = "tcp/127.0.0.1:17447"


class Became(Exception):
    """Instead of the recorder's process."""


@pytest.fixture
def port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Of a `helios up` of this machine, as its state file tells it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("HELIOS_URL", raising=False)
    port = free_port()
    status = {"ready": True, "services": [], "router": ROUTER, "robot": "arm"}
    state_file.write([state_file.default_state_dir(port)], status)

    def become(_: str, argv: list[str]) -> None:
        raise Became(*argv)

    monkeypatch.setattr(os, "execv", become)
    return port


@pytest.mark.parametrize("url", ["http://127.0.0.1:{}", "http://localhost:{}/", "localhost:{}"])
def test_it_honours_the_url_that_every_command_does(
    port: int, monkeypatch: pytest.MonkeyPatch, url: str
) -> None:
    monkeypatch.setenv("HELIOS_URL", url.format(port))
    with pytest.raises(Became) as became:
        run(["record"])
    argv = became.value.args
    assert argv[argv.index("--router") + 1] == ROUTER
    assert argv[argv.index("--robot") + 1] == "arm"


def test_a_typed_port_wins_over_the_variable(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HELIOS_URL", "http://192.0.2.7:8080")
    with pytest.raises(Became) as became:
        run(["record", "--port", str(port)])
    assert ROUTER in became.value.args


def test_of_another_machine_it_says_what_to_give(
    port: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HELIOS_URL", "http://192.0.2.7:8080")  # reserved for examples
    assert run(["record"]) == 2
    said = capsys.readouterr().err
    assert "not on this machine" in said
    assert "--router tcp/192.0.2.7:7447" in said
    assert said.count("\n") == 1
    with pytest.raises(Became) as became:  # a router that is named is asked
        run(["record", "--router", "tcp/192.0.2.7:7447"])
    assert "tcp/192.0.2.7:7447" in became.value.args


@pytest.mark.parametrize("url", ["http://", "http://localhost:seven", "ftp://localhost"])
def test_a_url_that_is_none_is_wrong_use(
    port: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], url: str
) -> None:
    monkeypatch.setenv("HELIOS_URL", url)
    assert run(["record"]) == 2
    assert "http://HOST:PORT" in capsys.readouterr().err


def test_where_nobody_runs_it_says_so_and_where_somebody_does(
    port: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    nobody = free_port()
    assert run(["record", "--port", str(nobody)]) == 1
    said = capsys.readouterr().err
    assert f"no `helios up` runs with --port {nobody} (one runs with --port {port})" in said
    monkeypatch.setenv("HELIOS_URL", f"http://127.0.0.1:{nobody}")
    assert run(["record"]) == 1
    assert f"no `helios up` runs at http://127.0.0.1:{nobody}" in capsys.readouterr().err
