"""`helios faults`: faults with their states and counts, and the recordings around them."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from helios_client.answer_types import Fault, FaultList, FaultRecording
from helios_client.commands.shared_options import (
    GatewayAddress,
    Json,
    console,
    flatten_options,
    print_json,
)

RECORDING = re.compile(r"[A-Za-z0-9_-]+\.mcap")

app = typer.Typer()


@app.command()
@flatten_options
def faults(
    at: GatewayAddress,
    clear: Annotated[
        str | None,
        typer.Option(help="clear this fault, such as that of a failed task", metavar="ID"),
    ] = None,
    save: Annotated[
        str | None,
        typer.Option(help="get this recording: its name, or last", metavar="RECORDING"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="file or folder for --save  [default: this folder]")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the faults: what was raised, confirmed and cleared, how often, and its recordings."""
    from helios_client.usage_errors import UsageError

    if clear is not None and save is not None:
        raise UsageError("--clear and --save are two requests; give one at a time")
    if out is not None and save is None:
        raise UsageError("--out is for --save, which names the recording to get")
    with at.connect() as helios:
        if clear is not None:
            helios.clear_fault(clear)
        found = helios.faults()
        if save is not None:
            name = _named(found, save)
            data = helios.fault_recording(name)
            path = _write(out, name, data)
            print_json({"file": str(path), "bytes": len(data)}) if as_json else print(path)
            return
    if as_json:
        print_json(found.raw)
        return
    console().print(*_report(found), sep="\n")


def _named(found: FaultList, name: str) -> str:
    """Name of the newest recording for `last`. Raises UsageError if there is none, and for a name
    that no recording has: it becomes a file name, and may come from the gateway."""
    from helios_client.usage_errors import UsageError

    if name.casefold() == "last":
        finished = [r for r in found.recordings if r.bytes is not None]
        if not finished:
            raise UsageError("there is no finished recording; helios faults lists them")
        name = finished[0].name
    if RECORDING.fullmatch(name) is None:
        raise UsageError(
            f"no recording has the name {name!r}; wanted one such as "
            "20260102T030405Z-map2d-restarted.mcap; helios faults lists them"
        )
    return name


def _write(out: Path | None, name: str, data: bytes) -> Path:
    from helios_core.atomic_file import unwritable_reason, write_file
    from helios_core.errors import Unavailable

    from helios_client.usage_errors import UsageError

    path = Path(name) if out is None else out / name if out.is_dir() else out
    if why := unwritable_reason(path):
        raise UsageError(why)
    try:
        write_file(path, data)
    except OSError as error:
        raise Unavailable(f"{path} cannot be written: {error.strerror or error}") from error
    return path


def _report(found: FaultList) -> list[object]:
    from rich.markup import escape

    if not found.faults:
        return ["no fault is known"]
    parts: list[object] = [_fault_table(found.faults)]
    if found.recordings:
        parts += ["", _recording_table(found.recordings)]
    if found.folder:
        parts += ["", f"[dim]recordings: {escape(found.folder)}[/]"]
    return parts


def _fault_table(faults: Sequence[Fault]) -> object:
    from rich.markup import escape

    from helios_client.terminal_output import plain_table

    colors = {"confirmed": "red", "raised": "yellow", "cleared": "green"}
    table = plain_table("fault", "state", "times", "last", "message")
    for fault in faults:
        color = colors.get(fault.state, "default")
        table.add_row(
            escape(fault.id),
            f"[{color}]{fault.state}[/]",
            str(fault.count),
            _ago(fault.last_s),
            escape(fault.message),
        )
    return table


def _recording_table(recordings: Sequence[FaultRecording]) -> object:
    from rich.markup import escape

    from helios_client.terminal_output import plain_table

    table = plain_table("recording", "MB", "shows")
    for recording in recordings:
        size = "being made" if recording.bytes is None else f"{recording.bytes / 1e6:.1f}"
        shows = [*recording.faults, *(f"task {task}" for task in recording.tasks)]
        table.add_row(escape(recording.name), size, escape(", ".join(shows)))
    return table


def _ago(at_s: float) -> str:
    age_s = max(time.time() - at_s, 0.0)
    for unit_s, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if age_s >= unit_s:
            return f"{age_s / unit_s:.0f} {unit} ago"
    return f"{age_s:.0f} s ago"
