"""`helios view`: the running robot or a recording in Foxglove and Rerun."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from helios_client.commands.shared_options import Certs, State, TypedPort, Url

app = typer.Typer()

FoxglovePort = Annotated[int, typer.Option(help="port for Foxglove", min=1, max=65535)]
RerunPort = Annotated[int, typer.Option(help="port for Rerun's viewers", min=1, max=65535)]
Router = Annotated[
    str | None,
    typer.Option(help="router, tcp/HOST:PORT  [default: that of the running helios up]"),
]
Name = Annotated[
    str | None, typer.Option(help="name of the robot  [default: that of the running helios up]")
]
WebPort = Annotated[int, typer.Option(help="port of Rerun's web page", min=1, max=65535)]


@app.command()
def view(
    recording: Annotated[
        Path | None,
        typer.Argument(help="recording to show: FILE.mcap or a folder  [default: the robot]"),
    ] = None,
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="serve Foxglove (extra foxglove)")
    ] = False,
    rerun: Annotated[bool, typer.Option("--rerun", help="serve Rerun (extra rerun)")] = False,
    save: Annotated[
        Path | None, typer.Option(help="with --rerun: write this .rrd file instead of serving")
    ] = None,
    foxglove_port: FoxglovePort = 8765,
    rerun_port: RerunPort = 9876,
    web_port: WebPort = 9090,
    speed: Annotated[
        float, typer.Option(help="speed of a recording in Foxglove; 1: as recorded", min=0.01)
    ] = 1.0,
    port: TypedPort = None,
    state: State = None,
    router: Router = None,
    certs: Certs = None,
    name: Name = None,
    url: Url = None,
) -> None:
    """Show a running robot, or a recording, in Foxglove or Rerun until Ctrl-C. Both listen on this
    machine only."""
    import threading

    from helios_core.signal_handling import ending_signals, on_signals
    from helios_viewers.view import ViewOptions
    from helios_viewers.view import view as run_view

    from helios_client.commands.record import BusAddress, bus_address
    from helios_client.commands.shared_options import print_line
    from helios_client.usage_errors import UsageError

    if not (foxglove or rerun):
        raise UsageError("name a viewer: --foxglove, --rerun or both")
    if save is not None and not rerun:
        raise UsageError("--save is valid only with --rerun")
    bus = BusAddress(router, certs, name or "robot")
    if recording is None:
        bus = bus_address("helios view", port, state, router, certs, name, url)
    elif not recording.exists():
        raise UsageError(f"there is no recording {recording}; give one of `helios record`")
    options = ViewOptions(
        recording=recording,
        router=bus.link() if recording is None else None,
        robot=bus.robot,
        save=save,
        web_port=web_port,
        foxglove_port=foxglove_port if foxglove else None,
        rerun_port=rerun_port if rerun and save is None else None,
        speed=speed,
    )
    stopping = threading.Event()
    on_signals(ending_signals(), stopping.set)
    run_view(options, stopping, lambda text: print_line(text, stderr=True, flush=True))
