"""`helios status`: from the supervisor's file if there is one, else from the gateway."""

from __future__ import annotations

from pathlib import Path

from helios_core.errors import HeliosError
from rich.markup import escape
from rich.table import Table

from helios_client.answer_types import Status
from helios_client.sdk import Helios
from helios_client.supervision import state_file
from helios_client.terminal_output import plain_table

_COLORS = {"ready": "green", "starting": "cyan", "waiting": "yellow", "restarting": "yellow"}


def find_status(
    helios: Helios, port: int | None, state_dir: Path | None, robot: str | None = None
) -> Status:
    """Status `{ready, stopped, stop_reason, services: [{name, state, reason, restarts, pid}]}`.

    The services come from the supervisor's file of `port` if there is one. The gateway says whether
    the robot can do a task now, and whether it is stopped. While the gateway is down, `ready` means
    that all processes are, and `stopped` is None. `robot`: name of the requested robot; only the
    gateway knows robots other than the supervisor's. Raises HeliosError if there is neither a file
    nor a gateway.
    """
    found = None
    if port is not None:
        known = state_file.read(state_dir or state_file.default_state_dir(port))
        alone = known and len(known.get("robots", ())) < 2
        found = known if known and (robot is None or (alone and robot == known["robot"])) else None
    try:
        live = helios.status()
    except HeliosError:
        if found is not None:
            services = found["services"]
            return {
                "ready": found["ready"],
                "stopped": None,
                "stop_reason": "",
                "services": services,
            }
        raise
    if found is None:
        return live
    return {
        "ready": live["ready"],
        "stopped": live["stopped"],
        "stop_reason": live.get("stop_reason", ""),
        "services": found["services"],
    }


def status_table(found: Status) -> Table:
    """Table with one row per service."""
    out = plain_table("service", "state", "pid", "restarts", "reason")
    for s in found["services"]:
        color = _COLORS.get(s["state"], "red")
        pid = str(s["pid"]) if s["pid"] else "-"
        out.add_row(
            s["name"], f"[{color}]{s['state']}[/]", pid, str(s["restarts"]), escape(s["reason"])
        )
    return out
