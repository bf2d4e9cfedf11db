"""Names of certificates: one for each service of a robot, each operator and each program.

`names.toml` in the folder of the certificates lists them:

    hosts = ["10.0.0.2"]
    port = 7447
    days = 365

    [[certificate]]
    name = "map2d.robot"
    service = "map2d"
    robots = ["robot"]
"""

from __future__ import annotations

import ipaddress
import json
import re
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from helios_core.access_control import Identity
from helios_core.bus_access import ACCESS
from helios_core.errors import Conflict, InvalidInput
from pydantic import BaseModel, ConfigDict, Field, ValidationError

ROUTER = "router"
ROBOT_SERVICES = (
    "bridge", "detector", "objectmap", "map2d", "planner", "gateway", "recorder", "ros2",
    "supervisor", "robot",
)  # fmt: skip
SIMULATION = ("world", "evaluation")
SHARED = ("detector", "gateway")  # one process may serve several robots
OPERATOR, PROGRAM = "operator", "program"  # for all robots
LONGEST = 64  # characters of a name in a certificate
MOST_DAYS = 36500  # as for --days
_PART = re.compile(r"[A-Za-z0-9]([A-Za-z0-9_.-]*[A-Za-z0-9_-])?")
_HOST = re.compile(r"(?=.{1,253}$)[A-Za-z0-9_]([A-Za-z0-9_-]*\.)*[A-Za-z0-9_-]*")


@dataclass(frozen=True)
class Names:
    """Content of `names.toml`."""

    hosts: tuple[str, ...]  # names and addresses of the router
    port: int
    days: int  # validity of a certificate
    certificates: tuple[Identity, ...] = ()

    @property
    def robots(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(r for c in self.certificates for r in c.robots))

    @property
    def identities(self) -> tuple[Identity, ...]:
        """All certificates; an operator's or a program's are for all robots."""
        robots = self.robots
        return tuple(replace(c, robots=c.robots or robots) for c in self.certificates)

    @property
    def endpoints(self) -> tuple[str, ...]:
        """Endpoints of the router for a client."""
        return tuple(endpoint(host, self.port) for host in self.hosts)

    def with_robots(self, robots: Sequence[str], shared: Sequence[str], simulated: bool) -> Names:
        """Add certificates for robots.

        shared: services of which one process serves these robots, and those it served before.
        Raises InvalidInput for a wrong name, Conflict for a robot that is there.
        """
        if known := sorted(set(robots) & set(self.robots)):
            raise Conflict(f"{', '.join(known)} has certificates already; helios certs renew")
        if wrong := sorted(set(shared) - set(SHARED)):
            raise InvalidInput(
                f"one process of {', '.join(wrong)} cannot serve several robots; only "
                f"{' and '.join(SHARED)} can"
            )
        services = (*ROBOT_SERVICES, *(SIMULATION if simulated else ()))
        out = list(self.certificates)
        for service in services:
            if service not in shared:
                out += [_identity(service, robot, (robot,)) for robot in robots]
                continue
            before = next((c for c in out if c.service == service), None)
            if before is None:
                out.append(_identity(service, robots[0], tuple(robots)))
            else:
                out[out.index(before)] = replace(before, robots=(*before.robots, *robots))
        return replace(self, certificates=tuple(out))

    def with_simulation(self) -> Names:
        """Add the simulated world and the evaluation for every robot that has none."""
        there = {c.name for c in self.certificates}
        new = [_identity(s, robot, (robot,)) for s in SIMULATION for robot in self.robots]
        added = tuple(c for c in new if c.name not in there)
        return replace(self, certificates=(*self.certificates, *added))

    def with_people(self, operators: Iterable[str], programs: Iterable[str] = ()) -> Names:
        """Add operators and programs of all robots.

        Raises InvalidInput for a wrong name, Conflict for a known one.
        """
        new = tuple(_identity(OPERATOR, name, ()) for name in operators)
        new += tuple(_identity(PROGRAM, name, ()) for name in programs)
        there = {c.name for c in self.certificates}
        if known := [c.name for c in new if c.name in there]:
            raise Conflict(f"{', '.join(known)} is there already; helios certs renew replaces it")
        return replace(self, certificates=(*self.certificates, *new))


def endpoint(host: str, port: int) -> str:
    """Encrypted endpoint of Zenoh."""
    return f"tls/{f'[{host}]' if ':' in host else host}:{port}"


def checked_hosts(hosts: Iterable[str]) -> tuple[str, ...]:
    """Names and addresses of the router, each once. Raises InvalidInput for other text."""
    out = tuple(dict.fromkeys(hosts))
    for host in out:
        try:
            ipaddress.ip_address(host)
        except ValueError:
            if not _HOST.fullmatch(host) or ".." in host or host.replace(".", "").isdigit():
                raise InvalidInput(
                    f"no machine can be called {host[:80]!r}: wanted a host name or an address, "
                    "such as server.local or 10.0.0.2"
                ) from None
    if not out:
        raise InvalidInput("no host came; name the machine of the router, such as 10.0.0.2")
    return out


def from_toml(text: str) -> Names:
    """Parse `names.toml`. Raises InvalidInput for other text."""
    try:
        file = _File.model_validate(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InvalidInput(f"names.toml is no TOML: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InvalidInput(f"names.toml is wrong: {where}: {first['msg']}") from error
    entries = tuple(Identity(c.name, c.service, tuple(c.robots)) for c in file.certificate)
    for entry in entries:
        if not _PART.fullmatch(entry.name) or len(entry.name) > LONGEST:  # it names a file
            raise InvalidInput(
                f"names.toml has a certificate {entry.name[:100]!r}; wanted letters, digits, - _ "
                f"and dots, at most {LONGEST} characters; correct the name, or remove the entry"
            )
        if entry.service not in ACCESS:
            raise InvalidInput(
                f"names.toml has a service {entry.service!r}; known are {', '.join(ACCESS)}"
            )
    return Names(checked_hosts(file.hosts), file.port, file.days, entries)


def to_toml(names: Names) -> str:
    """Text of `names.toml`."""
    out = [
        "# Written by helios certs.",
        f"hosts = {_quoted(names.hosts)}",
        f"port = {names.port}",
        f"days = {names.days}",
    ]
    for entry in names.certificates:
        out += [
            "",
            "[[certificate]]",
            f"name = {_quoted(entry.name)}",
            f"service = {_quoted(entry.service)}",
            f"robots = {_quoted(entry.robots)}",
        ]
    return "\n".join(out) + "\n"


class _Certificate(BaseModel):
    model_config = ConfigDict(extra="forbid")

    name: str
    service: str
    robots: list[str]


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    hosts: list[str]
    port: int = Field(ge=1, le=65535)
    days: int = Field(ge=1, le=MOST_DAYS)
    certificate: list[_Certificate] = []


def _identity(service: str, whose: str, robots: tuple[str, ...]) -> Identity:
    name = f"{service}.{whose}"
    if not _PART.fullmatch(whose) or len(name) > LONGEST:
        raise InvalidInput(
            f"no certificate can be called {name[:100]!r}: wanted letters, digits, - _ and dots, "
            f"together at most {LONGEST} characters"
        )
    return Identity(name, service, robots)


def _quoted(value: Any) -> str:
    return json.dumps(list(value) if isinstance(value, tuple) else value)
