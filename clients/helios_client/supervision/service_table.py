"""State of each service: the supervisor's process table joined with the services' statuses."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.topics import status_topic

from helios_client.supervision.supervisor import ProcessInfo, ProcessState

SILENT_S = 8.0  # services report every second; compiling kernels may delay a report
OPTIONAL_SERVICES = frozenset(  # a full disk stops the recording, not the robot
    {"recorder", "ros2"}
)
WITHOUT_STATUS = "router"  # plain Zenoh router: it publishes no status
NOT_SEEN = "it has not been seen; start it on its machine"


@dataclass(frozen=True)
class ServiceRow:
    """Row of `helios status` for one service."""

    name: str
    state: str  # starting, waiting, ready, degraded, stopping; restarting, stopped
    reason: str
    restarts: int
    pid: int


class ServiceTable:
    """Newest status of each service, received from the bus. Thread-safe."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._statuses: dict[str, tuple[float, pb.ServiceStatus]] = {}

    def subscribe(self, bus: Bus, names: Sequence[str]) -> None:
        """Subscribe to the statuses of the named services."""
        self.subscribe_rows(bus, {name: name for name in names})

    def subscribe_rows(self, bus: Bus, rows: Mapping[str, str]) -> None:
        """Subscribe to the statuses of one robot's services. `rows`: name of the row by service."""
        for service, row in rows.items():
            if service != WITHOUT_STATUS:
                bus.subscribe(status_topic(service), partial(self.on_status, row=row))

    def on_status(self, status: pb.ServiceStatus, row: str = "") -> None:
        """Store the status of a service. `row`: name of its row, if that is another one."""
        with self._lock:
            self._statuses[row or status.service] = (self._clock(), status)

    def status(self, name: str) -> pb.ServiceStatus | None:
        """Newest status of a service; None before the first."""
        with self._lock:
            heard = self._statuses.get(name)
        return heard[1] if heard else None

    def heard_s(self, process: ProcessInfo) -> float | None:
        """Time of the newest report of this process, by the table's clock; None before the
        first."""
        with self._lock:
            heard = self._statuses.get(process.name)
        return heard[0] if heard is not None and heard[1].pid == process.pid else None

    def rows(
        self, table: Sequence[ProcessInfo], elsewhere: Sequence[str] = ()
    ) -> tuple[ServiceRow, ...]:
        """One row per process, in the order of the table; then the services of other machines."""
        with self._lock:
            statuses = dict(self._statuses)
        now_s = self._clock()
        here = tuple(_row(info, statuses.get(info.name), now_s) for info in table)
        return here + tuple(_row_elsewhere(n, statuses.get(n), now_s) for n in elsewhere)


def service_of(row: str) -> str:
    """Service of a row, which may begin with the name of its robot: map2d of robot-2/map2d."""
    return row.rpartition("/")[2]


def is_ready(rows: Sequence[ServiceRow]) -> bool:
    """True if all services that a robot needs are ready."""
    needed = [row for row in rows if service_of(row.name) not in OPTIONAL_SERVICES]
    return bool(needed) and all(row.state == "ready" for row in needed)


def as_json(rows: Sequence[ServiceRow]) -> dict[str, Any]:
    """`{ready, services: [...]}` of `helios status --json`."""
    return {"ready": is_ready(rows), "services": [asdict(row) for row in rows]}


def _row_elsewhere(
    name: str, heard: tuple[float, pb.ServiceStatus] | None, now_s: float
) -> ServiceRow:
    if heard is None:
        return ServiceRow(name, "waiting", NOT_SEEN, 0, 0)
    heard_s, status = heard
    if now_s - heard_s > SILENT_S:
        silent = f"has not reported for {now_s - heard_s:.0f} s; see its machine"
        return ServiceRow(name, "waiting", silent, 0, 0)
    return ServiceRow(name, status.state, status.reason, 0, status.pid)


def _row(
    info: ProcessInfo, heard: tuple[float, pb.ServiceStatus] | None, now_s: float
) -> ServiceRow:
    def row(state: str, reason: str) -> ServiceRow:
        return ServiceRow(info.name, state, reason, info.restarts, info.pid)

    if info.state is not ProcessState.RUNNING:
        return row(info.state.value, info.reason)
    again = f"restarted: {info.reason}" if info.reason else ""
    if info.name == WITHOUT_STATUS:
        return row("ready", again)
    if heard is None or heard[1].pid != info.pid:
        return row("starting", again)
    heard_s, status = heard
    if now_s - heard_s > SILENT_S:
        return row("degraded", f"has not reported for {now_s - heard_s:.0f} s")
    return row(status.state, "; ".join(filter(None, (status.reason, again))))
