"""Supervisor of a table of processes: it restarts each one that ends.

The first restart is immediate; further ones wait longer, up to five seconds. After a steady run of
`STEADY_S` the delays start anew. Wrong use (exit status 2) is reported and not retried, unless the
process has run steadily before: then a file has been damaged under way, and the process is retried
every five seconds until that is repaired. One thread calls `start`, `check` and `stop`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from helios_client.supervision.child_process import ChildProcess, ProcessExit, ProcessSpec
from helios_client.supervision.forked_process import ForkServer

RESTART_DELAYS_S = (0.0, 0.5, 1.0, 2.0, 4.0, 5.0)
STEADY_S = 20.0  # after this run time, the next restart is immediate again
TERMINATE_WITHIN_S = 2.3  # services promise to end within two seconds
LAST_WITHIN_S = 0.5


class ProcessState(StrEnum):
    """State of a process, with the values of `ProcessStatus.state`."""

    RUNNING = "running"
    RESTARTING = "restarting"  # waits for its next start
    STOPPED = "stopped"


@dataclass(frozen=True)
class ProcessInfo:
    """Row of the process table, one per service."""

    name: str
    pid: int  # 0 while it does not run
    restarts: int
    state: ProcessState
    reason: str  # why it was restarted, waits or is stopped; empty at first
    process: str = ""  # name of its process; empty: its own name


def restart_delay_s(failures: int) -> float:
    """Delay of the restart after this number of failures in a row, 1 or more."""
    return RESTART_DELAYS_S[min(failures, len(RESTART_DELAYS_S)) - 1]


@dataclass
class _Row:
    spec: ProcessSpec
    log_path: Path
    child: ChildProcess | None = None
    started_s: float = 0.0
    restarts: int = 0
    failures: int = 0  # in a row
    proven: bool = False  # has run steadily, so its command line can be valid
    due_s: float | None = None  # time of the next start
    reason: str = ""
    state: ProcessState = field(default=ProcessState.STOPPED)


class Supervisor:
    """Processes that are started, watched and restarted; see the module. Logs go to
    `log_dir/<name>.log`."""

    def __init__(
        self,
        specs: Sequence[ProcessSpec],
        log_dir: Path,
        restart: bool = True,
        clock: Callable[[], float] = time.monotonic,
        fork_server: ForkServer | None = None,
    ) -> None:
        """fork_server: forks the services; None: each starts with an interpreter of its own."""
        self._rows = [_Row(spec, log_dir / f"{spec.name}.log") for spec in specs]
        self._restart = restart
        self._clock = clock
        self._fork_server = fork_server

    def start(self) -> None:
        """Start all processes. Raises OSError, with none left running, if a program does not
        exist."""
        try:
            for row in self._rows:
                self._start(row)
        except BaseException:
            self.stop()
            raise

    def check(self) -> tuple[tuple[str, ProcessExit], ...]:
        """Restart the processes that are due. Returns name and ending of those that ended since the
        last check."""
        ended: list[tuple[str, ProcessExit]] = []
        now_s = self._clock()
        for row in self._rows:
            ending = row.child.poll_exit() if row.child else None
            if ending:
                self._note_ending(row, ending, now_s)
                ended.append((row.spec.name, ending))
            if row.due_s is not None and now_s >= row.due_s:
                row.restarts += 1
                try:
                    self._start(row)
                except OSError as error:
                    self._note_ending(
                        row, ProcessExit(None, f"could not be started: {error}"), now_s
                    )
        return tuple(ended)

    def replace(self, name: str, why: str) -> tuple[tuple[str, ProcessExit], ...]:
        """Kill a process that runs but does not work; the next check starts it again.

        why: reason for the table. Returns name and ending, as `check`; nothing if it does not run.
        """
        row = next(r for r in self._rows if r.spec.name == name)
        if row.child is None:
            return ()
        row.child.kill()
        ending = ProcessExit(None, why)
        self._note_ending(row, ending, self._clock())
        return ((name, ending),)

    def table(self) -> tuple[ProcessInfo, ...]:
        """All services, in the order of `specs`."""
        return tuple(
            ProcessInfo(
                name, r.child.pid if r.child else 0, r.restarts, r.state, r.reason, r.spec.name
            )
            for r in self._rows
            for name in r.spec.services
        )

    def stop(self) -> None:
        """End all processes within about three seconds: SIGTERM first, then SIGKILL."""
        for last, within_s in ((False, TERMINATE_WITHIN_S), (True, LAST_WITHIN_S)):
            self._end([r for r in self._rows if r.spec.ends_last is last], within_s)

    def _start(self, row: _Row) -> None:
        row.started_s = self._clock()
        row.child = ChildProcess(row.spec, row.log_path, self._fork_server)
        row.due_s, row.state = None, ProcessState.RUNNING

    def _note_ending(self, row: _Row, ending: ProcessExit, now_s: float) -> None:
        steady = now_s - row.started_s >= STEADY_S
        row.proven |= steady
        row.failures = 1 if steady else row.failures + 1
        row.child, row.reason = None, ending.reason
        if not self._restart or (ending.usage_error and not row.proven):
            row.state = ProcessState.STOPPED
            return
        delay_s = RESTART_DELAYS_S[-1] if ending.usage_error else restart_delay_s(row.failures)
        row.state, row.due_s = ProcessState.RESTARTING, now_s + delay_s

    def _end(self, rows: list[_Row], within_s: float) -> None:
        running = [(row, row.child) for row in rows if row.child]
        for _, child in running:
            child.terminate()
        deadline_s = time.monotonic() + within_s
        for row, child in running:
            if not child.wait(deadline_s - time.monotonic()):
                child.kill()
            row.child = None
        for row in rows:
            row.due_s, row.state, row.reason = None, ProcessState.STOPPED, "stopped"
