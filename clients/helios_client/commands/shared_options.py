"""Options that commands share, and functions for their output."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

if TYPE_CHECKING:
    from helios_client.sdk import Helios
    from helios_client.terminal_output import Screen

LOOPBACK = ("127.0.0.1", "::1", "localhost")

Port = Annotated[int, typer.Option(help="port of the HTTP interface", min=1, max=65535)]
Json = Annotated[bool, typer.Option("--json", help="print JSON only")]
State = Annotated[
    Path | None,
    typer.Option(help="folder for state and logs  [default: $XDG_STATE_HOME/helios/PORT]"),
]


Certs = Annotated[
    Path | None,
    typer.Option(help="folder of helios certs: encrypts the bus", envvar="HELIOS_CERTS"),
]
TypedPort = Annotated[
    int | None,
    typer.Option(help="port of a helios up on this machine  [default: 8080]", min=1, max=65535),
]
Url = Annotated[
    str | None,
    typer.Option(
        help="address of a gateway elsewhere: HOST:PORT or http://HOST:PORT  [env var: HELIOS_URL]"
    ),
]


def chosen_address(port: int | None, url: str | None) -> tuple[int | None, str]:
    """Result of `http.address.chosen` for the typed options. Raises UsageError."""
    from helios_client.http.address import chosen
    from helios_client.usage_errors import UsageError

    try:
        return chosen(port, url, os.environ)
    except ValueError as error:
        raise UsageError(str(error)) from error


@dataclass(frozen=True)
class GatewayAddress:
    """Options that select the gateway and robot of a command."""

    port: TypedPort = None
    url: Url = None
    key: Annotated[
        str | None, typer.Option(help="API key, if one is required", envvar="HELIOS_API_KEY")
    ] = None
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            help="name of one of several robots; any, for tasks: of the fleet  "
            "[default: the gateway's first]",
        ),
    ] = None

    @property
    def is_for_fleet(self) -> bool:
        """True for --robot any."""
        from helios_core.name_rules import ANY_ROBOT

        return self.robot == ANY_ROBOT

    @property
    def port_here(self) -> int | None:
        """Port on this machine; None if a URL selects the robot. Raises UsageError."""
        return chosen_address(self.port, self.url)[0]

    @property
    def _port_on_this_machine(self) -> int | None:
        """The typed or default port, or that of a URL of this machine (0: no port in it); None for
        a URL of another machine. Raises UsageError."""
        from helios_client.http.address import split_url

        port, url = chosen_address(self.port, self.url)
        parts = split_url(url)
        return port or (parts.port or 0 if parts.hostname in LOOPBACK else None)

    @property
    def base_url(self) -> str:
        """URL of the gateway. Raises UsageError for an invalid address."""
        from helios_client.http.address import base_url

        return base_url(chosen_address(self.port, self.url)[1])

    @contextmanager
    def connect(self, timeout_s: float = 10.0) -> Iterator[Helios]:
        """Client of the gateway that the options select. If nothing answers there, the NoGateway
        error also names the ports of stacks on this machine."""
        from helios_client.http.errors import NoGateway
        from helios_client.sdk import Helios
        from helios_client.supervision.state_file import running_ports

        with Helios(self.base_url, timeout_s, key=self.key, robot=self.robot) as helios:
            try:
                yield helios
            except NoGateway as error:
                if (here := self._port_on_this_machine) is None:
                    raise
                ports = [port for port in running_ports() if port != here]
                known = f": one runs with --port {' and one with --port '.join(map(str, ports))}"
                where = ", or name its port with --port" + (known if ports else "")
                raise NoGateway(error.message + where) from error


def flatten_options(command: Callable[..., None]) -> Callable[..., None]:
    """Command with one option per field in the place of each dataclass parameter."""
    hints = get_type_hints(command, include_extras=True)
    own: list[inspect.Parameter] = []
    spread: list[inspect.Parameter] = []  # listed after its own options in the help
    groups: dict[str, type] = {}
    for parameter in inspect.signature(command).parameters.values():
        kind = hints[parameter.name]
        if dataclasses.is_dataclass(kind):
            assert isinstance(kind, type)
            groups[parameter.name] = kind
            spread += inspect.signature(kind, eval_str=True).parameters.values()
        else:
            own.append(parameter.replace(annotation=kind))

    @functools.wraps(command)
    def run(**given: Any) -> None:
        for name, kind in groups.items():
            given[name] = kind(**{f.name: given.pop(f.name) for f in dataclasses.fields(kind)})
        command(**given)

    flattened = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in (*own, *spread)]
    parsed: Any = run  # the parser reads the signature
    parsed.__signature__ = inspect.Signature(flattened)
    run.__annotations__ = {p.name: p.annotation for p in flattened}
    return run


def named_values(texts: Sequence[str]) -> dict[str, str]:
    """Mapping of names to values from texts such as `["alpha_d=0.01"]`. Raises UsageError."""
    from helios_client.usage_errors import UsageError

    out = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name.strip() and equals and value.strip()):
            raise UsageError(f"--set is {text!r}; wanted NAME=VALUE, such as alpha_d=0.01")
        out[name.strip()] = value.strip()
    return out


def console(stderr: bool = False) -> Screen:
    from helios_client.terminal_output import Screen

    return Screen(stderr=stderr)


def print_line(text: str, stderr: bool = False, flush: bool = False) -> None:
    """Print one line, with control characters made printable."""
    from helios_core.printable_text import printable

    print(printable(text), file=sys.stderr if stderr else sys.stdout, flush=flush)


def print_json(value: object) -> None:
    print(json.dumps(value, indent=1).replace("\x7f", "\\u007f"))
