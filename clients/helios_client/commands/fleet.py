"""`helios fleet`, and `helios task`, `tasks` and `cancel` with `--robot any`."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import typer

from helios_client.commands.shared_options import (
    GatewayAddress,
    Json,
    console,
    flatten_options,
    print_json,
    print_line,
)
from helios_client.commands.tasks import cancel_all, say_ignored

if TYPE_CHECKING:
    from rich.console import Console

    from helios_client.answer_types import Fleet, FleetTask
    from helios_client.sdk import Helios

app = typer.Typer()
STATE_COLORS = {"idle": "green", "busy": "cyan", "not ready": "yellow"}
CANCEL_S = 30.0  # longest wait for the end of a cancelled task


@app.command()
@flatten_options
def fleet(at: GatewayAddress, as_json: Json = False) -> None:
    """Show every robot of a gateway with its task, and the tasks that wait for a robot."""
    with replace(at, robot=None).connect() as helios:
        found = helios.fleet()
    if as_json:
        print_json(found)
        return
    screen = console()
    for table in fleet_tables(found):
        screen.print(table)


def fleet_tables(found: Fleet) -> list:
    """Table of the robots, and one of the open tasks if there are any."""
    from rich.markup import escape

    from helios_client.answer_types import FleetTask
    from helios_client.terminal_output import plain_table

    robots = plain_table("robot", "state", "battery", "task", "now")
    for one in found["robots"]:
        color, task = STATE_COLORS.get(one["state"], "red"), one["task"]
        battery = "-" if one["battery"] is None else f"{one['battery']:.0%}"
        now = task["message"] if task else "; ".join(one["reasons"])
        robots.add_row(
            escape(one["name"]),
            f"[{color}]{one['state']}[/]",
            battery,
            escape(task["instruction"]) if task else "-",
            escape(now),
        )
    if not found["tasks"]:
        return [robots]
    return [robots, "", fleet_task_table([FleetTask.from_json(t) for t in found["tasks"]])]


def fleet_task_table(tasks: list[FleetTask]):
    """Table with one row per task of the fleet."""
    from rich.markup import escape

    from helios_client.commands.tables import TASK_COLORS
    from helios_client.terminal_output import plain_table

    out = plain_table("id", "state", "robot", "priority", "instruction", "message")
    for task in tasks:
        color = TASK_COLORS.get(task.state, "default")
        out.add_row(
            task.id,
            f"[{color}]{task.state}[/]",
            escape(task.robot or "-"),
            str(task.priority),
            escape(task.instruction),
            escape(task.message),
        )
    return out


def list_fleet_tasks(
    at: GatewayAddress, state: str | None, limit: int | None, as_json: bool
) -> None:
    """Print the tasks of the fleet, newest first."""
    with replace(at, robot=None).connect() as helios:
        found = list(helios.fleet_tasks(state, limit))
    if as_json:
        print_json({"tasks": [task.raw for task in found]})
    elif found:
        console().print(fleet_task_table(found))
    else:
        print("no tasks of the fleet" + (f" are {state}" if state else " yet"))


def cancel_fleet_tasks(at: GatewayAddress, id: str | None, as_json: bool) -> None:
    """Cancel the task of the fleet whose id begins with `id`, or with None all open ones."""
    with replace(at, robot=None).connect() as helios:
        if id is not None:
            ended = [helios.cancel_fleet_task(_named(helios, id).id)]
        else:
            ended = cancel_all(helios.fleet_tasks(), helios.cancel_fleet_task)
    if as_json:
        print_json(ended[0].raw if id is not None else {"tasks": [t.raw for t in ended]})
    for task in () if as_json else ended:
        print_line(f"task {task.id} is {task.state}: {task.message}".removesuffix(": "))
    if not (ended or as_json):
        print("no task of the fleet is open")


def _named(helios: Helios, id: str) -> FleetTask:
    from helios_client.commands.tables import fleet_task_by_name

    return fleet_task_by_name(helios, id)


def submit_to_fleet(
    at: GatewayAddress,
    submit: Callable[[Helios], FleetTask],
    as_json: bool,
    timeout_s: float,
    no_wait: bool,
) -> None:
    """Submit a task to the fleet and show it until it has ended, or with no_wait print its id.
    Raises typer.Exit if it did not succeed."""
    deadline_s = time.monotonic() + timeout_s
    with replace(at, robot=None).connect() as helios:
        asked = submit(helios)
        say_ignored(asked.unused)
        if no_wait:
            print_json(asked.raw) if as_json else print_line(asked.id)
            return
        screen = console(stderr=as_json)
        screen.print(
            f"task {asked.id} of the fleet: {asked.instruction}",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
        from helios_core.errors import HeliosError

        from helios_client.commands.task_view import cancel_with_retries

        try:
            ended = _watched(helios, asked, deadline_s, screen)
        except KeyboardInterrupt:
            screen.print("cancelling the task")
            try:
                cancel_with_retries(lambda: helios.cancel_fleet_task(asked.id))
            except (HeliosError, KeyboardInterrupt):
                screen.print(
                    "the cancellation was not confirmed, so the task may continue; end it with: "
                    f"helios cancel {asked.id} --robot any",
                    highlight=False,
                    markup=False,
                    soft_wrap=True,
                )
                raise
            _watched(helios, asked, time.monotonic() + CANCEL_S, screen)
            raise
    if as_json:
        print_json(ended.raw)
    if not ended.succeeded:
        how = "was cancelled" if ended.state == "cancelled" else ended.state
        print_line(f"helios: the task {how}: {ended.message}".removesuffix(": "), stderr=True)
        raise typer.Exit(1)


def _watched(helios: Helios, asked: FleetTask, deadline_s: float, screen: Console) -> FleetTask:
    """The task at its end; each change of robot, state or message is a line. Raises
    DeadlineExceeded, and Unavailable if the gateway is silent for too long."""
    from helios_core.errors import DeadlineExceeded, Unavailable

    from helios_client.http.connection import POLL_S, SILENCE_S

    task, heard_s, said = asked, time.monotonic(), ("", "", "")
    while not task.ended:
        if time.monotonic() > deadline_s:
            raise DeadlineExceeded(
                f"task {task.id} of the fleet is still {task.state}; wait longer, or cancel it: "
                f"helios cancel {task.id} --robot any"
            )
        try:
            task, heard_s = helios.fleet_task(asked.id), time.monotonic()
        except (Unavailable, DeadlineExceeded):
            if time.monotonic() - heard_s > SILENCE_S:
                raise
        if task.robot and task.robot != said[0]:
            screen.print(
                f"{task.robot} gets the task: {task.why}",
                highlight=False,
                markup=False,
                soft_wrap=True,
            )
        if (task.robot, task.state, task.message) != said:
            said = (task.robot, task.state, task.message)
            share = f" {(task.task or {}).get('progress') or 0:4.0%}" if task.begun else ""
            who = f"{task.robot} " if task.robot else ""
            screen.print(
                f"{who}{task.state}{share}: {task.message}",
                highlight=False,
                markup=False,
                soft_wrap=True,
            )
        if not task.ended:
            time.sleep(POLL_S)
    return task
