"""Finds a router that runs, but passes no message on.

Each service reports every second over the router. If none of several services is heard for
`SILENT_S`, the router is at fault, and the supervisor replaces it. A router that has passed nothing
on since its start is left alone: then the fault may lie in the supervisor's own connection.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from helios_client.supervision.service_table import WITHOUT_STATUS, ServiceTable
from helios_client.supervision.supervisor import ProcessInfo, ProcessState

SILENT_S = 10.0
LEAST_PROCESSES = 2  # a single silent one may itself be at fault
PAUSE_S = 2.0  # the supervisor looks far more often, unless the machine itself stood still
REASON = f"no service was heard over it for {SILENT_S:.0f} s"


class RouterWatch:
    """Watch over the router of a process table. One thread calls it, several times a second."""

    def __init__(
        self, service_table: ServiceTable, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._service_table, self._clock = service_table, clock
        self._pid = 0
        self._started_s = self._looked_s = self._resumed_s = clock()

    def is_stuck(self, table: Sequence[ProcessInfo]) -> bool:
        """True if the router of this table has to be replaced."""
        now_s = self._clock()
        if now_s - self._looked_s > PAUSE_S:
            self._resumed_s = now_s
        self._looked_s = now_s
        router = next((p for p in table if p.name == WITHOUT_STATUS), None)
        if router is None or router.state is not ProcessState.RUNNING:
            return False
        if router.pid != self._pid:
            self._pid, self._started_s = router.pid, now_s
        heard_s = {  # by process, since several services may share one
            p.pid: s
            for p in table
            if p.state is ProcessState.RUNNING and (s := self._service_table.heard_s(p)) is not None
        }
        if len(heard_s) < LEAST_PROCESSES or max(heard_s.values()) < self._started_s:
            return False
        return now_s - max(*heard_s.values(), self._resumed_s) > SILENT_S
