"""`helios status`, `stop`, `clear-stop`, `key`, `mcp`: state, stop-now, who may ask."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from helios_core.text import printable

from helios_client.commands.options import At, Json, State, console, flat, print_json

app = typer.Typer()


@app.command()
@flat
def status(at: At, state: State = None, as_json: Json = False) -> None:
    """How every service is, and whether stop-now is latched. Works while the gateway is down."""
    from rich.markup import escape

    from helios_client.commands.status import find_status, status_table

    with at.connect(timeout_s=3.0) as helios:
        found = find_status(helios, at.port if at.url is None else None, state, at.robot)
    if as_json:
        print_json(found)
        return
    screen = console()
    screen.print(status_table(found))
    if found["stopped"]:
        why = f" ({escape(printable(found['stop_reason']))})" if found["stop_reason"] else ""
        screen.print(
            f"[red]stop-now is latched[/]{why}: the robot will not move; helios clear-stop"
        )
    screen.print("ready" if found["ready"] else "not ready")


@app.command()
@flat
def stop(
    at: At,
    reason: Annotated[str, typer.Option(help="told to whoever asks")] = "helios stop",
    as_json: Json = False,
) -> None:
    """Stop the robot now; it will not move until helios clear-stop."""
    with at.connect() as helios:
        answer = helios.stop_robot(reason)
    if as_json:
        print_json(answer)
    else:
        print("stopped; it will not move until: helios clear-stop")


@app.command(name="clear-stop")
@flat
def clear_stop(at: At, as_json: Json = False) -> None:
    """Lift stop-now: the robot may move again."""
    with at.connect() as helios:
        answer = helios.clear_stop()
    if as_json:
        print_json(answer)
    else:
        print("cleared; the robot may move again")


@app.command()
def key(
    name: Annotated[str, typer.Argument(help="whose it is, such as tablet")],
    scope: Annotated[
        Literal["read", "operate", "admin"],
        typer.Option(help="read: look and stop; operate: tasks, too; admin: settings, too"),
    ] = "operate",
    file: Annotated[Path, typer.Option(help="of the keys' hashes")] = Path("keys.toml"),
) -> None:
    """Make an API key, shown once. HELIOS_GATEWAY_KEYS=FILE helios up asks for keys."""
    from helios_client.commands.keys import add_key

    print(add_key(file, name, scope))


@app.command()
@flat
def mcp(at: At) -> None:
    """Serve the robot to a language agent over MCP. On standard input and output."""
    import logging

    from helios_client.mcp_server import build
    from helios_client.sdk_async import AsyncHelios

    logging.getLogger("httpx").setLevel(logging.WARNING)  # else a line for every request
    build(AsyncHelios(at.base_url, key=at.key, robot=at.robot)).run("stdio")
