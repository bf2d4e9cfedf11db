"""Commands that measure and check: `helios bench`, `calibrate`, `eval`, `doctor`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, NoReturn

import typer

from helios_client.commands.shared_options import (
    Certs,
    GatewayAddress,
    Json,
    TypedPort,
    Url,
    console,
    print_json,
    print_line,
)

app = typer.Typer()


@app.command()
def bench(
    json_path: Annotated[Path, typer.Option("--json", help="JSON file for the measured times")],
    only: Annotated[str | None, typer.Option(help="name of the only row to measure")] = None,
    compare: Annotated[
        Path | None, typer.Option(help="JSON file of an earlier run to compare the ratios with")
    ] = None,
    runs: Annotated[int, typer.Option(help="times that all rows are measured", min=1)] = 3,
) -> None:
    """Time the services' inner loops against other implementations.

    With --compare the command prints what got slower by more than noise, and exits with status 1 if
    anything did. Noise is three standard errors of the difference of the two ratios, by the repeats
    or by the runs, whichever is larger, and at least 10 %.
    """
    try:
        from helios_eval.bench import main as run_bench
        from helios_eval.bench.benchmark_run import ROWS
    except ImportError as error:
        from helios_core.errors import Unavailable

        raise Unavailable(
            f"the benchmarks cannot be loaded ({error}); pip install 'helios-ovmm[bench]'"
        ) from error
    if only is not None and only not in ROWS:
        from helios_client.usage_errors import UsageError

        raise UsageError(f"no row is called {only!r}; wanted one of {', '.join(ROWS)}")
    if run_bench(only, json_path, compare, runs):
        raise typer.Exit(1)


@app.command()
def calibrate(
    detector: Annotated[
        str,
        typer.Option(
            help="detector: onnx:FILE or another of docs/how-to/models.md; recorded: the "
            "detections that the recordings have; simulated:TABLE with --homes"
        ),
    ],
    out: Annotated[Path, typer.Option(help="file of the error model")],
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(help="recordings or data sets that helios replay plays; each a static room"),
    ] = None,
    places: Annotated[
        Path | None,
        typer.Option(help="CSV file of known things, name,x,y,z in metres; cup|mug: either name"),
    ] = None,
    homes: Annotated[
        str, typer.Option(help="simulated homes instead of recordings: seeds below 1000, as 0-19")
    ] = "",
    preset: Annotated[str, typer.Option(help="preset of the homes")] = "ovmm-v1",
    things: Annotated[int, typer.Option(help="things of each home to look at", min=1)] = 10,
    truth: Annotated[
        bool, typer.Option(help="use the truth of the homes, or agreement between views alone")
    ] = True,
    chart: Annotated[Path | None, typer.Option(help="PNG file for a chart")] = None,
    threads: Annotated[int, typer.Option(help="threads of a real detector", min=1)] = 1,
    as_json: Json = False,
) -> None:
    """Fit the error model of a detector, which the object map uses, from recordings or homes."""
    try:
        from helios_eval.error_models import command
    except ImportError as error:
        from helios_core.errors import Unavailable

        raise Unavailable(
            f"the calibration cannot be loaded ({error}); pip install 'helios-ovmm[all]'"
        ) from error
    job = command.Job(
        tuple(recordings or ()), detector, out, homes, preset, things, places, truth,
        threads, chart,
    )  # fmt: skip
    built = command.calibrate(job, lambda text: print_line(text, stderr=True))
    if as_json:
        print_json(command.answer(built))
    else:
        for line in command.lines(built, out):
            print_line(line)


@app.command(
    name="eval",
    add_help_option=False,
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
)
def evaluate(context: typer.Context) -> None:
    """Run episodes in simulated homes, judged by ground truth. See helios eval --help."""
    try:
        from helios_eval.eval_command import app as eval_app
    except ImportError as error:
        from helios_core.errors import Unavailable

        raise Unavailable(
            f"the evaluation cannot be loaded ({error}); pip install 'helios-ovmm[all]'"
        ) from error
    command = typer.main.get_command(eval_app)
    code = command.main(context.args, prog_name="helios eval", standalone_mode=False)
    raise typer.Exit(code if isinstance(code, int) else 0)


@app.command()
def doctor(
    robot: Annotated[
        bool,
        typer.Option(
            "--robot",
            help="check the robot's set-up; THE ROBOT TURNS on the spot, then DRIVES to and fro "
            "where it sees free floor",
        ),
    ] = False,
    drive: Annotated[
        bool,
        typer.Option(
            "--drive/--no-drive",
            help="--no-drive: it only turns, and the depth's scale is not checked",
        ),
    ] = True,
    name: Annotated[
        str | None, typer.Option(help="with --robot: name of one of several robots")
    ] = None,
    port: TypedPort = None,
    url: Url = None,
    key: Annotated[
        str | None, typer.Option(help="API key, if one is required", envvar="HELIOS_API_KEY")
    ] = None,
    certs: Certs = None,
    as_json: Json = False,
) -> None:
    """Check the requirements on this machine, or with --robot the robot's camera, depth, poses and
    times. Exit status 1 if the simulator lacks a requirement, or something is wrong with the
    robot; notes name optional parts."""
    from helios_client.usage_errors import UsageError

    if robot:
        _check_robot(GatewayAddress(port, url, key, name), drive, as_json)
    if not drive or name or url:
        raise UsageError("--no-drive, --name and --url belong to --robot; add it")
    _check_machine(port or 8080, certs, as_json)


def _check_robot(at: GatewayAddress, drive: bool, as_json: bool) -> NoReturn:
    """Print the checks of the robot's set-up, and exit with 1 if something is wrong."""
    from helios_client.commands import doctor_robot

    with at.connect() as helios:
        found, ended_early = doctor_robot.check_robot(
            helios, drive, lambda text: print_line(text, stderr=True)
        )
    if as_json:
        print_json(doctor_robot.as_json(found, ended_early))
    else:
        console().print(doctor_robot.checks_table(found))
    if ended_early:
        print_line(f"helios: the motion ended early: {ended_early}", stderr=True)
    raise typer.Exit(1 if ended_early or doctor_robot.is_wrong(found) else 0)


def _check_machine(port: int, certs: Path | None, as_json: bool) -> NoReturn:
    """Print the checks of this machine, and exit with 1 if a requirement is missing."""
    from dataclasses import asdict

    from helios_client.commands.doctor import examine

    findings = examine(port, certs=certs)
    if as_json:
        print_json({"findings": [asdict(finding) for finding in findings]})
    for finding in [] if as_json else findings:
        mark = "ok     " if finding.ok else "note   " if finding.optional else "MISSING"
        print(f"{mark} {finding.what}" + ("" if finding.ok else f": {finding.remedy}"))
    raise typer.Exit(0 if all(f.ok or f.optional for f in findings) else 1)
