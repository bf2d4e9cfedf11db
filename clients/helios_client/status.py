"""`helios status`: from the supervisor's file where there is one, else from the gateway."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from helios_core.errors import Unavailable
from rich.markup import escape
from rich.table import Table

from helios_client import state_file

_COLORS = {"ready": "green", "starting": "cyan", "waiting": "yellow", "restarting": "yellow"}


def find_status(port: int, state_dir: Path | None) -> dict[str, Any]:
    """`{ready, services: [{name, state, reason, restarts, pid}]}`.

    The file knows all while the gateway is down; the gateway is asked where services were started
    in some other way. Raises Unavailable when neither is there.
    """
    found = state_file.read(state_dir or state_file.default_state_dir(port))
    if found is None:
        from helios_client.sdk import Helios

        with Helios(f"http://127.0.0.1:{port}", timeout_s=3.0) as helios:
            try:
                found = helios.status()
            except Unavailable as error:
                raise Unavailable(
                    f"no HELIOS runs with port {port} on this machine; start it with `helios up`"
                ) from error
    return {"ready": found["ready"], "services": found["services"]}


def status_table(found: dict[str, Any]) -> Table:
    """One row a service."""
    out = Table("service", "state", "pid", "restarts", "reason")
    for s in found["services"]:
        color = _COLORS.get(s["state"], "red")
        pid = str(s["pid"]) if s["pid"] else "-"
        out.add_row(
            s["name"], f"[{color}]{s['state']}[/]", pid, str(s["restarts"]), escape(s["reason"])
        )
    return out
