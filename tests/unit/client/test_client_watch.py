"""Tasks that are not waited for, watched again or cancelled; signals and a closed terminal."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any, NoReturn

import pytest
from helios_client.answer_types import Task
from helios_client.cli import run
from helios_client.commands.task_view import panel, time_left
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from tests.client_command import Helios
from tests.gateway_process import Served
from tests.support import ENDS_WITHIN_S, wait_until

INSTRUCTION = "move the mug from the coffee table to the kitchen counter"


def end_task(gateway: Served, id: str, state: str) -> None:
    """End a task as soon as it is submitted."""

    def end_it() -> None:
        wait_until(lambda: id in gateway.backend.tasks, 60, "the task was submitted")
        gateway.backend.change_task(id, state, message="done")

    threading.Thread(target=end_it, daemon=True).start()


def test_no_wait_prints_only_the_task_id(gateway: Served, helios: Helios) -> None:
    assert helios("task", INSTRUCTION, "--no-wait") == "t1\n"
    assert gateway.backend.tasks["t1"].state == "queued"
    reported = helios.json("task", INSTRUCTION, "--no-wait")
    assert (reported["id"], reported["state"]) == ("t2", "queued")


def test_the_first_output_line_begins_with_the_task_id(gateway: Served, helios: Helios) -> None:
    end_task(gateway, "t1", "succeeded")
    assert helios("task", INSTRUCTION).startswith("task t1: ")


@pytest.mark.parametrize(("state", "status"), [("succeeded", 0), ("failed", 1), ("cancelled", 1)])
def test_watch_exits_with_the_status_of_the_task(
    state: str, status: int, gateway: Served, helios: Helios
) -> None:
    gateway.backend.submit(INSTRUCTION)
    end_task(gateway, "t1", state)
    for name in ("t1", "T1", "last"):
        assert helios("watch", name, status=status).startswith("task t1: ")
    assert run(["watch", "--port", str(gateway.port), "--json"]) == status


def test_watching_an_unknown_task_is_a_usage_error(helios: Helios) -> None:
    helios("watch", status=2)
    assert "there is no task yet" in helios.error
    helios("watch", "none", status=2)
    assert "helios tasks" in helios.error


def test_an_interrupted_watch_does_not_cancel_the_task(
    gateway: Served, helios: Helios, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr("helios_client.commands.task_view._watch_lines", interrupted)
    gateway.backend.submit(INSTRUCTION)
    assert "end it with: helios cancel t1" in helios("watch", status=130)
    assert gateway.backend.tasks["t1"].state == "queued"


def test_cancel_all_cancels_and_counts_all_open_tasks(gateway: Served, helios: Helios) -> None:
    assert helios("cancel", "--all") == "0 tasks cancelled\n"
    for _ in range(4):
        gateway.backend.submit(INSTRUCTION)
    gateway.backend.tasks["t1"].state = "succeeded"
    gateway.backend.change_task("t2", "running")
    assert helios("cancel", "--all") == "3 tasks cancelled\n"
    states = {id: task.state for id, task in gateway.backend.tasks.items()}
    assert states == {"t1": "succeeded", "t2": "cancelled", "t3": "cancelled", "t4": "cancelled"}
    gateway.backend.submit(INSTRUCTION)
    assert [task["id"] for task in helios.json("cancel", "--all")["tasks"]] == ["t5"]


@pytest.mark.parametrize("args", [["cancel"], ["cancel", "t1", "--all"]])
def test_cancel_needs_either_one_task_or_all(args: list[str], helios: Helios) -> None:
    helios(*args, status=2)
    assert "name one task, or use --all" in helios.error


@pytest.mark.parametrize(
    ("eta_s", "words"),
    [
        (None, ""),
        ([130.0, 280.0], "about 2 to 5 min left"),
        ([20, 200], "less than 4 min left"),
        ([115, 120], "about 2 min left"),
        ([20.0, 41.0], "about 20 to 50 s left"),
        ([3, 60], "less than 60 s left"),
        ([1, 4], "less than 10 s left"),
        ([-5, 4], "less than 10 s left"),
        ([280.0, 130.0], "about 2 to 5 min left"),
        ([1], ""),
        ("soon", ""),
        (["a", "b"], ""),
        ([float("nan"), 4.0], ""),
    ],
)
def test_the_time_left_is_a_range_in_words(eta_s: object, words: str) -> None:
    raw = {"id": "t1", "state": "running", "eta_s": eta_s}
    assert time_left(Task.from_json(raw)) == words
    assert time_left(Task.from_json(raw | {"state": "failed"})) == ""


@given(st.lists(st.floats(0, 1e6), min_size=2, max_size=2))
def test_the_time_left_is_never_below_the_upper_end_of_the_range(eta_s: list[float]) -> None:
    words = time_left(Task(state="running", eta_s=eta_s))
    number, unit = words.removesuffix(" left").rsplit(" ", 2)[-2:]
    assert float(number) * {"s": 1, "min": 60}[unit] >= max(eta_s)


def test_the_live_panel_shows_id_and_time_left() -> None:
    console = Console(width=100)
    task = Task(id="3104ef4fe307", state="running", eta_s=[130, 280])
    with console.capture() as shown:
        console.print(panel(task, ""))
    assert "3104ef4fe307" in shown.get()
    assert "about 2 to 5 min left" in shown.get()


# --- signals ------------------------------------------------------------------------------------
def command(*args: str, gateway: Served, setup: str = "pass") -> list[str]:
    """Arguments that run `setup` and then `helios` in its own process."""
    code = f"import sys, signal; {setup}; from helios_client.__main__ import main; sys.exit(main())"
    return [sys.executable, "-c", code, *args, "--port", str(gateway.port)]


Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts processes, and ends those that a failed test leaves."""
    started: list[subprocess.Popen[str]] = []

    def popen(*args: Any, **kwargs: Any) -> subprocess.Popen[str]:
        started.append(subprocess.Popen(*args, **kwargs))
        return started[-1]

    yield popen
    for process in started:
        if process.poll() is None:
            process.kill()
            process.communicate()


