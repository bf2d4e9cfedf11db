"""The command `helios`. Each command imports what it needs only when it runs."""

from __future__ import annotations

import contextlib
import json
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from helios_client.assets import app as assets_app

if TYPE_CHECKING:
    from rich.console import Console

app = typer.Typer(
    name="helios",
    help="Perception and planning for language-directed pick and place.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(assets_app)

Port = Annotated[int, typer.Option(help="port of the HTTP interface", min=1, max=65535)]
Json = Annotated[bool, typer.Option("--json", help="print JSON only")]
State = Annotated[
    Path | None,
    typer.Option(help="folder for state and logs  [default: $XDG_STATE_HOME/helios/PORT]"),
]


@app.command()
def up(
    robot: Annotated[str, typer.Option(help="sim, replay, spot or package:Class")] = "sim",
    port: Port = 8080,
    seed: Annotated[int, typer.Option(help="of the simulated home", min=0)] = 0,
    preset: Annotated[str, typer.Option(help="kind of the simulated home")] = "demo-v1",
    furniture: Annotated[
        str | None,
        typer.Option(help="of the simulated home: parametric or realistic (helios assets bake)"),
    ] = None,
    state: State = None,
    detector: Annotated[
        str | None,
        typer.Option(help="simulated, ground-truth or onnx:FILE  [default: simulated for sim]"),
    ] = None,
    source: Annotated[
        Path | None, typer.Option(help="what --robot replay plays: a recording or data set")
    ] = None,
    rate: Annotated[
        float, typer.Option(help="speed of --robot replay; 0: without waiting", min=0)
    ] = 1.0,
    record: Annotated[
        bool, typer.Option("--record", help="record every topic", envvar="HELIOS_RECORD")
    ] = False,
    record_dir: Annotated[
        Path | None, typer.Option(help="folder of the recordings  [default: STATE/recordings]")
    ] = None,
    spot_host: Annotated[
        str | None, typer.Option(help="of --robot spot; login: HELIOS_SPOT_USERNAME, …_PASSWORD")
    ] = None,
    router_port: Annotated[
        int | None, typer.Option(help="port of the router  [default: a free one]", min=1, max=65535)
    ] = None,
    name: Annotated[str, typer.Option(help="the robot's name on the bus")] = "robot",
) -> None:
    """Start every service on this machine and keep them running until Ctrl-C."""
    from helios_client import state_file
    from helios_client.replay_words import default_detector
    from helios_client.stack import Stack, free_port
    from helios_client.up import up as run_up
    from helios_client.wrong_use import WrongUse

    if robot not in ("sim", "replay", "spot") and ":" not in robot:
        raise WrongUse(f"no robot is called {robot!r}; wanted sim, replay, spot or package:Class")
    if spot_host is not None and robot != "spot":
        raise WrongUse("--spot-host goes with --robot spot, and only with it")
    if detector is None:
        detector = default_detector(robot, source)
    if furniture not in (None, "parametric", "realistic"):
        raise WrongUse(f"no furniture is called {furniture!r}; wanted parametric or realistic")
    if (source is None) is (robot == "replay"):
        raise WrongUse("--source DATASET goes with --robot replay, and only with it")
    state_dir = state or state_file.default_state_dir(port)
    if record and record_dir is None:
        record_dir = state_dir / "recordings"
    run_up(
        Stack(
            robot=robot, router_port=router_port or free_port(),
            state_dir=state_dir, name=name, port=port, seed=seed,
            preset=preset, furniture=furniture, detector=detector, source=source,
            robot_host=spot_host, rate=rate if robot == "replay" else None, record=record_dir,
        ),
        _console(),
    )  # fmt: skip


@app.command()
def task(
    instruction: Annotated[str, typer.Argument(help='such as "Move the mug to the sofa"')],
    port: Port = 8080,
    as_json: Json = False,
    timeout_s: Annotated[float, typer.Option(help="longest wait", min=1.0)] = 3600.0,
) -> None:
    """Submit a task and watch it; exit status 0 if it succeeded."""
    from helios_client.sdk import Helios
    from helios_client.task_view import run_task, wait_while_starting

    with Helios(f"http://127.0.0.1:{port}") as helios:
        wait_while_starting(helios, port, _console(stderr=True))
        # With --json the live view goes to stderr, so that stdout holds JSON and nothing else.
        ended = run_task(helios, instruction, timeout_s, _console(stderr=as_json))
    if as_json:
        _print_json(ended.raw)
    if not ended.succeeded:
        how = "was cancelled" if ended.state == "cancelled" else ended.state
        print(f"helios: the task {how}: {ended.message}", file=sys.stderr)
        raise typer.Exit(1)


@app.command()
def status(port: Port = 8080, state: State = None, as_json: Json = False) -> None:
    """How every service is; works while the gateway is down."""
    from helios_client.status import find_status, status_table

    found = find_status(port, state)
    if as_json:
        _print_json(found)
    else:
        console = _console()
        console.print(status_table(found))
        console.print("ready" if found["ready"] else "not ready")


@app.command()
def record(
    out: Annotated[Path, typer.Option(help="folder of the recordings")] = Path("recordings"),
    port: Port = 8080,
    state: State = None,
    router: Annotated[
        str | None, typer.Option(help="tcp/HOST:PORT  [default: that of the running helios up]")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="the robot's name  [default: that of helios up]")
    ] = None,
) -> None:
    """Record every topic of a running robot into MCAP until Ctrl-C."""
    from helios_client.record import record as run_record

    run_record(out, port, state, router, name)


