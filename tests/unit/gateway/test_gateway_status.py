"""Services, readiness, health, metrics."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from unittest.mock import AsyncMock

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from helios_core import proto as pb
from helios_core.topics import status_topic
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.fleet.queue import FleetQueue
from helios_gateway.prometheus_metrics import Metrics, RequestMetrics
from helios_gateway.robot_registry import RobotRegistry
from helios_gateway.service_registry import ServiceRegistry
from starlette.types import Receive, Scope, Send

from tests.gateway_backend import Backend
from tests.support import wait_until
from tests.unit.gateway.gateway_clock import Clock

READY = {"ready": True, "stopped": False, "stop_reason": "", "reasons": []}


@pytest.fixture
def roster(clock: Clock) -> ServiceRegistry:
    return ServiceRegistry(silent_after_s=5, clock=clock)


def service_status(
    service: str, state: str, reason: str = "", instance: str = "1"
) -> pb.ServiceStatus:
    return pb.ServiceStatus(service=service, instance=instance, state=state, reason=reason, pid=7)


def state_of(roster: ServiceRegistry, name: str) -> tuple[str, str]:
    [service] = [s for s in roster.services() if s.name == name]
    return service.state, service.reason


def test_a_known_service_that_was_never_seen_is_down_with_a_reason(roster: ServiceRegistry) -> None:
    names = [s.name for s in roster.services()]
    assert names == ["router", "bridge", "detector", "objectmap", "map2d", "planner", "gateway"]
    assert state_of(roster, "map2d") == ("down", "it has not been seen; start it")
    assert len(roster.not_ready_reasons()) == 5


def test_the_report_of_a_service_counts_while_the_service_is_alive(roster: ServiceRegistry) -> None:
    roster.on_status(service_status("map2d", "waiting", "waits for a frame"))
    assert state_of(roster, "map2d")[0] == "down"
    roster.on_alive("map2d", "1", True)
    assert state_of(roster, "map2d") == ("waiting", "waits for a frame")
    roster.on_alive("map2d", "1", False)
    assert state_of(roster, "map2d") == ("down", "it was there and is gone; start it again")


def test_the_report_of_a_dead_instance_does_not_count_for_its_successor(
    roster: ServiceRegistry,
) -> None:
    roster.on_alive("map2d", "1", True)
    roster.on_status(service_status("map2d", "ready"))
    roster.on_alive("map2d", "2", True)
    roster.on_alive("map2d", "1", False)
    assert state_of(roster, "map2d")[0] == "starting"
    roster.on_status(service_status("map2d", "ready", instance="2"))
    assert state_of(roster, "map2d") == ("ready", "")


def test_a_silent_service_is_degraded(roster: ServiceRegistry, clock: Clock) -> None:
    roster.on_alive("map2d", "1", True)
    roster.on_status(service_status("map2d", "ready"))
    clock.now += 6
    assert state_of(roster, "map2d") == ("degraded", "it has not reported for 6 s")
    assert state_of(roster, "router") == ("down", "nothing has been heard over it for 6 s")


def test_a_report_of_the_gateway_does_not_prove_that_the_router_works(
    roster: ServiceRegistry, clock: Clock
) -> None:
    roster.on_status(service_status("gateway", "ready"))
    assert state_of(roster, "router") == ("starting", "nothing has been heard over it")
    roster.on_status(service_status("map2d", "ready"))
    assert state_of(roster, "router") == ("ready", "")
    clock.now += 6
    roster.on_status(service_status("gateway", "ready"))
    assert state_of(roster, "router") == ("down", "nothing has been heard over it for 6 s")


def test_the_supervisor_reports_restarts_and_why_a_service_is_down(roster: ServiceRegistry) -> None:
    process = pb.ProcessStatus(
        name="map2d", pid=12, restarts=3, state="restarting", reason="killed by signal 9"
    )
    roster.on_supervisor(pb.SupervisorStatus(processes=[process]))
    [service] = [s for s in roster.services() if s.name == "map2d"]
    assert (service.state, service.reason) == ("down", "killed by signal 9")
    assert (service.restarts, service.pid) == (3, 12)


def test_the_world_service_is_listed_only_for_a_simulated_robot(roster: ServiceRegistry) -> None:
    assert "world" not in [s.name for s in roster.services()]
    roster.on_description(pb.RobotDescription(simulated=True))
    assert [s.name for s in roster.services()][:2] == ["router", "world"]


def test_the_robot_is_ready_when_all_five_services_are_ready(
    backend: Backend, client: TestClient
) -> None:
    assert client.get("/readyz").json() == READY
    backend.report("planner", 4105, "waiting", "waits for the bridge")
    response = client.get("/readyz")
    assert response.status_code == 503
    assert response.json()["reasons"] == ["planner is waiting: waits for the bridge"]
    assert client.get("/v1/status").json()["ready"] is False
    assert client.get("/healthz").json() == {"healthy": True}


def test_a_latched_stop_makes_the_robot_not_ready(backend: Backend, client: TestClient) -> None:
    client.post("/v1/robot/stop")
    response = client.get("/readyz")
    assert (response.status_code, response.json()["stopped"]) == (503, True)
    assert "clear-stop" in response.json()["reasons"][0]
    assert client.get("/v1/status").json()["stopped"] is True
    assert 'helios_stopped{robot="robot"} 1.0' in client.get("/metrics").text
    client.post("/v1/robot/clear-stop")
    assert client.get("/readyz").json() == READY


def test_the_stop_reason_is_reported_in_readiness_and_status(
    backend: Backend, client: TestClient, live: RobotMonitor
) -> None:
    for reason in ("child on the floor", "a cat\x1b[31m"):  # the second is for the same stop
        said = reason.replace("\x1b", "\ufffd")
        client.post("/v1/robot/stop", json={"reason": reason})
        readiness, status = client.get("/readyz").json(), client.get("/v1/status").json()
        assert readiness["stop_reason"] == status["stop_reason"] == said
        assert readiness["reasons"] == [
            f"the robot is stopped ({said}): it will not move until /v1/robot/clear-stop"
        ]
    client.post("/v1/robot/clear-stop")
    assert client.get("/v1/status").json()["stop_reason"] == ""


@pytest.mark.parametrize("name", ["", "planner", "map2d/../bridge"])
def test_a_status_for_another_service_or_without_a_name_is_ignored(
    roster: ServiceRegistry, name: str
) -> None:
    before = [s.name for s in roster.services()]
    roster.listener("map2d")(service_status(name, "ready"))
    assert [s.name for s in roster.services()] == before
    assert state_of(roster, "map2d") == ("down", "it has not been seen; start it")
    roster.on_supervisor(pb.SupervisorStatus(processes=[pb.ProcessStatus(name="")]))
    assert [s.name for s in roster.services()] == before
    roster.listener("map2d")(service_status("map2d", "ready"))
    roster.on_alive("map2d", "1", True)
    assert state_of(roster, "map2d") == ("ready", "")


def test_a_status_on_the_bus_without_a_name_adds_no_row(
    backend: Backend, client: TestClient
) -> None:
    names = [s["name"] for s in client.get("/v1/status").json()["services"]]
    backend.bus.publish(status_topic("planner"), service_status("", "ready"))
    assert [s["name"] for s in client.get("/v1/status").json()["services"]] == names


def test_status_lists_every_service_with_restarts_and_pid(
    backend: Backend, client: TestClient
) -> None:
    backend.supervise(detector=2)
    status = client.get("/v1/status").json()
    assert set(status) == {"ready", "stopped", "stop_reason", "services"}
    by_name = {s["name"]: s for s in status["services"]}
    assert by_name["detector"] == {
        "name": "detector",
        "state": "ready",
        "reason": "",
        "restarts": 2,
        "pid": 4102,
    }
    assert by_name["router"]["state"] == "ready"


@pytest.mark.parametrize(
    ("route", "root"), [("/v1", "/v1"), ("/v1/robots/{robot}", "/v1/robots/robot")]
)
def test_metrics_count_routes_by_pattern(
    backend: Backend, client: TestClient, route: str, root: str
) -> None:
    series = (
        f'helios_http_requests_total{{method="GET",route="{route}/tasks/{{id}}",status="404"}} '
    )

    def counted(text: str) -> float:
        """The total of the series; the application and its counts outlive a test."""
        return sum(float(line.split()[-1]) for line in text.splitlines() if series in line)

    before = counted(client.get("/metrics").text)
    for id in ("a", "b", "c"):
        client.get(f"{root}/tasks/{id}")
    text = client.get("/metrics").text
    assert counted(text) - before == 3
    assert 'helios_service_ready{robot="robot",service="map2d"} 1.0' in text
    assert (
        'helios_service_figure{name="update_ms_median",robot="robot",service="map2d"} 2.5' in text
    )


def test_the_gateway_answers_while_metrics_wait_for_the_disk(
    app: FastAPI, backend: Backend, client: TestClient
) -> None:
    state = app.state.gateway
    with ThreadPoolExecutor(1) as scraper:
        with state.fleet.queue._lock:  # as during a commit
            scraped = scraper.submit(client.get, "/metrics")
            wait_until(lambda: state.metrics_threads.borrowed_tokens == 1, 60, "it is asked")
            assert client.get("/healthz").status_code == 200
            assert not scraped.done()
        assert "helios_fleet_tasks 0.0" in scraped.result(20).text


def test_made_up_methods_add_no_series_to_the_metrics(backend: Backend, client: TestClient) -> None:
    for method in ("NONE0", "NONE1", "PROPFIND"):
        assert client.request(method, "/v1/robot/stop").status_code == 405
    text = client.get("/metrics").text
    assert 'method="other",route="/v1/robot/stop",status="405"' in text
    assert "NONE" not in text
    assert "PROPFIND" not in text


def test_the_page_and_the_docs_refer_to_no_other_host(client: TestClient) -> None:
    page = client.get("/")
    assert "default-src 'self'" in page.headers["content-security-policy"]
    for text in (page.text, client.get("/docs").text):
        assert "https://" not in text
    names = (
        "style.css",
        "parts.css",
        "main.js",
        "stop.js",
        "api.js",
        "map.js",
        "overlay.js",
        "icon.svg",
    )
    for name in names:
        assert client.get(f"/static/{name}").status_code == 200
    assert client.get("/static-offline-docs/swagger-ui-bundle.js").status_code == 200


@pytest.mark.parametrize("path", ["/healthz", "/readyz"])
def test_the_probes_answer_head_like_get_without_a_body(
    client: TestClient, backend: Backend, path: str
) -> None:
    get, head = client.get(path), client.head(path)
    assert (head.status_code, head.content) == (get.status_code, b"")
    assert head.headers["content-type"] == get.headers["content-type"]


@pytest.mark.parametrize("path", ["/", "/docs"])
def test_the_page_and_the_docs_may_not_be_embedded_in_a_frame(
    client: TestClient, path: str
) -> None:
    page = client.get(path)
    assert page.status_code == 200
    assert "frame-ancestors 'none'" in page.headers["content-security-policy"]
    assert page.headers["x-frame-options"] == "DENY"


def test_the_openapi_description_has_every_documented_address(client: TestClient) -> None:
    paths = set(client.get("/openapi.json").json()["paths"])
    assert paths >= {
        "/v1/tasks", "/v1/tasks/{id}", "/v1/tasks/{id}/cancel", "/v1/tasks/{id}/decisions",
        "/v1/events", "/v1/map/occupancy.png", "/v1/map/occupancy.npz",
        "/v1/map/value/{layer}.png", "/v1/map/value/{layer}.npz", "/v1/map/frontiers",
        "/v1/objects", "/v1/camera.jpg", "/v1/robot", "/v1/robot/stop", "/v1/robot/clear-stop",
        "/v1/status", "/healthz", "/readyz", "/metrics",
    }  # fmt: skip


@pytest.mark.parametrize(("started", "status"), [(True, "200"), (False, "500")])
def test_a_request_that_fails_counts_once(started: bool, status: str) -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if started:
            await send({"type": "http.response.start", "status": 200, "headers": []})
        raise OSError("the file is gone")

    metrics = Metrics(RobotRegistry({}), FleetQueue(None))
    scope = {"type": "http", "method": "GET", "path": "/v1/map"}
    with pytest.raises(OSError, match="the file is gone"):
        asyncio.run(RequestMetrics(app, metrics)(scope, AsyncMock(), AsyncMock()))
    counted = [s for m in metrics.requests.collect() for s in m.samples if s.name.endswith("total")]
    assert [(s.labels["status"], s.value) for s in counted] == [(status, 1.0)]
