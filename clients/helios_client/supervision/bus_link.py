"""Bus connection of the supervisor: receives service statuses, publishes the process table."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import HeliosError, Unavailable
from helios_core.router_link import RouterLink
from helios_core.topics import SUPERVISOR

from helios_client.supervision.service_table import ServiceTable
from helios_client.supervision.supervisor import ProcessInfo

log = logging.getLogger(__name__)

PUBLISH_PERIOD_S = 1.0
RETRY_S = 0.2


class BusLink:
    """Bus connection of one robot, in a thread of its own. It connects as soon as there is a
    router, and publishes the process table every `PUBLISH_PERIOD_S`."""

    def __init__(
        self, router: RouterLink, robot: str, service_table: ServiceTable, rows: Mapping[str, str]
    ) -> None:
        """rows: name of the row by service, for the services of this robot."""
        self._router, self._robot = router, robot
        self._service_table, self._rows = service_table, rows
        self._services = {row: service for service, row in rows.items()}
        self._ending, self._wake = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._message = pb.SupervisorStatus()
        self._thread = threading.Thread(target=self._run, name="supervisor link", daemon=True)
        self._thread.start()

    def publish(self, table: Sequence[ProcessInfo]) -> None:
        """Publish this table from now on, and at once if it has changed."""
        own = [replace(p, name=self._services[p.name]) for p in table if p.name in self._services]
        message = supervisor_status(own)
        with self._lock:
            changed, self._message = message != self._message, message
        if changed:
            self._wake.set()

    def request_close(self) -> None:
        """Start to leave the bus, without waiting."""
        self._ending.set()
        self._wake.set()

    def close(self) -> None:
        """Leave the bus, and wait for up to 1 s until that is done."""
        self.request_close()
        self._thread.join(1.0)

    def _run(self) -> None:
        bus = self._connect()
        if bus is None:
            return
        try:
            self._service_table.subscribe_rows(bus, self._rows)
            while not self._ending.is_set():
                self._wake.clear()
                with self._lock:
                    message = self._message
                try:
                    bus.publish(SUPERVISOR, message)
                except HeliosError as error:
                    log.warning("the process table could not be published: %s", error.message)
                self._wake.wait(PUBLISH_PERIOD_S)
        finally:
            bus.close()

    def _connect(self) -> Bus | None:
        from helios_core.zenoh_bus import ZenohBus

        while not self._ending.is_set():
            try:
                return ZenohBus(self._router, self._robot)
            except Unavailable:  # the router is starting
                self._ending.wait(RETRY_S)
        return None


def supervisor_status(table: Sequence[ProcessInfo]) -> pb.SupervisorStatus:
    """Process table as a protobuf message."""
    return pb.SupervisorStatus(
        processes=[
            pb.ProcessStatus(
                name=p.name, pid=p.pid, restarts=p.restarts, state=p.state.value, reason=p.reason
            )
            for p in table
        ]
    )
