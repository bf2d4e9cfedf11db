"""`helios record` finds the router of the robot that its options or the environment name."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from helios_client.cli import run
from helios_client.supervision import state_file

from tests.support import free_port

ROUTER = "tcp/127.0.0.1:17447"


class ExecCalled(Exception):
    """Raised instead of starting the recorder's process."""


@pytest.fixture
def port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """The port of a `helios up` on this machine, with its state file."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("HELIOS_URL", raising=False)
    port = free_port()
    status = {"ready": True, "services": [], "router": ROUTER, "robot": "arm"}
    state_file.write([state_file.default_state_dir(port)], status)

    def fake_execv(_: str, argv: list[str]) -> None:
        raise ExecCalled(*argv)

    monkeypatch.setattr(os, "execv", fake_execv)
    return port


@pytest.mark.parametrize("url", ["http://127.0.0.1:{}", "http://localhost:{}/", "localhost:{}"])
def test_record_uses_the_url_of_the_environment_variable(
    port: int, monkeypatch: pytest.MonkeyPatch, url: str
) -> None:
    monkeypatch.setenv("HELIOS_URL", url.format(port))
    with pytest.raises(ExecCalled) as became:
        run(["record"])
    argv = became.value.args
    assert argv[argv.index("--router") + 1] == ROUTER
    assert argv[argv.index("--robot") + 1] == "arm"


def test_an_unusable_folder_is_refused_before_the_recorder_starts(
    port: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert run(["record", "--out", "file", "--port", str(port)]) == 2
    assert "the folder file cannot be made: File exists" in capsys.readouterr().err


def test_the_port_option_overrides_the_environment_variable(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HELIOS_URL", "http://192.0.2.7:8080")
    with pytest.raises(ExecCalled) as became:
        run(["record", "--port", str(port)])
    assert ROUTER in became.value.args


def test_a_robot_on_another_machine_needs_the_router_option(
    port: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HELIOS_URL", "http://192.0.2.7:8080")  # reserved for examples
    assert run(["record"]) == 2
    said = capsys.readouterr().err
    assert "not on this machine" in said
    assert "--router tcp/192.0.2.7:7447" in said
    assert said.count("\n") == 1
    with pytest.raises(ExecCalled) as became:  # the named router is used
        run(["record", "--router", "tcp/192.0.2.7:7447"])
    assert "tcp/192.0.2.7:7447" in became.value.args


@pytest.mark.parametrize("url", ["http://", "http://localhost:seven", "ftp://localhost"])
def test_an_invalid_url_is_a_usage_error(
    port: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], url: str
) -> None:
    monkeypatch.setenv("HELIOS_URL", url)
    assert run(["record"]) == 2
    assert "http://HOST:PORT" in capsys.readouterr().err


def test_a_missing_stack_is_reported_with_the_port_of_a_running_one(
    port: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    nobody = free_port()
    assert run(["record", "--port", str(nobody)]) == 1
    said = capsys.readouterr().err
    assert f"no `helios up` runs with --port {nobody} (one runs with --port {port})" in said
    monkeypatch.setenv("HELIOS_URL", f"http://127.0.0.1:{nobody}")
    assert run(["record"]) == 1
    assert f"no `helios up` runs at http://127.0.0.1:{nobody}" in capsys.readouterr().err
