"""What counts as a fault: conditions of the services and the robot, and events."""

from __future__ import annotations

from collections.abc import Mapping

from helios_core import proto as pb
from helios_core.printable_text import printable

from helios_gateway.faults.life_cycle import Finding, plain_id

ROBOT, TASK = "robot", "task"
DOWN_S = 10.0  # the supervisor restarts a service in less time
RESTARTED_KEEP_S = 60.0  # time after a restart at which its fault is cleared
LATE_S = 60.0  # the end of a task is ignored if it is older, as after a restart of the gateway


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
        process.name,
        "restarted",
        printable(process.reason) or "it was restarted",
        keep_s=RESTARTED_KEEP_S,
    )


def failed_task(task: pb.Task) -> Finding:
    """A task has failed; one fault per cause."""
    kind = plain_id(task.cause) or "unknown-cause"
    return Finding(TASK, kind, printable(f"task {task.id}: {task.message}"))


def restarts(
    known: Mapping[str, int], status: pb.SupervisorStatus
) -> tuple[list[Finding], dict[str, int]]:
    """New restarts in a status, and the counts of all processes after it.

    known: counts of all processes before. Several supervisors may each report some processes of a
    robot, so a process that the status does not name keeps its count. A process that is named for
    the first time has no new restart, except the gateway: it could not see its own.
    """
    told = {process.name: process.restarts for process in status.processes if process.name}
    before = {**told, "gateway": 0, **known}
    found = [
        restart(process)
        for process in status.processes
        if process.name and process.restarts > before[process.name]
    ]
    return found, {**known, **told}
