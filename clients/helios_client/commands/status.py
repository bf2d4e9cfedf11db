"""`helios status`: processes from the supervisor's file if there is one, all else from the
gateway."""

from __future__ import annotations

from pathlib import Path
from typing import TypedDict

from helios_core.errors import DeadlineExceeded, Unavailable
from rich.markup import escape
from rich.table import Table

from helios_client.answer_types import Status
from helios_client.sdk import Helios
from helios_client.supervision import state_file
from helios_client.terminal_output import plain_table

_COLORS = {"ready": "green", "starting": "cyan", "waiting": "yellow", "restarting": "yellow"}


class RobotReadiness(TypedDict):
    """Readiness of one of several robots."""

    name: str
    ready: bool
    stopped: bool
    stop_reason: str  # reason given with the stop; empty while not stopped


class ShownStatus(Status, total=False):
    """Status of one robot, or of all robots together."""

    robots: list[RobotReadiness]  # only if there are several


def find_status(
    helios: Helios, port: int | None, state_dir: Path | None, robot: str | None = None
) -> ShownStatus:
    """Status `{ready, stopped, stop_reason, services: [{name, state, reason, restarts, pid}]}`, and
    `robots: [{name, ready, stopped, stop_reason}]` of a gateway with several robots.

    The services come from the supervisor's file of `port` if there is one. The gateway says whether
    each robot can do a task now, and whether it is stopped. While the gateway does not answer,
    `ready` means that all processes are, and `stopped` is None. `robot`: name of the requested
    robot, else all; only the gateway knows robots other than the supervisor's. Raises HeliosError
    if the gateway refuses the request, or if there is neither a file nor a gateway.
    """
    found = None
    if port is not None:
        known = state_file.read(state_dir or state_file.default_state_dir(port))
        alone = known and len(known.get("robots", ())) < 2
        found = known if known and (robot is None or (alone and robot == known["robot"])) else None
    try:
        live = _live_status(helios, robot)
    except (Unavailable, DeadlineExceeded):
        if found is None:
            raise
        return {
            "ready": found["ready"],
            "stopped": None,
            "stop_reason": "",
            "services": found["services"],
        }
    if found is not None:
        live["services"] = found["services"]
    return live


def _live_status(helios: Helios, robot: str | None) -> ShownStatus:
    """Status of the named robot, else of all robots of the gateway; rows of several are called
    ROBOT/SERVICE."""
    names = [one["name"] for one in helios.fleet()["robots"]] if robot is None else []
    if len(names) < 2:
        return {**helios.status()}
    each = {name: helios.status(name) for name in names}
    reasons = [f"{name}: {one['stop_reason']}" for name, one in each.items() if one["stop_reason"]]
    return {
        "ready": all(one["ready"] for one in each.values()),
        "stopped": any(one["stopped"] for one in each.values()),
        "stop_reason": "; ".join(reasons),
        "services": [
            {**service, "name": f"{name}/{service['name']}"}
            for name, one in each.items()
            for service in one["services"]
        ],
        "robots": [
            {
                "name": name,
                "ready": one["ready"],
                "stopped": bool(one["stopped"]),
                "stop_reason": one["stop_reason"],
            }
            for name, one in each.items()
        ],
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


def closing_lines(found: ShownStatus) -> list[str]:
    """What the robot can do, with rich's markup; one line per robot if there are several."""
    if "robots" in found:
        return [f"{escape(one['name'])}: {_can_do(one)}" for one in found["robots"]]
    now = "ready" if found["ready"] else "not ready"
    if found["stopped"] is None:
        processes = "all processes are ready" if found["ready"] else now
        unknown = "the gateway does not answer, so it is not known whether the robot is stopped"
        return [f"{processes}; {unknown}"]
    if not found["stopped"]:
        return [now]
    why = f" ({escape(found['stop_reason'])})" if found["stop_reason"] else ""
    stop = f"[red]the robot is stopped[/]{why}: it will not move until you run helios clear-stop"
    return [stop, now]


def _can_do(one: RobotReadiness) -> str:
    if not one["stopped"]:
        return "ready" if one["ready"] else "not ready"
    why = f" ({escape(one['stop_reason'])})" if one["stop_reason"] else ""
    clear = f"helios clear-stop --robot {escape(one['name'])}"
    return f"[red]stopped[/]{why}: it will not move until you run {clear}"
