"""Start, end and failure of a service process."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest
from helios_core import proto as pb
from helios_core import service_process
from helios_core.bus import Bus
from helios_core.errors import InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.service_process import Service, run_service, until_warm
from helios_core.settings import ServiceSettings
from helios_core.topics import status_topic

Build = Callable[[Bus, Health], service_process.Closeable]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[[Build], tuple[int, list[tuple[str, str]]]]:
    """Run a service on an in-memory bus, without its signals; return its exit status and each
    (state, reason) that it reported."""

    def run(build: Build) -> tuple[int, list[tuple[str, str]]]:
        hub, reported = MemoryHub(), []

        def heard(status: pb.ServiceStatus) -> None:
            reported.append((status.state, status.reason))

        viewer = MemoryBus(hub)
        viewer.subscribe(status_topic("sample"), heard)
        monkeypatch.setattr(service_process, "_connect", lambda *_: MemoryBus(hub))
        return run_service(Service("sample", ServiceSettings.load([]), build)), reported

    return run


class MinimalService:
    """A service that is ready at once; a signal asks it to end as soon as it has reported that."""

    def __init__(self, bus: Bus, health: Health, signalled: threading.Event) -> None:
        def heard(status: pb.ServiceStatus) -> None:
            if status.state == "ready":
                signalled.set()

        self._health = health
        health.ready("well")
        bus.subscribe(status_topic("sample"), heard)

    def close(self) -> None:
        """Report ready, as when a message is still being processed."""
        self._health.ready("worked on another frame")


@pytest.mark.parametrize("state", ["degraded", "stopping"])
def test_a_final_health_state_is_never_replaced(state: str) -> None:
    health = Health()
    health.failed("no map") if state == "degraded" else health.stopping()
    health.ready("a thread of what was begun goes on")
    health.stopping()
    assert health.state == (state, "no map" if state == "degraded" else "stopping")


def test_a_stopped_service_reports_stopping_last(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[threading.Event] = []
    monkeypatch.setattr(service_process, "stop_on_signals", asked.append)
    status, reported = run(lambda bus, health: MinimalService(bus, health, asked[0]))
    assert status == 0
    assert ("ready", "well") in reported
    assert reported[-1] == ("stopping", "stopping")


@pytest.mark.parametrize(("error", "status"), [(InvalidInput, 2), (Unavailable, 1)])
def test_a_service_that_cannot_start_reports_the_reason_last(
    run: Callable, monkeypatch: pytest.MonkeyPatch, error: type[Exception], status: int
) -> None:
    monkeypatch.setattr(service_process, "stop_on_signals", lambda _: None)

    def build(bus: Bus, health: Health) -> service_process.Closeable:
        raise error("no map at /nowhere; name another one")

    ended, reported = run(build)
    assert ended == status
    assert reported[-1] == ("degraded", "no map at /nowhere; name another one")


def test_a_failed_service_reports_its_end_last_and_closes_its_bus(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service_process, "stop_on_signals", lambda stopped: stopped.set())
    buses: list[Bus] = []
    reported: list[pb.ServiceStatus] = []

    class Stubborn:
        def close(self) -> None:
            raise OSError("the disk is full")

    def build(bus: Bus, health: Health) -> service_process.Closeable:
        buses.append(bus)
        bus.subscribe(status_topic("sample"), reported.append)
        return Stubborn()

    with pytest.raises(OSError, match="disk"):
        run(build)
    assert reported[-1].state == "stopping"
    with pytest.raises(Unavailable, match="closed"):
        buses[0].announce("sample", "1")

    def broken(bus: Bus, health: Health) -> service_process.Closeable:
        bus.subscribe(status_topic("sample"), reported.append)
        raise ZeroDivisionError("oops")

    with pytest.raises(ZeroDivisionError):
        run(broken)
    assert reported[-1].state == "degraded"
    assert "ZeroDivisionError: oops" in reported[-1].reason


def test_a_failed_kernel_compilation_is_reported_and_retried() -> None:
    health, said = Health(), []
    faults: list[Exception | None] = [RuntimeError("no compiler"), MemoryError(), None]

    def compile() -> None:
        said.append(health.state)
        if fault := faults.pop(0):
            raise fault

    assert until_warm(health, compile, threading.Event(), again_s=0.0)
    assert said[1][0] == "degraded"
    assert "RuntimeError: no compiler" in said[1][1]
    assert "MemoryError" in said[2][1]


def test_a_stopping_service_does_not_wait_for_kernels() -> None:
    ending = threading.Event()

    def compile() -> None:
        ending.set()
        raise RuntimeError("no compiler")

    assert not until_warm(Health(), compile, ending, again_s=60.0)
