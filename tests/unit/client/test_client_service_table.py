"""State of a service, from the reports of the supervisor and of the service itself."""

from __future__ import annotations

from helios_client.supervision.bus_link import supervisor_status
from helios_client.supervision.service_table import (
    SILENT_S,
    ServiceRow,
    ServiceTable,
    as_json,
    is_ready,
)
from helios_client.supervision.supervisor import ProcessInfo, ProcessState
from helios_core import proto as pb


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def running(name: str = "map2d", pid: int = 7, restarts: int = 0, reason: str = "") -> ProcessInfo:
    return ProcessInfo(name, pid, restarts, ProcessState.RUNNING, reason)


def row(service_table: ServiceTable, info: ProcessInfo) -> ServiceRow:
    return service_table.rows([info])[0]


def test_a_process_without_a_report_is_starting() -> None:
    assert row(ServiceTable(), running()).state == "starting"


def test_a_service_has_the_state_that_it_reports() -> None:
    service_table = ServiceTable()
    service_table.on_status(
        pb.ServiceStatus(service="map2d", pid=7, state="waiting", reason="for a frame")
    )
    assert row(service_table, running()) == ServiceRow("map2d", "waiting", "for a frame", 0, 7)


def test_the_report_of_an_earlier_process_is_ignored() -> None:
    service_table = ServiceTable()
    service_table.on_status(pb.ServiceStatus(service="map2d", pid=6, state="ready"))
    assert row(service_table, running()).state == "starting"


def test_a_restart_is_reported_with_its_reason() -> None:
    service_table = ServiceTable()
    service_table.on_status(pb.ServiceStatus(service="map2d", pid=7, state="ready"))
    reported = row(service_table, running(restarts=1, reason="ended by SIGKILL"))
    assert (reported.state, reported.restarts) == ("ready", 1)
    assert "ended by SIGKILL" in reported.reason


def test_a_silent_service_is_degraded() -> None:
    clock = Clock()
    service_table = ServiceTable(clock)
    service_table.on_status(pb.ServiceStatus(service="map2d", pid=7, state="ready"))
    clock.now_s = SILENT_S + 1
    assert row(service_table, running()).state == "degraded"


def test_a_down_process_is_restarting_whatever_its_last_report() -> None:
    service_table = ServiceTable()
    service_table.on_status(pb.ServiceStatus(service="map2d", pid=7, state="ready"))
    down = row(service_table, ProcessInfo("map2d", 0, 3, ProcessState.RESTARTING, "no model"))
    assert (down.state, down.reason, down.pid) == ("restarting", "no model", 0)


def test_a_running_router_is_ready() -> None:
    assert row(ServiceTable(), running("router")).state == "ready"


def test_the_stack_is_ready_when_every_service_is_ready() -> None:
    ready, starting = ServiceRow("a", "ready", "", 0, 1), ServiceRow("b", "starting", "", 0, 2)
    assert is_ready([ready])
    assert not is_ready([ready, starting])
    assert not is_ready([])
    assert as_json([ready])["services"] == [
        {"name": "a", "state": "ready", "reason": "", "restarts": 0, "pid": 1}
    ]


def test_the_supervisor_message_contains_the_whole_process_table() -> None:
    message = supervisor_status([running(restarts=2, reason="why")])
    (process,) = pb.SupervisorStatus.FromString(message.SerializeToString()).processes
    assert (process.name, process.pid, process.restarts) == ("map2d", 7, 2)
    assert (process.state, process.reason) == ("running", "why")