def wait_until_watching(process: subprocess.Popen[str]) -> None:
    """Wait until the process watches the task."""
    assert process.stdout is not None
    assert process.stdout.readline().startswith("task t1")
    assert "queued" in process.stdout.readline()


@pytest.mark.parametrize(
    ("number", "status", "state"),
    [
        (signal.SIGHUP, 129, "queued"),
        (signal.SIGINT, 130, "cancelled"),
        (signal.SIGTERM, 130, "cancelled"),
    ],
)
def test_a_closed_terminal_does_not_cancel_the_task_but_an_interrupt_does(
    number: int, status: int, state: str, gateway: Served, start: Start
) -> None:
    process = start(
        command("task", INSTRUCTION, gateway=gateway),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_until_watching(process)
    process.send_signal(number)
    _, error = process.communicate(timeout=ENDS_WITHIN_S)
    assert process.returncode == status
    assert gateway.backend.tasks["t1"].state == state
    assert ("helios watch t1" in error) is (number == signal.SIGHUP)


def test_a_closed_terminal_has_no_effect_under_nohup(gateway: Served, start: Start) -> None:
    ignored = "signal.signal(signal.SIGHUP, signal.SIG_IGN)"
    process = start(
        command("task", INSTRUCTION, gateway=gateway, setup=ignored),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_until_watching(process)
    process.send_signal(signal.SIGHUP)
    gateway.backend.change_task("t1", "succeeded")
    _, error = process.communicate(timeout=ENDS_WITHIN_S)
    assert (process.returncode, error) == (0, "")


def test_a_lost_terminal_ends_the_watch_without_a_traceback(gateway: Served, start: Start) -> None:
    main, terminal = pty.openpty()
    process = start(
        command("task", INSTRUCTION, gateway=gateway),
        stdin=terminal,
        stdout=terminal,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=lambda: _set_terminal(terminal),
        text=True,
        env=os.environ | {"TERM": "xterm"},
    )
    os.close(terminal)
    wait_until(lambda: "t1" in gateway.backend.tasks, ENDS_WITHIN_S, "the task was submitted")
    shown = b""
    while b"queued" not in shown:
        shown += os.read(main, 4096)
    os.close(main)  # as when an SSH connection ends: SIGHUP, and no write succeeds any more
    _, error = process.communicate(timeout=ENDS_WITHIN_S)
    assert process.returncode == 129
    assert "Traceback" not in error
    assert gateway.backend.tasks["t1"].state == "queued"


def _set_terminal(terminal: int) -> None:
    """Make `terminal` the controlling terminal of this session."""
    import fcntl
    import termios

    fcntl.ioctl(terminal, termios.TIOCSCTTY, 0)


@pytest.mark.parametrize("args", [["task", INSTRUCTION], ["logs", "planner", "-f"]])
def test_an_interrupt_ends_a_background_command_of_a_script(
    args: list[str],
    gateway: Served,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
    start: Start,
) -> None:
    """A shell script starts its background commands with SIGINT ignored."""
    logs = tmp_path_factory.mktemp("state") / "helios" / str(gateway.port) / "logs"
    logs.mkdir(parents=True)
    (logs / "planner.log").write_text("task t1\nqueued\n")
    monkeypatch.setenv("XDG_STATE_HOME", str(logs.parents[2]))
    ignored = "signal.signal(signal.SIGINT, signal.SIG_IGN)"
    process = start(
        command(*args, gateway=gateway, setup=ignored),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    wait_until_watching(process)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=ENDS_WITHIN_S)
    assert process.returncode == 130


def test_the_time_left_is_printed_while_a_task_is_watched(
    gateway: Served, helios: Helios, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a terminal, each line ends with the time left if it is known."""
    states = iter(
        [
            Task(id="t1", state="running", message="drives", eta_s=[130, 280]),
            Task(id="t1", state="succeeded", message="done"),
        ]
    )
    gateway.backend.submit(INSTRUCTION)
    monkeypatch.setattr("helios_client.sdk.Helios.task", lambda *_: next(states))
    reported = helios("watch", "t1")
    assert "drives (about 2 to 5 min left)\n" in reported
