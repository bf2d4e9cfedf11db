"""Output of commands: complete in a pipe, and without control characters from outside."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import unicodedata

import httpx
import pytest
from helios_client.answer_types import Decision, Task
from helios_client.commands.decision_view import report
from helios_client.terminal_output import PIPE_COLUMNS, Screen, plain_table
from helios_core import proto as pb
from helios_core.topics import ROBOT_STATE
from hypothesis import given
from hypothesis import strategies as st
from rich.live import Live

from tests.client_command import Helios
from tests.gateway_process import Served

INSTRUCTION = "move the mug to the kitchen counter"
PATH = "/var/lib/helios/" + "a-folder-with-a-long-name/" * 8 + "20261123-183504.mcap"
ESCAPE = "find the \x1b[31mcup\x9b2J\x07\x00\r\n\x7f"


def controls(text: str) -> str:
    """The control characters of a text except its line ends."""
    return "".join(c for c in text if unicodedata.category(c) == "Cc" and c != "\n")


@pytest.mark.parametrize("environment", [{}, {"COLUMNS": "40"}])
def test_tables_are_not_truncated_in_a_pipe(environment: dict[str, str], gateway: Served) -> None:
    gateway.backend.report("planner", 4105, "degraded", f"written to {PATH}")
    gateway.backend.submit(INSTRUCTION)
    gateway.backend.tasks["t1"].instruction = "of many words " * 20
    for args, words in ((["status"], PATH), (["tasks"], "of many words " * 19)):
        done = subprocess.run(
            [sys.executable, "-m", "helios_client", *args, "--port", str(gateway.port)],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | environment,
        )
        assert any(words.strip() in line for line in done.stdout.splitlines()), done.stdout
        assert max(map(len, done.stdout.splitlines())) < 2000  # no line is padded to the full width


def test_tables_are_not_truncated_on_a_narrow_terminal() -> None:
    table = plain_table("service", "reason")
    table.add_row("recorder", PATH)
    out = io.StringIO()
    Screen(file=out, force_terminal=True, width=40, color_system=None).print(table)
    assert PATH in "".join(line[8:].strip() for line in out.getvalue().splitlines()[1:])


def test_why_is_not_padded_in_a_pipe() -> None:
    decision = Decision(why="go: near", recomputed={"flips": True, "certain": True, "why": "other"})
    out = io.StringIO()
    Screen(file=out).print(report(Task(id="t1"), [decision], ["a=1"], 3, True))
    assert max(map(len, out.getvalue().splitlines())) < PIPE_COLUMNS / 100


@given(st.text())
def test_the_screen_prints_no_control_characters(text: str) -> None:
    out = io.StringIO()
    screen = Screen(file=out, force_terminal=True, color_system=None, legacy_windows=False)
    table = plain_table("instruction")
    table.add_row(text)
    screen.print(table)
    screen.print(text, markup=False, highlight=False)
    assert controls(out.getvalue()) == ""


def test_a_live_view_prints_no_control_characters() -> None:
    out = io.StringIO()
    screen = Screen(file=out)
    with Live(ESCAPE, console=screen):
        pass
    assert controls(out.getvalue()) == ""


@pytest.mark.parametrize(
    "args",
    [["tasks"], ["status"], ["pause", "t1"], ["objects"], ["why", "t1"], ["seen", "mug"],
     ["names"], ["names", "--here"], ["cancel", "t1"], ["watch", "t2"]],
)  # fmt: skip
def test_no_command_prints_control_characters_from_the_gateway(
    args: list[str], gateway: Served, helios: Helios
) -> None:
    for id in ("t1", "t2"):
        gateway.backend.submit(INSTRUCTION)
        gateway.backend.tasks[id].instruction = ESCAPE
        gateway.backend.tasks[id].message = ESCAPE
    gateway.backend.tasks["t2"].state = "failed"
    gateway.backend.found[0].class_name = ESCAPE
    gateway.backend.stopped = True
    gateway.backend.publish_robot()
    gateway.backend.bus.publish(ROBOT_STATE, pb.RobotState(stopped=True, message=ESCAPE))
    gateway.backend.report("planner", 4105, "degraded", ESCAPE)
    status = 1 if args[0] == "watch" else 0
    reported = helios(*args, status=status) + helios.error
    assert controls(reported) == ""


def test_json_output_is_exact_and_without_control_characters(
    gateway: Served, helios: Helios
) -> None:
    gateway.backend.submit(INSTRUCTION)
    gateway.backend.tasks["t1"].instruction = ESCAPE
    reported = helios("tasks", "--json")
    assert controls(reported) == ""
    answered = httpx.get(f"{gateway.url}/v1/tasks").json()["tasks"]
    assert json.loads(reported)["tasks"] == answered


def test_an_error_from_the_gateway_is_one_line_without_control_characters(
    gateway: Served, helios: Helios
) -> None:
    helios("task", "dance \x1b[31m now", status=2)
    assert controls(helios.error) == ""
    assert helios.error.count("\n") == 1
