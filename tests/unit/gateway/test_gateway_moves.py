"""Moving the robot over HTTP: each address submits a task with the matching instruction."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from helios_client.commands.api_keys import add_key
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.api_move_models import GoRequest
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.routes.moves import EXPLORE, HOME, sentence_to
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app
from helios_planner.instruction.parser import Kind, parse
from hypothesis import given
from hypothesis import strategies as st

from tests.gateway_backend import Backend


def test_each_move_address_queues_an_ordinary_task(backend: Backend, client: TestClient) -> None:
    go = client.post("/v1/robot/go", json={"x_m": 3.2, "y_m": -4.1, "yaw_rad": math.pi / 2})
    explore = client.post("/v1/robot/explore", json={"time_limit_s": 90})
    home = client.post("/v1/robot/home")
    assert [a.status_code for a in (go, explore, home)] == [202] * 3
    assert go.json()["instruction"] == "go to 3.2, -4.1 facing 90 degrees"
    assert go.json()["point"] == {"x_m": 3.2, "y_m": -4.1, "yaw_rad": None}
    assert explore.json()["time_limit_s"] == 90
    assert (explore.json()["kind"], home.json()["kind"]) == ("explore", "go_home")
    assert home.json()["point"] is None
    assert client.get("/v1/tasks").json()["tasks"] == [home.json(), explore.json(), go.json()]
    named = client.post("/v1/robots/robot/robot/home")
    assert named.status_code == 202


@pytest.mark.parametrize(
    ("path", "body", "says"),
    [
        ("go", {}, "x_m is missing"),
        ("go", {"x_m": 1}, "y_m is missing"),
        ("go", {"x_m": "here", "y_m": 1}, "x_m"),
        ("go", {"x_m": 1, "y_m": 20_000}, "y_m is 20000; wanted less than or equal to 10000"),
        ("go", {"x_m": 1, "y_m": 2, "yaw_deg": 90}, "yaw_deg is not known here; leave it out"),
        ("explore", {"time_limit_s": 0}, "time_limit_s is 0; wanted greater than 0"),
        ("explore", {"time_limit_s": 1e9}, "time_limit_s"),
    ],
)
def test_an_invalid_body_gets_status_400_with_the_reason(
    backend: Backend, client: TestClient, path: str, body: dict, says: str
) -> None:
    answer = client.post(f"/v1/robot/{path}", json=body)
    assert answer.status_code == 400
    assert says in answer.json()["detail"]
    assert backend.calls == []


def test_non_finite_numbers_are_refused(backend: Backend, client: TestClient) -> None:
    for number in ("NaN", "Infinity", "-Infinity", "1e400"):
        content = f'{{"x_m": {number}, "y_m": 1}}'
        answer = client.post(
            "/v1/robot/go", content=content, headers={"content-type": "application/json"}
        )
        assert answer.status_code == 400


def test_moving_the_robot_needs_the_task_scope(hub: MemoryHub, tmp_path: Path) -> None:
    file = tmp_path / "keys.toml"
    keys = {scope: add_key(file, scope, scope) for scope in ("read", "task", "robot")}
    backend = Backend(hub)
    backend.start()
    settings = Settings.load(["--keys", str(file)])
    live = RobotMonitor(MemoryBus(hub), settings)
    app = create_app(RobotRegistry({"robot": RobotEndpoint(MemoryBus(hub), live)}), settings)
    with TestClient(app, base_url="http://localhost") as client:
        for path, body in (("go", {"x_m": 1, "y_m": 2}), ("explore", {}), ("home", None)):
            for scope, status in (("read", 403), ("task", 202), ("robot", 202)):
                headers = {"authorization": f"Bearer {keys[scope]}"}
                answer = client.post(f"/v1/robot/{path}", json=body, headers=headers)
                assert answer.status_code == status, (path, scope)
            assert client.post(f"/v1/robot/{path}", json=body).status_code == 401


metres = st.floats(-10_000, 10_000)
angles = st.none() | st.floats(-1000, 1000)


@given(metres, metres, angles)
def test_the_planner_parses_the_coordinates_of_a_go_instruction(
    x_m: float, y_m: float, yaw_rad: float | None
) -> None:
    got = parse(sentence_to(GoRequest(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)))
    assert got.kind is Kind.GO_TO_POINT
    assert got.point is not None
    assert got.point.x_m == pytest.approx(x_m, abs=0.0006)
    assert got.point.y_m == pytest.approx(y_m, abs=0.0006)
    assert (got.point.yaw_rad is None) == (yaw_rad is None)
    if yaw_rad is not None and got.point.yaw_rad is not None:
        assert math.cos(got.point.yaw_rad - yaw_rad) > 1 - 1e-6


def test_the_planner_parses_the_explore_and_home_instructions() -> None:
    assert parse(EXPLORE).kind is Kind.EXPLORE
    assert parse(HOME).kind is Kind.GO_HOME
