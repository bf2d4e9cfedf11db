"""Commands that try HELIOS under faults and load: `helios chaos`, `stop-distance`, `soak`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from helios_chaos.schedule import Kind

app = typer.Typer()

JsonFile = Annotated[Path, typer.Option("--json", help="JSON file for the result")]
Seed = Annotated[int, typer.Option(help="seed of the home, the tasks and the disturbances", min=0)]
Logs = Annotated[Path | None, typer.Option(help="folder for a copy of the services' logs")]


@app.command()
def chaos(
    json_path: JsonFile,
    minutes: Annotated[float, typer.Option(help="end after this time", min=0)] = 10.0,
    seed: Seed = 0,
    faults: Annotated[
        int | None, typer.Option(help="end after this number of faults", min=1)
    ] = None,
    kinds: Annotated[
        str, typer.Option(help='kinds of faults to play: "kill,freeze"; empty: all')
    ] = "",
    longest_s: Annotated[
        float, typer.Option("--longest-s", help="longest duration of one fault, seconds", min=0.1)
    ] = 15.0,
    logs: Logs = None,
) -> None:
    """Play tasks in a simulated home while faults hit the services: killed and frozen processes,
    cut and slow links, a full disk, a jumping clock, wrong messages. Exit status 1 if a task is
    lost or a limit is not met."""
    from helios_client.usage_errors import check_writable

    isolation = _load("isolation")
    wanted = _kinds(kinds)
    check_writable(json_path)
    able = isolation.enter(sys.argv[1:])
    from helios_chaos.chaos_run import ChaosPlan, run_chaos

    plan = ChaosPlan(minutes, seed, json_path, faults, wanted, longest_s, logs)
    result = run_chaos(plan, able, _say)
    for kind, reason in result.skipped.items():
        _say(f"skipped {kind}: {reason}")
    _end(result.misses(), json_path)


@app.command(name="stop-distance")
def stop_distance(
    json_path: JsonFile,
    trials: Annotated[int, typer.Option(help="trials of each cause", min=1)] = 100,
    seed: Seed = 0,
) -> None:
    """Measure in a simulated home how far the robot drives after a stop, and after the loss of
    planner, gateway, the bridge's link and the router; check that a stop outlives every service.
    Exit status 1 if a limit is not met."""
    from helios_client.usage_errors import check_writable

    check_writable(json_path)
    able = _load("isolation").enter(sys.argv[1:])
    from helios_chaos.stop_distance import run_stop_distance

    result = run_stop_distance(trials, seed, json_path, able, _say)
    _end(result.misses(), json_path)


@app.command()
def soak(
    out: Annotated[Path, typer.Option(help="folder for the results")],
    hours: Annotated[
        float | None, typer.Option(help="duration; not with --load", min=0.01, show_default="2")
    ] = None,
    load: Annotated[
        bool, typer.Option("--load", help="measure under load, in a few minutes, instead")
    ] = False,
    seed: Seed = 0,
) -> None:
    """Run tasks and idle in turn for hours, and check that memory, handles and the state folder do
    not grow. With --load: compare the services' times with and without many clients. Exit status 1
    if a limit is not met."""
    from helios_client.usage_errors import UsageError, check_writable

    if load and hours is not None:
        raise UsageError("--load takes as long as its tasks take: omit --hours")
    kind = "load" if load else "soak"
    module, result = _load(f"{kind}_run"), out / f"{kind}.json"
    check_writable(result)
    if load:
        run = module.run_load(seed, out, _say)
    else:
        run = module.run_soak(hours or 2.0, seed, out, _say)
    _end(run.misses(), result)


def _kinds(text: str) -> tuple[Kind, ...]:
    from helios_chaos.schedule import KINDS

    from helios_client.usage_errors import UsageError

    asked = tuple(part.strip() for part in text.split(",") if part.strip())
    if unknown := [kind for kind in asked if kind not in KINDS]:
        raise UsageError(f"no fault is called {unknown[0]!r}; wanted some of {', '.join(KINDS)}")
    return tuple(kind for kind in KINDS if kind in asked) if asked else KINDS


def _load(module: str):
    """Module of `helios_chaos`. Raises Unavailable without its packages."""
    import importlib

    try:
        return importlib.import_module(f"helios_chaos.{module}")
    except ImportError as error:
        from helios_core.errors import Unavailable

        raise Unavailable(
            f"these tests cannot be loaded ({error}); pip install 'helios-ovmm[all]'"
        ) from error


def _say(text: str) -> None:
    print(text, flush=True)


def _end(misses: list[str], path: Path) -> None:
    """Print the misses and the file; exit with status 1 if there are misses."""
    for miss in misses:
        _say(f"missed: {miss}")
    _say(f"{'not passed' if misses else 'passed'}; the result is in {path}")
    raise typer.Exit(1 if misses else 0)