@app.command()
def replay(
    dataset: Annotated[Path, typer.Argument(help="recording (.mcap), data set or ROS bag")],
    out: Annotated[Path, typer.Option(help="folder for the results")],
    classes: Annotated[
        str | None,
        typer.Option(help='what to look for: "cup,dining table"  [default: what was sought then]'),
    ] = None,
    detector: Annotated[
        str | None, typer.Option(help="onnx:FILE or another  [default: what was found then]")
    ] = None,
    thresholds: Annotated[str, typer.Option(help='"cup=0.25,dining table=0.35"')] = "",
    limit: Annotated[int, typer.Option(help="frames to play; 0: all", min=0)] = 0,
    from_s: Annotated[float, typer.Option("--from", help="begin there, seconds", min=0)] = 0.0,
    to_s: Annotated[
        float | None, typer.Option("--to", help="end there, seconds  [default: its end]", min=0)
    ] = None,
    rate: Annotated[
        float, typer.Option(help="1: as it was recorded, 2: twice as fast, 0: no waiting", min=0)
    ] = 0.0,
    free_running: Annotated[
        bool, typer.Option(help="do not wait for the maps; gives another result each time")
    ] = False,
    topics: Annotated[
        str, typer.Option(help='of a ROS bag: "color=/a,depth=/b,info=/c,pose=/d"')
    ] = "",
) -> None:
    """Play a recording or data set through the services and write what they found."""
    from helios_client.replay import Pace, ReplayJob
    from helios_client.replay import replay as run_replay
    from helios_client.replay_words import what_to_seek

    console = _console()
    context, detector = what_to_seek(dataset, classes, thresholds, detector)
    pace = Pace(limit, from_s, to_s, rate, free_running, topics)
    results = run_replay(ReplayJob(dataset, context, detector, out, pace), console)
    results.write(out)
    console.print(results.table())
    console.print(f"written to {out}", highlight=False)


@app.command()
def bench(
    json_path: Annotated[Path, typer.Option("--json", help="file for the figures")],
    only: Annotated[str | None, typer.Option(help="one row by its name")] = None,
) -> None:
    """Time the services' inner loops against other implementations."""
    try:
        from helios_eval.bench import main as run_bench  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        from helios_core.errors import Unavailable

        raise Unavailable(
            f"the benchmarks cannot be loaded ({error}); pip install 'helios-ovmm[bench]'"
        ) from error
    code: Any = run_bench(only, json_path)
    raise typer.Exit(int(code or 0))


@app.command(
    name="eval",
    add_help_option=False,
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
)
def evaluate(context: typer.Context) -> None:
    """Play episodes in simulated homes, judge them by the truth, report: helios eval --help."""
    try:
        from helios_eval.command import app as eval_app
    except ImportError as error:
        from helios_core.errors import Unavailable

        raise Unavailable(
            f"the evaluation cannot be loaded ({error}); pip install 'helios-ovmm[all]'"
        ) from error
    command = typer.main.get_command(eval_app)
    code = command.main(context.args, prog_name="helios eval", standalone_mode=False)
    raise typer.Exit(code if isinstance(code, int) else 0)


@app.command()
def doctor(port: Port = 8080) -> None:
    """What is missing on this machine, and how to mend it."""
    from helios_client.doctor import examine

    findings = examine(port)
    for finding in findings:
        mark = "ok     " if finding.ok else "MISSING"
        print(f"{mark} {finding.what}" + ("" if finding.ok else f": {finding.mend}"))
    raise typer.Exit(0 if all(f.ok or f.optional for f in findings) else 1)


def main() -> int:
    """The entry point."""
    signal.signal(signal.SIGTERM, _interrupt)
    return run(sys.argv[1:])


def run(args: Sequence[str]) -> int:
    """Run a command; the exit status: 0 only on success, 2 on wrong use."""
    command = typer.main.get_command(app)
    try:
        code = command.main(args=list(args), prog_name="helios", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except KeyboardInterrupt:
        return _interrupted()
    except BrokenPipeError:
        with contextlib.suppress(OSError):
            sys.stdout.close()
        return 1
    except Exception as error:
        return _tell(error)


def _tell(error: Exception) -> int:
    """One sentence on stderr; faults of ours keep their traceback."""
    if hasattr(error, "format_message"):  # of the command-line parser, whichever it is built on
        sentence = error.format_message().rstrip(".")  # pyright: ignore[reportAttributeAccessIssue]
        if sentence:
            print(f"helios: {sentence}; see helios --help", file=sys.stderr)
        return 2
    if type(error).__name__ == "Abort":  # what the parser makes of Ctrl-C
        return _interrupted()
    from helios_core.errors import HeliosError

    from helios_client.wrong_use import WrongUse

    if not isinstance(error, HeliosError):
        raise error
    print(f"helios: {error.message}", file=sys.stderr)
    return 2 if isinstance(error, WrongUse) else 1


def _interrupted() -> int:
    print("helios: interrupted", file=sys.stderr)
    return 130


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def _console(stderr: bool = False) -> Console:
    from rich.console import Console

    return Console(stderr=stderr)


def _print_json(value: object) -> None:
    print(json.dumps(value, indent=1))


if __name__ == "__main__":
    sys.exit(main())
