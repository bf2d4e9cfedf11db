"""`helios certs`: certificates of the bus, one for each service, robot and operator."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from helios_client.commands.shared_options import Json, console, print_json, print_line

if TYPE_CHECKING:
    from helios_client.certs.folder import Validity

app = typer.Typer(
    name="certs",
    help="Certificates of the bus: encrypt it, and let each service do only its own work.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="folder of the certificates")]
Robots = Annotated[str, typer.Option(help="names of robots, separated by commas")]
Operators = Annotated[str, typer.Option(help="names of operators, separated by commas")]
Programs = Annotated[
    str, typer.Option(help="names of programs of your own that may drive, separated by commas")
]
Shared = Annotated[
    str,
    typer.Option(help="services of which one process serves several robots: detector,gateway"),
]
Simulation = Annotated[
    bool, typer.Option("--simulation", help="also for the simulated world and the evaluation")
]
Days = Annotated[int | None, typer.Option(help="validity of each certificate", min=1, max=36500)]


@app.command()
def init(
    folder: Folder,
    hosts: Annotated[
        str, typer.Option(help="names and addresses of the router's machine, separated by commas")
    ] = "127.0.0.1",
    robots: Robots = "robot",
    operators: Operators = "",
    programs: Programs = "",
    shared: Shared = "",
    simulation: Simulation = False,
    port: Annotated[int, typer.Option(help="port of the router", min=1, max=65535)] = 7447,
    days: Days = None,
    ca_days: Annotated[
        int | None, typer.Option(help="validity of the authority", min=1, max=36500)
    ] = None,
) -> None:
    """Create an authority, all certificates, and Zenoh's files for the router and each client."""
    check_library()
    from helios_core.name_rules import robot_names

    from helios_client.certs.authority import CA_DAYS, LEAF_DAYS
    from helios_client.certs.folder import create
    from helios_client.certs.names import Names, checked_hosts
    from helios_client.usage_errors import UsageError

    with _usage():
        named = robot_names(robots)
        if not named:
            raise UsageError("--robots names no robot; wanted names such as spot-1,spot-2")
        names = (
            Names(checked_hosts(_listed(hosts)), port, days or LEAF_DAYS)
            .with_robots(named, _listed(shared), simulation)
            .with_people(_listed(operators), _listed(programs))
        )
    create(folder, names, ca_days or CA_DAYS, _now())
    print(f"{len(names.certificates) + 1} certificates are in {folder}")
    print(f"keep {folder / 'ca.key'} secret; whoever has it can create certificates")
    print(f"start: helios up --certs {folder}")


@app.command()
def add(
    folder: Folder,
    robots: Robots = "",
    operators: Operators = "",
    programs: Programs = "",
    shared: Shared = "",
    simulation: Simulation = False,
) -> None:
    """Add certificates of robots, operators, programs or the simulation. Restart the router
    afterwards."""
    check_library()
    from helios_core.name_rules import robot_names

    from helios_client.certs import folder as files
    from helios_client.certs.names import Names
    from helios_client.usage_errors import UsageError

    with _usage():
        named = robot_names(robots)
    if not (named or _listed(operators) or _listed(programs) or simulation):
        raise UsageError(
            "nothing to add; name --robots, --operators or --programs, or use --simulation"
        )
    if _listed(shared) and not named:
        raise UsageError(f"--shared {shared} is for the robots of --robots; name them")

    def extend(names: Names) -> Names:
        with _usage():
            if named:
                names = names.with_robots(named, _listed(shared), simulation)
            elif simulation:
                names = names.with_simulation()
            return names.with_people(_listed(operators), _listed(programs))

    _say_changed(folder, files.add(folder, extend, _now()))


