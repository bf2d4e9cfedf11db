"""`helios status`, `logs`, `camera`, `stop`, `clear-stop`, `key`, `mcp`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from helios_client.commands.shared_options import (
    GatewayAddress,
    Json,
    State,
    TypedPort,
    Url,
    console,
    flatten_options,
    print_json,
    print_line,
)
from helios_client.quick_stop import REASON, SENTENCE

if TYPE_CHECKING:
    from helios_client.answer_types import RobotAnswer

app = typer.Typer()


@app.command()
@flatten_options
def status(at: GatewayAddress, state: State = None, as_json: Json = False) -> None:
    """Show the services' health, and whether the robot is stopped. Without --robot: all robots of
    the gateway. Works while the gateway is down."""
    from helios_client.commands.status import closing_lines, find_status, status_table

    with at.connect(timeout_s=3.0) as helios:
        found = find_status(helios, at.port_here, state, at.robot)
    if as_json:
        print_json(found)
        return
    screen = console()
    screen.print(status_table(found))
    for line in closing_lines(found):
        screen.print(line, highlight=False, soft_wrap=True)


@app.command()
def logs(
    service: Annotated[
        str | None, typer.Argument(help="service, such as planner  [default: list all logs]")
    ] = None,
    follow: Annotated[
        bool, typer.Option("--follow", "-f", help="continue with each new line until Ctrl-C")
    ] = False,
    lines: Annotated[int, typer.Option("--lines", "-n", help="number of newest lines", min=0)] = 50,
    port: TypedPort = None,
    url: Url = None,
    state: State = None,
) -> None:
    """Print the log of a service of this machine. Also works after helios up has ended."""

    from helios_client.commands import logs as files

    folder = files.log_folder(port, url, state)
    if service is None:
        for name in files.services_in(folder):
            print_line(f"{name:12} {folder / name}{files.ENDING}")
        return
    file = files.log_file(folder, service)
    newest, opened = files.newest_lines(file, lines)
    with opened:
        for line in newest:
            print_line(line)
        for line in files.new_lines(file, opened) if follow else ():
            print_line(line, flush=True)


@app.command()
@flatten_options
def camera(
    at: GatewayAddress,
    file: Annotated[Path, typer.Argument(help="file to write")] = Path("camera.jpg"),
) -> None:
    """Write the current camera image to a JPEG file. Boxes mark the detections."""
    from helios_client.commands.map_files import check_folder_of, write_file
    from helios_client.usage_errors import UsageError

    if file.suffix.lower() not in ("", ".jpg", ".jpeg"):
        raise UsageError(f"the image is a JPEG, but {file} has another extension; name it .jpg")
    check_folder_of(file)
    with at.connect() as helios:
        write_file(file, helios.camera())
    print_line(str(file))


@app.command()
@flatten_options
def stop(
    at: GatewayAddress,
    reason: Annotated[str, typer.Option(help="reason, shown wherever the stop is shown")] = REASON,
    as_json: Json = False,
) -> None:
    """Stop the robot now; it does not move until helios clear-stop."""
    with at.connect() as helios:
        answer = helios.stop_robot(reason)
    _check_stopped(answer, True, "the robot is stopped; if it moves, use its own stop button")
    if as_json:
        print_json(answer)
    else:
        print(SENTENCE)


@app.command(name="clear-stop")
@flatten_options
def clear_stop(at: GatewayAddress, as_json: Json = False) -> None:
    """Lift the emergency stop; the robot may move again."""
    with at.connect() as helios:
        answer = helios.clear_stop()
    _check_stopped(answer, False, "the stop is cleared")
    if as_json:
        print_json(answer)
    else:
        print("stop cleared; the robot may move again")


def _check_stopped(answer: RobotAnswer, stopped: bool, wanted: str) -> None:
    """Raise Internal unless the answer says that the robot is stopped, or that it is not."""
    from helios_core.errors import Internal

    state: Any = answer["state"]
    if not isinstance(state, dict) or state.get("stopped") is not stopped:
        raise Internal(f"the gateway did not confirm that {wanted}; see helios status")


@app.command()
def key(
    name: Annotated[str, typer.Argument(help="name of the key's user, such as tablet")],
    scope: Annotated[
        str | None,
        typer.Option(
            help="read: view and stop; task: also tasks; robot: also drive by hand, frames, "
            "clear-stop; admin: also settings and maps  [default: task]"
        ),
    ] = None,
    file: Annotated[Path, typer.Option(help="file for the hashes of the keys")] = Path("keys.toml"),
    replace: Annotated[
        bool, typer.Option("--replace", help="replace the key of this name; the old one ends")
    ] = False,
    remove: Annotated[bool, typer.Option("--remove", help="remove the key of this name")] = False,
) -> None:
    """Create an API key, shown once. To require keys: HELIOS_GATEWAY_KEYS=FILE helios up. A running
    gateway reads the file again when it changes."""
    from helios_client.commands.api_keys import add_key, checked_scope, remove_key, replace_key
    from helios_client.usage_errors import UsageError

    if (replace or remove) and (scope is not None or (replace and remove)):
        raise UsageError("--replace keeps the scope, --remove needs none; give one of the three")
    if remove:
        remove_key(file, name)
        print(f"removed: {name}")
    elif replace:
        print(replace_key(file, name))
    else:
        print(add_key(file, name, checked_scope(scope or "task")))


@app.command()
@flatten_options
def mcp(at: GatewayAddress) -> None:
    """Serve the robot to a language agent over MCP. Uses standard input and output."""
    import logging

    from helios_client.mcp_server import build
    from helios_client.sdk_async import AsyncHelios

    logging.getLogger("httpx").setLevel(logging.WARNING)  # INFO logs each request
    build(AsyncHelios(at.base_url, key=at.key, robot=at.robot)).run("stdio")
