"""`helios why`: decisions of a task with their reasons, also under other settings."""

from __future__ import annotations

from typing import Annotated

import typer

from helios_client.answer_types import Task, Trace
from helios_client.commands.shared_options import (
    GatewayAddress,
    Json,
    console,
    flatten_options,
    named_values,
    print_json,
)

app = typer.Typer()


@app.command()
@flatten_options
def why(
    at: GatewayAddress,
    task: Annotated[str, typer.Argument(help="id of the task or its beginning, or last")] = "last",
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="recompute every decision with this setting and show which would flip, for "
            "example alpha_d=0.01; repeatable",
            metavar="NAME=VALUE",
        ),
    ] = None,
    top: Annotated[
        int, typer.Option(help="candidates to show per decision; 0: sentences only", min=0)
    ] = 3,
    everything: Annotated[
        bool, typer.Option("--all", help="with --set: also show decisions that would stay the same")
    ] = False,
    traced: Annotated[
        bool,
        typer.Option(
            "--trace",
            help="show instead where its time went and its slowest chain of work; needs helios up "
            "--tracing",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Explain a task by its decisions. Shows the candidates and one sentence for each."""
    from helios_client.commands.decision_view import flips, report
    from helios_client.commands.tables import task_by_name
    from helios_client.usage_errors import UsageError

    if traced and changes:
        raise UsageError("--trace and --set are two questions; ask one at a time")
    named_values(changes or ())  # checked before the gateway is queried
    with at.connect() as helios:
        found = task_by_name(helios, task)
        if traced:
            _show_trace(found, helios.trace(found.id), as_json)
            return
        decisions = helios.decisions(found.id, changes or ())
    if as_json:
        out = {"task": found.raw, "decisions": [d.raw for d in decisions]}
        if changes:
            out |= {"set": changes, "flips": len(flips(decisions))}
        print_json(out)
        return
    console().print(report(found, decisions, changes or (), top, everything))


def _show_trace(task: Task, trace: Trace, as_json: bool) -> None:
    from helios_client.commands.trace_view import trace_json, trace_report

    if as_json:
        print_json({"task": task.raw, **trace_json(trace)})
    else:
        console().print(trace_report(task, trace))
