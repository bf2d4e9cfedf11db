"""Commands that only move the robot: `helios go`, `explore`, `home`."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from helios_client.commands.shared_options import GatewayAddress, Json, flatten_options
from helios_client.commands.tasks import NoWait, Timeout, submit_and_watch

app = typer.Typer()

# Makes the parser take a negative number for an argument, not an option.
NUMBERS = {"ignore_unknown_options": True}


@app.command(context_settings=NUMBERS)
@flatten_options
def go(
    x: Annotated[float, typer.Argument(help="x in metres, in the world frame", show_default=False)],
    y: Annotated[float, typer.Argument(help="y in metres, in the world frame", show_default=False)],
    at: GatewayAddress,
    yaw: Annotated[
        float | None,
        typer.Argument(
            help="final heading in degrees, counter-clockwise from the x axis  [default: any]",
            show_default=False,
        ),
    ] = None,
    as_json: Json = False,
    timeout_s: Timeout = 3600.0,
    no_wait: NoWait = False,
) -> None:
    """Go to a point; exit status 0 on arrival.

    Example: helios go 3.2 -4.1 90. The yaw is in degrees here, in radians over HTTP. If the point
    is out of reach, the command prints the reason and the nearest place that the robot can reach.
    """
    from helios_client.usage_errors import UsageError

    for name, value in (("X", x), ("Y", y), ("YAW", yaw or 0.0)):
        if not math.isfinite(value):
            raise UsageError(f"{name} is {value}; wanted a number, such as helios go 3.2 -4.1 90")
    yaw_rad = None if yaw is None else math.radians(yaw)
    submit_and_watch(at, lambda helios: helios.go(x, y, yaw_rad), as_json, timeout_s, no_wait)


@app.command()
@flatten_options
def explore(
    at: GatewayAddress,
    time_limit_s: Annotated[
        float | None,
        typer.Option(
            help="seconds after which the task ends with success  [default: no limit]", min=0.1
        ),
    ] = None,
    as_json: Json = False,
    timeout_s: Timeout = 3600.0,
    no_wait: NoWait = False,
) -> None:
    """Explore until all reachable floor is known, or the time is up."""
    from helios_client.usage_errors import check_finite

    check_finite("--time-limit-s", time_limit_s)
    submit_and_watch(at, lambda helios: helios.explore(time_limit_s), as_json, timeout_s, no_wait)


@app.command()
@flatten_options
def home(
    at: GatewayAddress, as_json: Json = False, timeout_s: Timeout = 3600.0, no_wait: NoWait = False
) -> None:
    """Go back to where the robot started in this world."""
    submit_and_watch(at, lambda helios: helios.home(), as_json, timeout_s, no_wait)
