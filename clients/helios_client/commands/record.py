"""`helios record`: the recorder alone, beside services that already run."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import NoReturn

from helios_core.errors import Unavailable

from helios_client.commands.local_address import local_port_of_url
from helios_client.supervision import state_file

ROUTER_PORT = 7447  # Zenoh's default, which the containers use


def record(
    out: Path, port: int, state: Path | None, router: str | None, name: str | None,
    url: str | None = None,
) -> NoReturn:  # fmt: skip
    """Replace this process by the recorder, which then receives its signals. Arguments and errors
    as `router_of`."""
    router, robot = router_of(port, state, router, name, url, "helios record")
    argv = ["--router", router, "--robot", robot, "--out", str(out)]
    print(f"recording to {out.resolve()}; Ctrl-C ends it", file=sys.stderr, flush=True)
    os.execv(sys.executable, [sys.executable, "-m", "helios_recorder", *argv])


def router_of(
    port: int, state: Path | None, router: str | None, name: str | None, url: str | None,
    command: str,
) -> tuple[str, str]:  # fmt: skip
    """Router and robot's name for a command beside a running stack. url: wins over port, as for all
    commands. Raises Unavailable if no router is named or known, UsageError if the URL names another
    machine, whose router is not known."""
    if url and router is None and state is None:
        port = local_port_of_url(
            url, "its router is not known; name it with --router "
            f"tcp/HOST:{ROUTER_PORT}, or run `{command}` there",
        )  # fmt: skip
    known = state_file.read(state or state_file.default_state_dir(port)) or {}
    router = router or known.get("router")
    if router is None:
        where = f"at {url}" if url and state is None else f"with --port {port}"
        ports = [p for p in state_file.running_ports() if p != port]
        others = " (one runs with --port " + " and one with --port ".join(map(str, ports)) + ")"
        raise Unavailable(
            f"no `helios up` runs {where}{others if ports else ''}; start one, or name a router: "
            "--router tcp/HOST:PORT"
        )
    return router, name or known.get("robot", "robot")
