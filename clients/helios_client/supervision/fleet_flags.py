"""Checks of the flags of `helios up` for several robots and several machines."""

from __future__ import annotations

import re
from pathlib import Path

from helios_core.errors import InvalidInput
from helios_core.name_rules import robot_names, same_name
from helios_core.router_link import DEFAULT_ROUTER

from helios_client.supervision.service_specs import REMOTE
from helios_client.usage_errors import UsageError

SERVICES = (
    "router", "world", "bridge", "detector", "objectmap", "map2d", "planner", "gateway",
    "recorder", "ros2",
)  # fmt: skip
WITH_THE_ROUTER = ("router", "gateway")  # left out by --router, unless --services names them
MOST_ROBOTS = 100
DEFAULT_PORT = DEFAULT_ROUTER.rpartition(":")[2]
_PLACE = re.compile(r"(?P<host>\[[^\s\[\]]+\]|[^\s:\[\]]+)(:(?P<port>[0-9]{1,5}))?")


def chosen_services(text: str | None, router: str | None) -> frozenset[str] | None:
    """Services of this machine; None: all. Raises UsageError."""
    if text is None:
        return None if router is None else frozenset(SERVICES) - set(WITH_THE_ROUTER)
    chosen = set()
    for word in filter(None, (part.strip() for part in text.split(","))):
        name = same_name(word, SERVICES)
        if name is None:
            raise UsageError(
                f"--services: no service is called {word!r}; wanted some of {', '.join(SERVICES)}"
            )
        chosen.add(name)
    if not chosen:
        raise UsageError(f"--services is empty; wanted some of {', '.join(SERVICES)}")
    if router is not None and "router" in chosen:
        raise UsageError(
            "--router names a router elsewhere, and --services one here; leave one of them out"
        )
    if router is None and "router" not in chosen:
        raise UsageError(
            "--services has no router, so name the one to use with --router HOST, or add router"
        )
    return frozenset(chosen)


def router_endpoint(text: str, certs: Path | None) -> str:
    """Endpoint of a router elsewhere, from HOST, HOST:PORT or tcp/HOST:PORT. Raises UsageError."""
    kind, _, place = text.rpartition("/")
    kind = kind or ("tcp" if certs is None else "tls")
    found = _PLACE.fullmatch(place)
    port = int((found and found["port"]) or DEFAULT_PORT)
    if kind not in ("tcp", "tls") or found is None or not 0 < port < 65536:
        raise UsageError(
            f"--router is {text!r}; wanted HOST or HOST:PORT, such as 10.0.0.2:{DEFAULT_PORT}, "
            "with brackets around an IPv6 address, such as [::1]"
        )
    return f"{kind}/{found['host']}:{port}"


def fleet_names(text: str | None, robot: str, name: str) -> tuple[str, ...]:
    """Names of several robots, from their number or a list of names; empty for one robot. Raises
    UsageError."""
    if text is None:
        return ()
    if robot not in ("sim", REMOTE):
        raise UsageError(
            f"--robots is for --robot sim and {REMOTE}; start each {robot} robot on its own "
            "machine with --router HOST --name NAME"
        )
    if name != "robot":
        raise UsageError(f"--name {name} names one robot; leave it out, or name all with --robots")
    if text.strip().isdecimal():
        count = int(text)
        if not 1 <= count <= MOST_ROBOTS:
            raise UsageError(f"--robots is {count}; wanted 1 to {MOST_ROBOTS}")
        return tuple(f"robot-{k + 1}" for k in range(count))
    try:
        names = robot_names(text)
    except InvalidInput as error:
        raise UsageError(f"--robots: {error.message}") from error
    if not names:
        raise UsageError("--robots is empty; wanted a number, or names separated by commas")
    return names
