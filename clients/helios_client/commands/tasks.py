"""`helios task`, `watch`, `tasks`, `pause`, `resume`, `cancel`, `names`."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated

import typer
from helios_core.task_states import TaskState

from helios_client.commands.shared_options import (
    GatewayAddress,
    Json,
    console,
    flatten_options,
    named_values,
    print_json,
    print_line,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from helios_client.answer_types import Suggestions, Task
    from helios_client.commands.tables import AnyTask
    from helios_client.sdk import Helios

app = typer.Typer()

TaskId = Annotated[
    str, typer.Argument(help="id of the task or its beginning, or last; see helios tasks")
]
Timeout = Annotated[float, typer.Option(help="longest wait in seconds", min=1.0)]
NoWait = Annotated[
    bool, typer.Option("--no-wait", help="print the task's id and exit; the task continues")
]
TASKS_TO_TRY = 5


@app.command()
@flatten_options
def task(
    instruction: Annotated[str, typer.Argument(help='task, such as "Move the mug to the sofa"')],
    at: GatewayAddress,
    as_json: Json = False,
    timeout_s: Timeout = 3600.0,
    no_wait: NoWait = False,
    agent: Annotated[
        str | None,
        typer.Option(
            help="agent: helios, trusting … or that of helios up  [default: the planner's setting]"
        ),
    ] = None,
    max_steps: Annotated[
        int | None,
        typer.Option(help="maximum number of robot steps  [default: the planner's setting]", min=1),
    ] = None,
    time_limit_s: Annotated[
        float | None,
        typer.Option(
            help="time limit in seconds from the start  [default: the planner's setting]", min=0.1
        ),
    ] = None,
    priority: Annotated[
        int,
        typer.Option(
            help="priority; queued tasks with a higher one start first", min=-100, max=100
        ),
    ] = 0,
    own: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="planner setting for this task only, for example alpha_d=0.01; repeatable",
            metavar="NAME=VALUE",
        ),
    ] = None,
) -> None:
    """Submit a task and watch it; exit status 0 if it succeeded. With --robot any the fleet chooses
    the robot.

    Ctrl-C cancels the task. If the robot is stopped, a note says that the task waits for helios
    clear-stop.
    """
    from helios_client.usage_errors import check_finite

    check_finite("--time-limit-s", time_limit_s)
    asked = (instruction, max_steps, agent, time_limit_s, priority, named_values(own or ()))
    if at.is_for_fleet:
        from helios_client.commands.fleet import submit_to_fleet

        submit_to_fleet(at, lambda h: h.submit_to_fleet(*asked), as_json, timeout_s, no_wait)
        return
    submit_and_watch(at, lambda helios: helios.submit(*asked), as_json, timeout_s, no_wait)


def say_ignored(unused: Sequence[str]) -> None:
    """Print the words of an instruction that have no effect, if there are any."""
    if unused:
        said = ", ".join(f"“{words}”" for words in unused)
        print_line(f"helios: ignored: {said}", stderr=True)


def submit_and_watch(
    at: GatewayAddress,
    submit: Callable[[Helios], Task],
    as_json: bool,
    timeout_s: float,
    no_wait: bool,
) -> None:
    """Submit a task and show it until it has ended, or with no_wait print its id. Raises typer.Exit
    if the task did not succeed."""
    from helios_client.commands.task_view import say_stopped, wait_while_starting, watch_task

    deadline_s = time.monotonic() + timeout_s
    with at.connect() as helios:
        if (port := at.port_here) is not None:
            wait_while_starting(helios, port, console(stderr=True), timeout_s)
        asked = submit(helios)
        say_ignored(asked.unused)
        # With --json the live view goes to stderr, so that stdout holds only JSON.
        notes = console(stderr=True)
        if no_wait:
            say_stopped(helios, notes)
            print_json(asked.raw) if as_json else print_line(asked.id)
            return
        left_s = round(max(deadline_s - time.monotonic(), 0.0), 1)
        ended = watch_task(helios, asked, left_s, console(stderr=as_json), notes)
    _tell_end(ended, as_json)


@app.command()
@flatten_options
def watch(
    at: GatewayAddress,
    id: TaskId = "last",
    timeout_s: Timeout = 3600.0,
    as_json: Json = False,
) -> None:
    """Watch a submitted task; exit status 0 if it succeeded.

    Ctrl-C ends this command; the task goes on.
    """
    from helios_client.commands.tables import task_by_name
    from helios_client.commands.task_view import watch_task

    with at.connect() as helios:
        task, notes = task_by_name(helios, id), console(stderr=True)
        screen = console(stderr=as_json)
        ended = watch_task(helios, task, timeout_s, screen, notes, cancels=False)
    _tell_end(ended, as_json)


def _tell_end(ended: Task, as_json: bool) -> None:
    """Report the end of a task. Raises typer.Exit with status 1 if it did not succeed."""
    if as_json:
        print_json(ended.raw)
    if not ended.succeeded:
        how = "was cancelled" if ended.state == "cancelled" else ended.state
        print_line(f"helios: the task {how}: {ended.message}".removesuffix(": "), stderr=True)
        if ended.recordings:
            shown = f"the time around it is recorded in {ended.recordings[-1]}"
            print_line(f"helios: {shown}; helios faults says where", stderr=True)
        raise typer.Exit(1)


@app.command()
@flatten_options
def tasks(
    at: GatewayAddress,
    state: Annotated[
        TaskState | None, typer.Option(help="only tasks in this state", case_sensitive=False)
    ] = None,
    limit: Annotated[
        int | None, typer.Option(help="maximum number of tasks", min=1, max=1000)
    ] = None,
    as_json: Json = False,
) -> None:
    """List tasks, newest first; with --robot any those of the fleet."""
    if at.is_for_fleet:
        from helios_client.commands.fleet import list_fleet_tasks

        list_fleet_tasks(at, state, limit, as_json)
        return
    from helios_client.commands.tables import task_table

    with at.connect() as helios:
        found = helios.tasks(state, limit)
    if as_json:
        print_json({"tasks": [one.raw for one in found]})
    elif found:
        console().print(task_table(found))
    else:
        print("no tasks" + (f" are {state}" if state else " yet"))


@app.command()
@flatten_options
def names(
    at: GatewayAddress,
    here: Annotated[
        bool, typer.Option("--here", help="list objects seen in this home, and tasks to try there")
    ] = False,
    as_json: Json = False,
) -> None:
    """List the object and furniture names that a task may use."""
    with at.connect() as helios:
        if here:
            _print_here(helios.suggestions(TASKS_TO_TRY), as_json)
            return
        found = helios.vocabulary()
    if as_json:
        print_json(found)
    elif found["open"]:
        print_line(
            f"any name is allowed: the detector ({found['detector']}) has an open vocabulary"
        )
    else:
        _print_names(sorted(name.replace("_", " ") for name in found["names"]))


@app.command()
@flatten_options
def cancel(
    at: GatewayAddress,
    id: Annotated[
        str | None,
        typer.Argument(help="id of the task or its beginning, or last; see helios tasks"),
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="cancel every task that is queued, running or paused")
    ] = False,
    as_json: Json = False,
) -> None:
    """Cancel a task, or all of them; the robot comes to rest. With --robot any: of the fleet."""
    from helios_client.commands.tables import task_by_name
    from helios_client.usage_errors import UsageError

    if (id is None) is not everything:
        raise UsageError("name one task, or use --all; helios tasks lists all tasks")
    if at.is_for_fleet:
        from helios_client.commands.fleet import cancel_fleet_tasks

        cancel_fleet_tasks(at, id, as_json)
        return
    with at.connect() as helios:
        if id is not None:
            _print_task(helios.cancel(task_by_name(helios, id).id), as_json)
            return
        ended = cancel_all(helios.tasks(), helios.cancel)
    if as_json:
        print_json({"tasks": [task.raw for task in ended]})
    else:
        from helios_core.printable_text import counted

        print(f"{counted(len(ended), 'task')} cancelled")


def cancel_all(tasks: Iterable[AnyTask], cancel: Callable[[str], AnyTask]) -> list[AnyTask]:
    """Cancel the tasks that have not ended, so that none of them starts meanwhile: first those of
    the fleet without a robot, then other queued ones. Returns the cancelled tasks. Raises
    HeliosError."""
    from helios_core.errors import Conflict

    def order(task: AnyTask) -> tuple[bool, bool]:
        return task.state != "queued", bool(getattr(task, "robot", ""))

    cancelled = []
    for task in sorted((task for task in tasks if not task.ended), key=order):
        try:
            cancelled.append(cancel(task.id))
        except Conflict:  # it has already ended
            continue
    return cancelled


@app.command()
@flatten_options
def pause(id: TaskId, at: GatewayAddress, as_json: Json = False) -> None:
    """Pause a queued or running task until helios resume."""
    from helios_client.commands.tables import task_by_name

    with at.connect() as helios:
        task = helios.pause(task_by_name(helios, id).id)
    _print_task(task, as_json)


@app.command()
@flatten_options
def resume(id: TaskId, at: GatewayAddress, as_json: Json = False) -> None:
    """Resume a paused task."""
    from helios_client.commands.tables import task_by_name

    with at.connect() as helios:
        task = helios.resume(task_by_name(helios, id).id)
    _print_task(task, as_json)


def _print_task(task: Task, as_json: bool) -> None:
    if as_json:
        print_json(task.raw)
    else:
        print_line(f"task {task.id} is {task.state}: {task.message}".removesuffix(": "))


def _print_here(found: Suggestions, as_json: bool) -> None:
    from helios_client.commands.tables import seen_name_table

    if as_json:
        print_json(found)
        return
    if found["seen"]:
        console().print(seen_name_table(found["seen"]))
    elif found["seen"] is None:
        print("seen objects are not available: the object map does not respond")
    else:
        print("no object that a task looked for has been seen in this home yet")
    if found["tasks"]:
        print(
            "\nTasks to try:" if found["seen"] else "\nExamples with names that the detector knows:"
        )
    for text in found["tasks"]:
        print_line(f'  helios task "{text}"')


def _print_names(names: list[str]) -> None:
    """Print names, in columns on a terminal, else one per line."""
    from rich.columns import Columns
    from rich.text import Text

    screen = console()
    if screen.is_terminal:
        screen.print(Columns([Text(name) for name in names], column_first=True, padding=(0, 3)))
    else:
        for name in names:
            print_line(name)
