"""Live view of a task, for `helios task` and `watch`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from helios_core.errors import Conflict, DeadlineExceeded, HeliosError, Unavailable
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.progress_bar import ProgressBar
from rich.table import Table

from helios_client.answer_types import Status, Task
from helios_client.commands.hangup_signal import hangup_raises
from helios_client.commands.tables import TASK_COLORS
from helios_client.http.connection import POLL_S
from helios_client.sdk import Helios
from helios_client.supervision import state_file

STARTING_S = 60.0
CANCEL_S = 30.0  # longest retry of a cancel, and longest wait for the task to end after it


def panel(task: Task, why: str) -> Table:
    """Summary of a task for the terminal, one line per property."""
    out = Table.grid(padding=(0, 2))
    out.add_column(style="dim")
    out.add_column()
    color = TASK_COLORS.get(task.state, "bold")
    out.add_row("task", escape(task.instruction))
    out.add_row("id", escape(task.id))
    out.add_row("state", f"[{color}]{task.state}[/]")
    if not task.ended:
        out.add_row("phase", task.phase.replace("_", " ") or "waiting")
        out.add_row("seeking", escape(task.seeking) or "nothing yet")
    out.add_row("now" if not task.ended else "ended", escape(task.message))
    if task.recordings:
        out.add_row("recording", escape(task.recordings[-1]))
    if why:
        out.add_row("why", escape(why))
    out.add_row("steps", f"{task.steps} of {task.max_steps}" if task.max_steps else f"{task.steps}")
    out.add_row("progress", ProgressBar(total=1.0, completed=task.progress, width=40))
    if left := time_left(task):
        out.add_row("left", left)
    return out


def time_left(task: Task) -> str:
    """Text such as `about 2 to 5 min left`; empty for an ended task or an unknown time."""
    if task.ended or not _is_range(task.eta_s):
        return ""
    low_s, high_s = sorted(max(0.0, s) for s in task.eta_s or ())
    if high_s < 10:
        return "less than 10 s left"
    step_s, unit = (10, 10) if high_s < 90 else (60, 1)
    low, high = unit * round(low_s / step_s), unit * math.ceil(high_s / step_s)
    word = "s" if high_s < 90 else "min"
    if low == 0:
        return f"less than {high} {word} left"
    return f"about {low} to {high} {word} left" if low < high else f"about {high} {word} left"


def _is_range(eta_s: object) -> bool:
    """True for two finite numbers; a newer gateway may use another form."""
    if not isinstance(eta_s, Sequence) or len(eta_s) != 2:
        return False
    return all(isinstance(s, int | float) and math.isfinite(s) for s in eta_s)


def wait_while_starting(helios: Helios, port: int, console: Console, most_s: float) -> None:
    """Wait while a `helios up` on this port is starting, at most `most_s` or `STARTING_S`."""
    if _started(helios) or state_file.read(state_file.default_state_dir(port)) is None:
        return
    console.print("waiting until all services are ready", style="dim")
    deadline_s = time.monotonic() + min(most_s, STARTING_S)
    while not _started(helios) and time.monotonic() < deadline_s:
        time.sleep(POLL_S)


def _started(helios: Helios) -> bool:
    """True if all services are ready, or held back by stop-now, which waiting does not end."""
    status = _status(helios)
    return status is not None and bool(status["ready"] or status["stopped"])


def _status(helios: Helios) -> Status | None:
    try:
        return helios.status()
    except (Unavailable, DeadlineExceeded):
        return None


def say_stopped(helios: Helios, console: Console) -> None:
    """Print that the task waits for `helios clear-stop`, if the robot is stopped."""
    status = _status(helios)
    if status is not None and status["stopped"]:
        reason = status["stop_reason"]
        why = f" ({escape(reason)})" if reason else ""
        console.print(
            f"[red]the robot is stopped[/]{why}: the task waits for `helios clear-stop`",
            highlight=False,
            soft_wrap=True,
        )


def run_task(helios: Helios, instruction: str, timeout_s: float, console: Console) -> Task:
    """Submit a task and watch it."""
    return watch_task(helios, helios.submit(instruction), timeout_s, console)


def watch_task(
    helios: Helios,
    task: Task,
    timeout_s: float,
    console: Console,
    notes: Console | None = None,
    cancels: bool = True,
) -> Task:
    """Show a task until it has ended, and return it. Without a terminal each change of state, phase
    or message is a line.

    Ctrl-C first cancels the task and waits for its end; with `cancels` False the task goes on.
    `notes`: console for the note that the robot is stopped. Raises KeyboardInterrupt after Ctrl-C,
    HeliosError, and HungUp if the terminal was closed; the task then goes on.
    """
    try:
        with hangup_raises(f"the task continues; watch it with: helios watch {task.id}"):
            console.print(
                f"task {task.id}: {task.instruction}",
                highlight=False,
                markup=False,
                soft_wrap=True,
            )
            if notes is not None:
                say_stopped(helios, notes)
            if console.is_terminal:
                return _watch_live(helios, task, timeout_s, console)
            return _watch_lines(helios, task, timeout_s, console)
    except KeyboardInterrupt:
        if not cancels:
            console.print(
                f"the task continues; end it with: helios cancel {task.id}",
                highlight=False,
                markup=False,
                soft_wrap=True,
            )
            raise
        console.print("cancelling the task")
        try:
            cancel_with_retries(lambda: helios.cancel(task.id))
        except (HeliosError, KeyboardInterrupt):
            console.print(
                "the cancellation was not confirmed, so the task may continue; end it with: "
                f"helios cancel {task.id}",
                highlight=False,
                markup=False,
                soft_wrap=True,
            )
            raise
        console.print(helios.wait(task.id, CANCEL_S).message, highlight=False, markup=False)
        raise


def cancel_with_retries(cancel: Callable[[], object]) -> None:
    """Cancel a task; retry for `CANCEL_S` while the gateway does not answer. Raises HeliosError."""
    deadline_s = time.monotonic() + CANCEL_S
    while True:
        try:
            cancel()
            return
        except Conflict:  # it has already ended
            return
        except (Unavailable, DeadlineExceeded):
            if time.monotonic() >= deadline_s:
                raise
        time.sleep(POLL_S)


def _watch_live(helios: Helios, task: Task, timeout_s: float, console: Console) -> Task:
    with Live(panel(task, ""), console=console, refresh_per_second=8) as live:
        return helios.wait(
            task.id, timeout_s, lambda t: live.update(panel(t, newest_why(helios, t)))
        )


def _watch_lines(helios: Helios, task: Task, timeout_s: float, console: Console) -> Task:
    said: list[tuple[str, str, str]] = []

    def say(t: Task) -> None:
        line = (t.state, t.phase, t.message)
        if not said or said[-1] != line:
            said.append(line)
            left = f" ({time_left(t)})" if time_left(t) else ""
            phase = f" {t.phase.replace('_', ' ')}" if t.phase else ""
            console.print(
                f"{t.state} {t.progress:4.0%}{phase}: {t.message}{left}",
                highlight=False,
                markup=False,
                soft_wrap=True,
            )

    return helios.wait(task.id, timeout_s, say)


def newest_why(helios: Helios, task: Task) -> str:
    """Reason of the newest decision; empty if it is not available."""
    try:
        decisions = helios.decisions(task.id)
    except HeliosError:
        return ""
    return decisions[-1].why if decisions else ""
