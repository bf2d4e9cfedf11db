"""Robots, service settings, filters, entity tags, and events over WebSocket."""

from __future__ import annotations

import json

import pytest
from fastapi.testclient import TestClient
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app

from tests.gateway_backend import Backend

INSTRUCTION = "move the mug to the kitchen counter"


def test_robots_have_separate_tasks_and_stops(
    hub: MemoryHub, backend: Backend, live: RobotMonitor
) -> None:
    other = Backend(hub, "spot")
    other.start()
    bus = MemoryBus(hub, "spot")
    spot = RobotMonitor(bus, Settings.load(["--silent-after-s", "3600"]))
    fleet = RobotRegistry(
        {"robot": RobotEndpoint(MemoryBus(hub), live), "spot": RobotEndpoint(bus, spot)}
    )
    client = TestClient(create_app(fleet, Settings.load([])), "http://localhost")
    client.post("/v1/robots/spot/tasks", json={"instruction": INSTRUCTION})
    assert len(client.get("/v1/robots/spot/tasks").json()["tasks"]) == 1
    assert client.get("/v1/tasks").json() == client.get("/v1/robots/robot/tasks").json()
    assert client.get("/v1/tasks").json()["tasks"] == []
    client.post("/v1/robots/spot/robot/stop")
    assert (other.stopped, backend.stopped) == (True, False)
    assert [
        (r["name"], r["ready"], r["stopped"]) for r in client.get("/v1/robots").json()["robots"]
    ] == [("robot", True, False), ("spot", False, True)]
    assert client.get("/readyz").json()["reasons"][0].startswith("spot: the robot is stopped")
    missing = client.get("/v1/robots/nobody/tasks")
    assert missing.status_code == 404
    assert missing.json()["detail"].endswith("there are: robot, spot")
    spot.close()


def test_settings_of_a_running_service_are_reported(backend: Backend, client: TestClient) -> None:
    reported = {"agent": {"value": "helios", "default": "helios", "description": "who does tasks"}}
    backend.serve_settings("planner", reported)
    answer = client.get("/v1/services/planner/settings")
    assert answer.json() == {"service": "planner", "settings": reported}
    silent = client.get("/v1/services/map2d/settings")
    assert (silent.status_code, "nobody serves map2d/" in silent.json()["detail"]) == (503, True)
    router = client.get("/v1/services/router/settings")
    assert (router.status_code, "tells no settings" in router.json()["detail"]) == (404, True)
    assert "there are: router" in client.get("/v1/services/nobody/settings").json()["detail"]
    assert client.get("/v1/services/..%2Fsvc/settings").status_code in (400, 404)


def test_objects_are_filtered_by_class_and_score(backend: Backend, client: TestClient) -> None:
    def ids(query: str) -> list[int]:
        return [o["id"] for o in client.get(f"/v1/objects?{query}").json()["objects"]]

    assert ids("class=mug") == [1, 4]
    assert ids("min_score=0.6") == [1, 2]
    assert ids("class=mug&min_score=0.6") == [1]
    assert client.get("/v1/objects/4").json()["class"] == "mug"
    assert client.get("/v1/objects/99").status_code == 404
    for bad in ("nan", "inf", "-inf", "many"):
        refused = client.get(f"/v1/objects?min_score={bad}")
        assert (refused.status_code, "min_score" in refused.json()["detail"]) == (400, True)
    assert backend.calls.count("objects") == 1


@pytest.mark.parametrize(
    "path", ["/map", "/map/frontiers", "/objects", "/map/cells.png", "/map/occupancy.npz",
             "/map/value/pick.npz", "/camera.jpg"],
)  # fmt: skip
def test_unchanged_content_gets_status_304(backend: Backend, client: TestClient, path: str) -> None:
    backend.publish_frame()
    first = client.get(f"/v1{path}")
    again = client.get(f"/v1{path}", headers={"if-none-match": first.headers["etag"]})
    assert (first.status_code, again.status_code, again.content) == (200, 304, b"")
    assert again.headers["etag"] == first.headers["etag"]
    backend.change_map()
    backend.change_objects()
    backend.found[0].score = 0.99
    backend.publish_frame()
    if path not in ("/map/frontiers", "/map/cells.png", "/map/value/pick.npz", "/camera.jpg"):
        fresh = client.get(f"/v1{path}", headers={"if-none-match": first.headers["etag"]})
        assert fresh.status_code == 200


def test_tasks_are_listed_by_state(backend: Backend, client: TestClient) -> None:
    for _ in range(3):
        client.post("/v1/tasks", json={"instruction": INSTRUCTION, "agent": "trusting"})
    backend.tasks["t2"].state = "succeeded"
    assert [t["id"] for t in client.get("/v1/tasks?state=queued&limit=1").json()["tasks"]] == ["t3"]
    assert client.get("/v1/tasks/t2").json()["agent"] == "trusting"
    assert client.get("/v1/tasks?state=asleep").status_code == 400


def test_a_websocket_sends_events_and_resumes(backend: Backend, client: TestClient) -> None:
    with client.websocket_connect("ws://localhost/v1/events/ws?types=task") as socket:
        assert socket.receive_text() == ""
        backend.submit(INSTRUCTION)
        backend.submit(INSTRUCTION)
        first = socket.receive_json()
        assert (first["type"], first["data"]["id"]) == ("task", "t1")
        socket.send_text("a viewer may say what it likes")
        assert socket.receive_json()["data"]["id"] == "t2"
    with client.websocket_connect(
        f"ws://localhost/v1/events/ws?types=task&last_event_id={first['id']}"
    ) as again:
        assert again.receive_text() == ""
        assert again.receive_json()["data"]["id"] == "t2"


def test_the_event_stream_of_a_task_ends_with_the_task(
    backend: Backend, client: TestClient
) -> None:
    backend.submit(INSTRUCTION)
    backend.submit(INSTRUCTION)
    with client.websocket_connect("ws://localhost/v1/events/ws?task_id=t1") as socket:
        assert socket.receive_text() == ""
        assert socket.receive_json()["data"]["state"] == "queued"
        backend.decide()
        assert socket.receive_json()["type"] == "decision"
        backend.change_task("t2", "running")
        backend.change_task("t1", "cancelled")
        event = socket.receive_json()
        assert (event["data"]["id"], event["data"]["state"]) == ("t1", "cancelled")
        assert socket.receive()["type"] == "websocket.close"
    text = client.get("/v1/events?task_id=t1&types=task").text  # it has ended, so the stream ends
    [data] = [line for line in text.splitlines() if line.startswith("data: ")]
    assert json.loads(data.removeprefix("data: "))["state"] == "cancelled"
    assert client.get("/v1/events?task_id=none").status_code == 404
    assert "there are: task" in client.get("/v1/events?types=weather").json()["detail"]
