"""Faults over HTTP and as metrics, what raises them, and the spans of requests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from fastapi.testclient import TestClient
from helios_core import proto as pb
from helios_core import tracing
from helios_core.errors import DeadlineExceeded
from helios_core.span_recording import SpanRecording
from helios_core.topics import spans_method
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.faults.life_cycle import Finding
from helios_gateway.service_registry import ServiceRegistry

from tests.gateway_backend import Backend
from tests.unit.gateway.gateway_clock import Clock

TASK = {"instruction": "move the mug to the kitchen counter"}


@pytest.fixture
def roster(clock: Clock) -> ServiceRegistry:
    """A registry that knows a ready map2d and planner."""
    roster = ServiceRegistry(silent_after_s=5, clock=clock)
    for name in ("map2d", "planner"):
        roster.on_alive(name, "1", True)
        report(roster, name)
    return roster


def report(roster: ServiceRegistry, name: str, state: str = "ready", reason: str = "") -> None:
    roster.on_status(pb.ServiceStatus(service=name, instance="1", state=state, reason=reason))


def test_a_ready_or_waiting_service_has_no_fault(roster: ServiceRegistry) -> None:
    report(roster, "map2d", "waiting", "waits for a frame")
    assert roster.troubles() == []


def test_a_degraded_service_has_a_fault(roster: ServiceRegistry) -> None:
    report(roster, "map2d", "degraded", "the disk is full")
    assert roster.troubles() == [("map2d", "degraded", "the disk is full")]


def test_a_silent_service_has_a_fault(roster: ServiceRegistry, clock: Clock) -> None:
    clock.now += 6
    report(roster, "planner")
    assert roster.troubles() == [("map2d", "silent", "it has not reported for 6 s")]


def test_a_service_that_vanished_has_a_fault_and_one_that_was_stopped_has_none(
    roster: ServiceRegistry,
) -> None:
    roster.on_alive("map2d", "1", False)
    assert [(name, kind) for name, kind, _ in roster.troubles()] == [("map2d", "down")]
    report(roster, "map2d", "stopping", "stopping")
    assert roster.troubles() == []


def test_a_service_that_reports_before_it_is_seen_has_no_fault(roster: ServiceRegistry) -> None:
    report(roster, "detector")
    assert roster.troubles() == []


def test_without_the_router_only_the_router_has_a_fault(
    roster: ServiceRegistry, clock: Clock
) -> None:
    clock.now += 60
    assert [(name, kind) for name, kind, _ in roster.troubles()] == [("router", "down")]


def test_a_stopped_robot_is_a_fault_until_it_is_cleared(
    backend: Backend, live: RobotMonitor, client: TestClient
) -> None:
    assert client.get("/v1/faults").json() == {"faults": [], "recordings": [], "folder": None}
    client.post("/v1/robot/stop", json={"reason": "a cat"})
    live.tick()
    (fault,) = client.get("/v1/faults").json()["faults"]
    assert (fault["id"], fault["state"], fault["message"]) == (
        "robot-stopped",
        "confirmed",
        "a cat",
    )
    assert (fault["count"], fault["cleared_s"], fault["recordings"]) == (1, None, [])
    refused = client.post("/v1/faults/robot-stopped/clear")
    assert (refused.status_code, "still present" in refused.json()["detail"]) == (409, True)
    text = client.get("/metrics").text
    labels = '{kind="stopped",robot="robot",source="robot"}'
    assert f"helios_fault_confirmed{labels} 1.0" in text
    assert f"helios_fault_occurrences_total{labels} 1.0" in text
    client.post("/v1/robot/clear-stop")
    live.tick()
    assert client.post("/v1/faults/robot-stopped/clear").json()["state"] == "cleared"
    assert f"helios_fault_confirmed{labels} 0.0" in client.get("/metrics").text


def test_unknown_faults_and_recordings_are_not_found(client: TestClient) -> None:
    assert client.post("/v1/faults/mug/clear").status_code == 404
    assert client.get("/v1/faults/recordings/mug.mcap").status_code == 404
    assert client.get("/v1/faults/recordings/..%2Ffaults.json").status_code == 404


def test_a_change_of_a_fault_is_an_event(
    backend: Backend, live: RobotMonitor, client: TestClient
) -> None:
    client.post("/v1/robot/stop")
    live.tick()
    event = live.events._state["fault/robot-stopped"]
    assert event.type == "fault"
    assert '"state":"confirmed"' in event.data


def test_a_new_subscriber_is_told_only_of_faults_in_the_list(
    live: RobotMonitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_gateway.faults.life_cycle.MOST_FAULTS", 3)
    for number in range(9):
        live.faults.observe([Finding(f"service {number}", "degraded", "it fails")])
    listed = {f"fault/{fault.id}" for fault in live.faults.faults()}
    assert len(listed) == 3
    assert {key for key in live.events._state if key.startswith("fault/")} == listed


def test_a_task_that_was_not_traced_has_no_trace_and_says_what_to_do(
    backend: Backend, client: TestClient
) -> None:
    task = client.post("/v1/tasks", json=TASK).json()
    assert task["trace_id"] is None
    answer = client.get(f"/v1/tasks/{task['id']}/trace")
    assert answer.status_code == 404
    assert "helios up --tracing" in answer.json()["detail"]
    assert client.get("/v1/tasks/mug/trace").status_code == 404
    trace = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331"
    backend.tasks[task["id"]].traceparent = f"{trace}-00"
    answer = client.get(f"/v1/tasks/{task['id']}/trace")
    assert (answer.status_code, "OTEL_TRACES_SAMPLER" in answer.json()["detail"]) == (404, True)


def test_a_trace_says_why_it_lacks_the_spans_of_a_service(
    backend: Backend, client: TestClient
) -> None:
    def hang(_: pb.SpansRequest) -> pb.SpansReply:
        raise DeadlineExceeded("map2d/spans gave no answer in 5 s")

    task = client.post("/v1/tasks", json=TASK).json()
    trace = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"
    backend.tasks[task["id"]].traceparent = trace
    backend.bus.serve(spans_method("map2d"), hang)
    sources = client.get(f"/v1/tasks/{task['id']}/trace").json()["sources"]
    notes = {source["service"]: source["note"] for source in sources}
    assert notes["map2d"] == "map2d/spans gave no answer in 5 s"
    assert notes["planner"].startswith("it does not answer, or runs without tracing: nobody serves")


# --- spans of requests -------------------------------------------------------------------------
@pytest.fixture
def exported() -> Iterator[Any]:
    export = pytest.importorskip("opentelemetry.sdk.trace.export", reason="extra tracing")
    memory = pytest.importorskip("opentelemetry.sdk.trace.export.in_memory_span_exporter")
    exporter = memory.InMemorySpanExporter()
    recording = SpanRecording("gateway", "r", (export.SimpleSpanProcessor(exporter),))
    tracing.use(recording)
    yield exporter
    recording.close()


def test_a_change_is_a_span_with_its_route_and_status(
    backend: Backend, client: TestClient, exported: Any
) -> None:
    client.post("/v1/tasks", json=TASK)
    client.post("/v1/tasks/c0ffee/cancel")
    taken, cancelled = exported.get_finished_spans()
    assert taken.name == "POST /v1/tasks"
    assert taken.attributes["http.response.status_code"] == 202
    assert cancelled.name == "POST /v1/tasks/{id}/cancel"


def test_a_read_is_a_span_only_with_a_traceparent(
    backend: Backend, client: TestClient, exported: Any
) -> None:
    client.get("/v1/status")
    client.get("/v1/status", headers={"traceparent": "mug"})
    assert not exported.get_finished_spans()
    parent = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"
    client.get("/v1/status", headers={"traceparent": parent})
    (span,) = exported.get_finished_spans()
    assert span.name == "GET /v1/status"
    assert f"{span.parent.span_id:016x}" == "b7ad6b7169203331"
