"""`make demo`: what it says before and after its task."""

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


def test_a_port_in_use_is_said_first_and_nothing_else(tmp_path: Path) -> None:
    said, out = io.StringIO(), tmp_path / "demo"
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(Conflict, match=rf"port {port} is in use; .*make demo PORT="):
            demo.run(0, "demo-v1", port, out, Console(file=said))
    assert said.getvalue() == ""
    assert not out.exists()


def test_another_robot_that_is_ready_is_not_taken_for_the_one_that_ended(tmp_path: Path) -> None:
    log = tmp_path / "up.log"
    log.write_text("helios: port 8080 is in use")
    ready = Mock(spec=Helios, **{"ready.return_value": True})
    ended = Mock(spec=subprocess.Popen, **{"poll.return_value": 1})
    said = io.StringIO()
    with pytest.raises(Unavailable, match="port 8080 is in use"):
        demo.wait_ready(ready, ended, log, Console(file=said))
    assert said.getvalue() == ""


def test_the_end_names_the_commands_that_go_on_in_the_same_home() -> None:
    reported = demo.next_steps(RESULT, 8080)
    assert "helios up --robot sim --seed 6 " in reported
    assert 'helios task "Find the mug" ' in reported
    assert "--port" not in reported


def test_another_preset_and_port_stand_in_the_commands_too() -> None:
    reported = demo.next_steps(RESULT | {"preset": "ovmm-v1"}, 8090)
    assert "--seed 6 --preset ovmm-v1 --port 8090 " in reported
    assert 'helios task "Find the mug" --port 8090 ' in reported
