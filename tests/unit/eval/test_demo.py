"""Tests the output of `make demo` before and after its task."""

from __future__ import annotations

import io
import socket
import subprocess
from pathlib import Path
from unittest.mock import Mock

import pytest
from helios_client.sdk import Helios
from helios_core.errors import Conflict, Unavailable
from helios_eval import demo
from rich.console import Console

RESULT = {"seed": 6, "preset": "demo-v1", "instruction": "Find the mug"}


def test_an_occupied_port_is_an_error_before_any_output(tmp_path: Path) -> None:
    said, out = io.StringIO(), tmp_path / "demo"
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(Conflict, match=rf"port {port} is in use; .*make demo PORT="):
            demo.run(0, "demo-v1", port, out, Console(file=said))
    assert said.getvalue() == ""
    assert not out.exists()


@pytest.mark.parametrize("port", ["0", "99999", "-1"])
def test_a_port_that_does_not_exist_is_refused_by_the_parser(
    port: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demo, "run", Mock(return_value=RESULT | {"success": True}))
    monkeypatch.setattr("sys.argv", ["helios-demo", f"--port={port}"])
    with pytest.raises(SystemExit, match="2"):
        demo.main()
    assert f"{port} is no port; wanted 1 to 65535" in capsys.readouterr().err


@pytest.mark.parametrize(("seed", "status"), [(-1, 1), (0, 0), (999, 0), (1000, 1)])
def test_the_demo_plays_homes_for_development_only(
    seed: int, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Mock(return_value=RESULT | {"success": True})
    monkeypatch.setattr(demo, "run", run)
    monkeypatch.setattr("sys.argv", ["helios-demo", f"--seed={seed}"])
    assert demo.main() == status
    assert run.called == (status == 0)
    assert ("enters them in the ledger" in capsys.readouterr().err) == (status == 1)


def test_an_ended_stack_is_an_error_even_if_another_stack_answers_as_ready(tmp_path: Path) -> None:
    log = tmp_path / "up.log"
    log.write_text("helios: port 8080 is in use")
    ready = Mock(spec=Helios, **{"ready.return_value": True})
    ended = Mock(spec=subprocess.Popen, **{"poll.return_value": 1})
    said = io.StringIO()
    with pytest.raises(Unavailable, match="port 8080 is in use"):
        demo.wait_ready(ready, ended, log, Console(file=said))
    assert said.getvalue() == ""


def test_the_last_output_names_the_commands_for_the_same_home() -> None:
    reported = demo.next_steps(RESULT, 8080)
    assert "helios up --robot sim --seed 6 " in reported
    assert 'helios task "Find the mug" ' in reported
    assert "--port" not in reported


def test_the_named_commands_include_a_non_default_preset_and_port() -> None:
    reported = demo.next_steps(RESULT | {"preset": "ovmm-v1"}, 8090)
    assert "--seed 6 --preset ovmm-v1 --port 8090 " in reported
    assert 'helios task "Find the mug" --port 8090 ' in reported