@app.command()
def renew(
    folder: Folder,
    names: Annotated[
        list[str] | None, typer.Argument(help="certificates, such as map2d.robot  [default: all]")
    ] = None,
    hosts: Annotated[
        str | None,
        typer.Option(help="new names and addresses of the router's machine; renews all"),
    ] = None,
    days: Days = None,
) -> None:
    """Replace certificates and keys; their names stay. Restart the router and the services
    afterwards."""
    check_library()
    from helios_client.certs import folder as files
    from helios_client.certs.names import Names, checked_hosts
    from helios_client.usage_errors import UsageError

    if hosts is not None and names:
        raise UsageError("--hosts renews all certificates; leave the names out")
    with _usage():
        machines = () if hosts is None else checked_hosts(_listed(hosts))

    def change(before: Names) -> Names:
        return replace(before, days=days or before.days, hosts=machines or before.hosts)

    _say_changed(folder, files.renew(folder, names or (), _now(), change))


@app.command()
def remove(
    folder: Folder,
    names: Annotated[list[str], typer.Argument(help="certificates, such as operator.ann")],
) -> None:
    """Remove certificates and their rights. Restart the router afterwards."""
    check_library()
    from helios_client.certs import folder as files

    files.remove(folder, names, _now())
    for name in names:
        print(f"removed: {name}")
    print("restart the router; until then the certificates keep their rights")


@app.command()
def show(folder: Folder, as_json: Json = False) -> None:
    """Show all certificates with their expiry. Warns 30 days before."""
    check_library()
    from helios_client.certs.folder import stale_rules, validities
    from helios_client.terminal_output import plain_table

    found, now = validities(folder), _now()
    if as_json:
        print_json(
            {
                "certificates": [
                    {
                        "name": v.name,
                        "file": str(v.file),
                        "until": v.until.isoformat(),
                        "days_left": round(v.days_left(now), 1),
                    }
                    for v in found
                ]
            }
        )
    else:
        table = plain_table("name", "valid until", "days left", "file")
        for v in found:
            until, left = f"{v.until:%Y-%m-%d}", f"{v.days_left(now):.0f}"
            table.add_row(v.name, until, left, str(v.file.relative_to(folder)))
        console().print(table)
    for sentence in warnings(folder, found, now):
        print_line(f"helios: {sentence}", stderr=True)
    if stale_rules(folder):
        print_line(f"helios: {stale_sentence(folder)}", stderr=True)


def warnings(folder: Path, found: list[Validity], now: dt.datetime) -> list[str]:
    """Sentences about certificates that have expired or are about to."""
    from helios_client.certs.folder import AUTHORITY, WARN_DAYS

    out = []
    for v in found:
        left = v.days_left(now)
        if left >= WARN_DAYS:
            continue
        said = "has expired" if left <= 0 else f"expires in {left:.0f} days"
        remedy = f"renew it: helios certs renew {folder} {v.name}"
        if v.file.name == AUTHORITY:
            remedy = "start again in a new folder: helios certs init"
        out.append(f"the certificate {v.name} {said}; {remedy}")
    return out


def stale_sentence(folder: Path) -> str:
    """Remedy for access rules of another version of HELIOS."""
    return (
        f"the access rules in {folder} are not those of this version of HELIOS; write them anew: "
        f"helios certs renew {folder} router"
    )


def _say_changed(folder: Path, names: tuple[str, ...]) -> None:
    for name in names:
        print(f"new: {name}")
    print(f"restart the router; copy new files from {folder / 'sessions'} to their machines")


def check_library() -> None:
    """Raise Unavailable without the library of the certificates."""
    try:
        import cryptography  # noqa: F401
    except ImportError as error:
        from helios_core.errors import Unavailable

        raise Unavailable(
            f"certificates need the library cryptography ({error}); pip install "
            "'helios-ovmm[certs]'"
        ) from error


@contextmanager
def _usage() -> Iterator[None]:
    """Turn InvalidInput of a typed word into UsageError."""
    from helios_core.errors import InvalidInput

    from helios_client.usage_errors import UsageError

    try:
        yield
    except InvalidInput as error:
        raise UsageError(error.message) from error


def _listed(text: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))


def _now() -> dt.datetime:
    return dt.datetime.now(dt.UTC)
