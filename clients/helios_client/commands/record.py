"""`helios record`: the recorder alone, beside services that already run."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from helios_core.errors import Unavailable
from helios_core.router_link import RouterLink, router_link

from helios_client.commands.local_address import local_port_of_url
from helios_client.commands.shared_options import chosen_address
from helios_client.http.address import PORT
from helios_client.supervision import state_file
from helios_client.usage_errors import check_folder

ROUTER_PORT = 7447  # Zenoh's default, which the containers use


@dataclass(frozen=True)
class BusAddress:
    """Where a command finds the bus of a running stack, and the name of its robot."""

    router: str | None  # endpoint; None: those of the certificates
    certs: Path | None  # folder of certificates, or one session file
    robot: str

    def link(self) -> RouterLink:
        """Link of a reader of everything: with certificates it is the recorder's. Raises
        InvalidInput."""
        return router_link(self.router or "", self.certs, "recorder", self.robot)


def record(out: Path, bus: BusAddress) -> NoReturn:
    """Replace this process by the recorder, which then receives its signals. Raises UsageError if
    `out` cannot be written."""
    check_folder(out)
    argv = ["--robot", bus.robot, "--out", str(out)]
    argv += ["--router", bus.router] if bus.router else []
    argv += ["--certs", str(bus.certs)] if bus.certs else []
    print(f"recording to {out.resolve()}; Ctrl-C ends it", file=sys.stderr, flush=True)
    os.execv(sys.executable, [sys.executable, "-m", "helios_recorder", *argv])


def bus_address(
    command: str,
    port: int | None,
    state: Path | None,
    router: str | None,
    certs: Path | None,
    name: str | None,
    url: str | None,
) -> BusAddress:
    """Bus of the running stack that a command's options select.

    port, url: as typed, both unused with `router` or `state`; `http.address.chosen` chooses. Raises
    Unavailable if no router is named or known, UsageError if port and url differ, or if the URL
    names another machine, whose router is not known.
    """
    address = None
    if router is None and state is None:
        port, address = chosen_address(port, url)
    url = None if port else address
    port = port or PORT
    if url and router is None and state is None:
        port = local_port_of_url(
            url,
            "its router is not known; name it with --router "
            f"tcp/HOST:{ROUTER_PORT}, or run `{command}` there",
        )
    known = state_file.read(state or state_file.default_state_dir(port)) or {}
    if router is None and certs is None and known.get("certs"):
        certs = Path(known["certs"])
    router = router or known.get("router")
    if router is None and certs is None:
        where = f"at {url}" if url and state is None else f"with --port {port}"
        ports = [p for p in state_file.running_ports() if p != port]
        others = " (one runs with --port " + " and one with --port ".join(map(str, ports)) + ")"
        raise Unavailable(
            f"no `helios up` runs {where}{others if ports else ''}; start one, or name a router: "
            "--router tcp/HOST:PORT"
        )
    return BusAddress(router, certs, name or known.get("robot", "robot"))
