"""`helios up`, `record`, `replay`: what starts services."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from helios_client.commands.shared_options import State, TypedPort, Url, console, flat
from helios_client.commands.up_options import UpOptions

app = typer.Typer()


@app.command()
@flat
def up(options: UpOptions) -> None:
    """Start every service on this machine, until Ctrl-C."""
    from helios_client.supervision.up import Screen
    from helios_client.supervision.up import up as run_up

    run_up(options.checked(), Screen())


@app.command()
def record(
    out: Annotated[Path, typer.Option(help="folder of the recordings")] = Path("recordings"),
    port: TypedPort = None,
    state: State = None,
    router: Annotated[
        str | None, typer.Option(help="tcp/HOST:PORT  [default: that of the running helios up]")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="the robot's name  [default: that of helios up]")
    ] = None,
    url: Url = None,
) -> None:
    """Record every topic of a running robot into MCAP. Until Ctrl-C."""
    from helios_client.commands.record import record as run_record
    from helios_client.commands.shared_options import chosen_address
    from helios_client.http.address import PORT

    address = None
    if router is None and state is None:
        port, address = chosen_address(port, url)
    run_record(out, port or PORT, state, router, name, None if port else address)


@app.command()
def replay(
    dataset: Annotated[Path, typer.Argument(help="recording (.mcap), data set or ROS bag")],
    out: Annotated[Path, typer.Option(help="folder for the results")],
    classes: Annotated[
        str | None,
        typer.Option(help='what to look for: "cup,dining table"  [default: what was sought then]'),
    ] = None,
    detector: Annotated[
        str | None,
        typer.Option(help="onnx:FILE, package:Class or another  [default: what was found then]"),
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
    strict: Annotated[
        bool,
        typer.Option(
            "--strict", help="refuse a damaged recording, end at a frame that cannot be read"
        ),
    ] = False,
    topics: Annotated[
        str, typer.Option(help='of a ROS bag: "color=/a,depth=/b,info=/c,pose=/d"')
    ] = "",
) -> None:
    """Play a recording or data set, and write what was found. Through the same services."""
    from helios_client.interrupt_signals import noted_interrupts

    with noted_interrupts() as interrupts:
        from helios_client.replay.input_selection import check_source, what_to_seek
        from helios_client.replay.run import Pace, ReplayJob
        from helios_client.replay.run import replay as run_replay
        from helios_client.supervision.flag_checks import check_detector

        screen = console()
        check_source(dataset)
        context, detector = what_to_seek(dataset, classes, thresholds, detector)
        detector = check_detector(detector)
        pace = Pace(limit, from_s, to_s, rate, free_running, topics, strict)
        job = ReplayJob(dataset, context, detector, out, pace)
        results = run_replay(job, interrupts, screen)
        screen.print(results.table())  # first, for a full disk must not take it along
        results.write(out)
        so_far = "interrupted: what was found so far is " if results.summary["interrupted"] else ""
        screen.print(f"{so_far}written to {out}", highlight=False)
        interrupts.check()
