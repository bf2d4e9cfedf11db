"""Tables of tasks, objects and past views for the terminal."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TypeVar

from rich.markup import escape
from rich.table import Table

from helios_client.answer_types import FleetTask, FoundObject, Seen, SeenName, StoredObject, Task
from helios_client.sdk import Helios
from helios_client.terminal_output import plain_table
from helios_client.usage_errors import UsageError

AnyTask = TypeVar("AnyTask", Task, FleetTask)
TASK_COLORS = {"succeeded": "green", "failed": "red", "cancelled": "yellow", "running": "cyan"}


def task_table(tasks: Sequence[Task]) -> Table:
    """Table with one row per task, with priorities if any is set."""
    ranked = any(task.priority for task in tasks)
    columns = ["id", "state", *(["priority"] if ranked else []), "duration", "steps", "instruction"]
    out = plain_table(*columns, "message")
    for task in tasks:
        color = TASK_COLORS.get(task.state, "default")
        priority = [str(task.priority)] if ranked else []
        out.add_row(
            task.id,
            f"[{color}]{task.state}[/]",
            *priority,
            _took(task),
            str(task.steps),
            escape(task.instruction),
            escape(task.message),
        )
    return out


def object_table(objects: Sequence[FoundObject]) -> Table:
    """Table with one row per instance: score Ψ, class score S and uncertainty U of eq. 7."""
    marked = any(found.relocalisation for found in objects)
    columns = ["id", "class", "Ψ", "S", "U", "views", "centre (m)", "size (m)"]
    out = plain_table(*columns, *(["stored"] if marked else []))
    for found in objects:
        out.add_row(
            str(found.id),
            escape(found.class_name),
            f"{found.score:.2f}",
            f"{found.class_score:.2f}",
            f"{found.uncertainty:.2f}",
            str(found.views),
            _metres(found.center_m),
            _metres(found.size_m),
            *([found.relocalisation or ""] if marked else []),
        )
    return out


def stored_table(objects: Sequence[StoredObject]) -> Table:
    """Table with one row per object of a stored map that is not in use."""
    out = plain_table("stored", "class", "Ψ", "views", "centre (m)", "size (m)")
    for found in objects:
        out.add_row(
            found.relocalisation,
            escape(found.class_name),
            f"{found.score:.2f}",
            str(found.views),
            _metres(found.center_m),
            _metres(found.size_m),
        )
    return out


def seen_name_table(seen: Sequence[SeenName]) -> Table:
    """Table with one row per class name: highest score Ψ and number of objects."""
    out = plain_table("seen here", "Ψ", "objects")
    for one in seen:
        out.add_row(escape(one["name"]), f"{one['score']:.2f}", str(one["objects"]))
    return out


def seen_tables(found: Seen) -> list[Table | str]:
    """Tables of objects and past views, or a sentence in the place of an empty one."""
    out: list[Table | str] = []
    if found.objects:
        out.append(object_table(found.objects))
    else:
        out.append(escape(f"the map has no object of that name: {found.prompt}"))
    if found.stored:
        out.append(stored_table(found.stored))
    if found.views:
        views = plain_table("past view", "class", "score", "at (m)", "camera (m)", "time (s)")
        for number, view in enumerate(found.views, start=1):
            camera = view.camera
            stood = _metres([camera["x_m"], camera["y_m"]]) if camera else "-"
            views.add_row(
                str(number),
                escape(view.class_name) or "-",
                f"{view.score:.2f}",
                _metres(view.center_m),
                stood,
                f"{view.stamp_s:.1f}",
            )
        out.append(views)
    elif found.views_asked or not found.views_note:
        out.append(f"none of {found.views_asked} past views fits the prompt")
    if found.views_note:
        out.append(escape(found.views_note))
    return out


def task_by_name(helios: Helios, id: str) -> Task:
    """Newest task for `last`, else the task whose id starts with `id`. Raises UsageError if none or
    more than one matches."""
    if id.casefold() == "last":
        newest = helios.tasks(limit=1)
        if not newest:
            raise UsageError("there is no task yet; submit one with helios task")
        return newest[0]
    return task_by_prefix(helios.tasks(), id, "helios tasks")


def fleet_task_by_name(helios: Helios, id: str) -> FleetTask:
    """As `task_by_name`, among the tasks of the fleet."""
    tasks = helios.fleet_tasks()
    if id.casefold() != "last":
        return task_by_prefix(tasks, id, "helios tasks --robot any")
    if not tasks:
        raise UsageError("the fleet has no task yet; submit one with helios task --robot any")
    return tasks[0]


def task_by_prefix(tasks: Sequence[AnyTask], id: str, command: str) -> AnyTask:
    """Task whose id starts with `id`. command: the one that lists the tasks. Raises UsageError if
    none or more than one matches."""
    id = id.casefold()  # ids are lower-case hexadecimal
    fitting = [task for task in tasks if task.id.startswith(id)]
    exact = [task for task in fitting if task.id == id]
    if exact or len(fitting) == 1:
        return (exact or fitting)[0]
    if not fitting:
        raise UsageError(f"there is no task {id!r}; list them with {command}")
    raise UsageError(f"the ids of {len(fitting)} tasks begin with {id!r}; give more of the id")


def _took(task: Task) -> str:
    if not task.started_s:
        return "-"
    return f"{max((task.ended_s or time.time()) - task.started_s, 0):.0f} s"


def _metres(values: Sequence[float | None]) -> str:
    return " ".join("-" if v is None else f"{v:.2f}" for v in values)
