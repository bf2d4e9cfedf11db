"""The view of a watched task, and the effect of an interrupt."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable
from typing import Any, NoReturn

import httpx
import pytest
from helios_client.answer_types import Task
from helios_client.commands import task_view as module
from helios_client.commands.task_view import panel, run_task
from helios_client.sdk import Helios
from helios_core.errors import Unavailable
from rich.console import Console

QUEUED = httpx.Response(202, json={"id": "t1", "state": "queued"})
STARTING = httpx.Response(503, json={"detail": "the gateway is starting"})


def helios(answers: Iterable[httpx.Response]) -> Helios:
    left = iter(answers)
    return Helios("http://robot", transport=httpx.MockTransport(lambda _: next(left)))


def task(**values: Any) -> httpx.Response:
    return httpx.Response(200, json={"id": "t1", "state": "running"} | values)


@pytest.fixture
def interrupted(monkeypatch: pytest.MonkeyPatch) -> Callable[[Helios], str]:
    """Interrupt the watch of a task at once; return the output followed by the error's name."""

    def interrupt(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "_watch_lines", interrupt)
    monkeypatch.setattr(module, "POLL_S", 0.0)

    def run(client: Helios) -> str:
        out = io.StringIO()
        with pytest.raises((KeyboardInterrupt, Unavailable)) as ended:
            run_task(client, "move it", 30, Console(file=out, width=200))
        return f"{out.getvalue()}{ended.typename}"

    return run


def test_watching_without_a_terminal_prints_each_change_once() -> None:
    changes = [task(message="drives to the mug"), task(message="drives to the mug", steps=4)]
    ended = task(state="failed", message="no [mug] found")
    out = io.StringIO()
    client = helios([QUEUED, *changes, ended])
    assert run_task(client, "move it", 30, Console(file=out, width=100)).state == "failed"
    assert out.getvalue().count("drives to the mug") == 1
    assert "no [mug] found" in out.getvalue()


def test_the_live_view_shows_phase_search_target_and_last_decision() -> None:
    out = io.StringIO()
    task = Task(state="running", phase="find_object", seeking="mug [red]", progress=0.5, steps=3)
    Console(file=out, width=100).print(panel(task, "the sofa scores best"))
    for words in ("find object", "mug [red]", "the sofa scores best"):
        assert words in out.getvalue()


def test_a_cancel_is_repeated_until_the_restarted_gateway_accepts_it(
    interrupted: Callable[[Helios], str],
) -> None:
    cancelled = task(state="cancelled", message="cancelled after 3 steps")
    reported = interrupted(helios([QUEUED, STARTING, STARTING, task(), cancelled]))
    assert "cancelled after 3 steps" in reported
    assert "may continue" not in reported
    assert reported.endswith("KeyboardInterrupt")


def test_an_unanswered_cancel_is_reported_with_the_command_to_repeat_it(
    interrupted: Callable[[Helios], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "CANCEL_S", 0.0)
    reported = interrupted(helios([QUEUED, STARTING, STARTING]))
    assert "the task may continue; end it with: helios cancel t1" in reported
    assert reported.endswith("Unavailable")


def test_a_task_that_ended_before_its_cancel_is_reported_with_its_end_state(
    interrupted: Callable[[Helios], str],
) -> None:
    conflict = httpx.Response(409, json={"detail": "task t1 has ended"})
    reported = interrupted(helios([QUEUED, conflict, task(state="succeeded", message="done")]))
    assert "done" in reported
    assert reported.endswith("KeyboardInterrupt")


def test_the_maximum_wait_bounds_the_wait_for_starting_services(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "STARTING_S", 3600.0)
    monkeypatch.setattr(module, "POLL_S", 0.01)
    monkeypatch.setattr(module, "_started", lambda _: False)
    monkeypatch.setattr(module.state_file, "read", lambda _: {"router": "tcp/127.0.0.1:1"})
    out = io.StringIO()
    module.wait_while_starting(helios([]), 8080, Console(file=out, width=200), most_s=0.05)
    assert out.getvalue() == "waiting until all services are ready\n"
