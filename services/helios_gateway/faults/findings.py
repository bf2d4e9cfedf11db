"""What counts as a fault: conditions of the services and the robot, and events."""

from __future__ import annotations

import re
from collections.abc import Mapping

from helios_core import proto as pb
from helios_core.printable_text import printable

from helios_gateway.faults.life_cycle import Finding

ROBOT, TASK = "robot", "task"
DOWN_S = 10.0  # a service that the supervisor restarts is back by then
RESTARTED_KEEP_S = 60.0  # a restarted service that runs so long is well again
LATE_S = 60.0  # a task that ended before is old news, as after a restart of the gateway


def condition(service: str, kind: str, reason: str) -> Finding:
    """Condition of a service; kind: degraded, silent or down."""
    confirm_s = {"down": DOWN_S}.get(kind, Finding.confirm_s)
    severity = "warning" if kind == "degraded" else "error"
    return Finding(service, kind, reason, severity, confirm_s)


def stop(reason: str) -> Finding:
    """The robot is stopped until clear-stop."""
    return Finding(ROBOT, "stopped", reason or "the robot is stopped", "warning", confirm_s=0.0)


def restart(process: pb.ProcessStatus) -> Finding:
    """The supervisor has restarted a process."""
    return Finding(
        process.name, "restarted", printable(process.reason) or "it was restarted",
        keep_s=RESTARTED_KEEP_S,
    )  # fmt: skip


def failed_task(task: pb.Task) -> Finding:
    """A task has failed; one fault per cause."""
    kind = re.sub(r"[^a-z0-9]+", "-", task.cause.lower()).strip("-") or "unknown-cause"
    return Finding(TASK, kind, printable(f"task {task.id}: {task.message}"))


def restarts(
    before: Mapping[str, int] | None, status: pb.SupervisorStatus
) -> tuple[list[Finding], dict[str, int]]:
    """(processes restarted since the last status, the counts now).

    before: None at the first status; of the earlier restarts only the gateway's own is new.
    """
    now = {process.name: process.restarts for process in status.processes if process.name}
    known = {**now, "gateway": 0} if before is None else before
    found = [
        restart(process)
        for process in status.processes
        if process.name and process.restarts > known.get(process.name, 0)
    ]
    return found, now
