"""What several commands take, and how they print."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from helios_client.sdk import Helios

Port = Annotated[int, typer.Option(help="port of the HTTP interface", min=1, max=65535)]
Url = Annotated[
    str | None,
    typer.Option(
        help="of a robot elsewhere  [default: http://127.0.0.1:PORT]", envvar="HELIOS_URL"
    ),
]
Key = Annotated[
    str | None, typer.Option(help="API key, where one is wanted", envvar="HELIOS_API_KEY")
]
RobotName = Annotated[
    str | None,
    typer.Option("--robot", help="one of several, by name  [default: the gateway's first]"),
]
Json = Annotated[bool, typer.Option("--json", help="print JSON only")]
State = Annotated[
    Path | None,
    typer.Option(help="folder for state and logs  [default: $XDG_STATE_HOME/helios/PORT]"),
]


def connect(
    port: int, url: str | None, key: str | None, robot: str | None, timeout_s: float = 10.0
) -> Helios:
    """The HTTP interface that the options name."""
    from helios_client.sdk import Helios

    return Helios(url or f"http://127.0.0.1:{port}", timeout_s, key=key, robot=robot)


def console(stderr: bool = False) -> Console:
    from rich.console import Console

    return Console(stderr=stderr)


def print_json(value: object) -> None:
    print(json.dumps(value, indent=1))
