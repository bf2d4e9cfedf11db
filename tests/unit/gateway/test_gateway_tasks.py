"""Tasks over HTTP, and the errors for invalid input."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from helios_client.answer_types import Task
from helios_core import proto as pb
from helios_core.errors import Internal
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.task_states import ENDED, TASK_STATES, TaskState
from helios_core.topics import GET_TASK, SUBMIT
from helios_planner.service import PlannerService
from helios_planner.settings import Settings as PlannerSettings
from helios_planner.task import State
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.gateway_backend import Backend

INSTRUCTION = "Move the mug from the coffee table to the kitchen counter"


def problem_detail(response, status: int) -> str:
    """Check that the response is a well-formed problem and return its detail."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    body = response.json()
    assert set(body) == {"type", "title", "status", "detail"}
    assert body["status"] == status
    return body["detail"]


def test_the_planner_and_the_gateway_use_the_same_task_states() -> None:
    assert [state.value for state in State] == list(TASK_STATES)
    assert {state.value for state in State if state.ended} == ENDED


@pytest.mark.parametrize("state", TASK_STATES)
def test_every_task_state_is_reported_and_can_be_filtered(
    backend: Backend, client: TestClient, state: TaskState
) -> None:
    id = client.post("/v1/tasks", json={"instruction": INSTRUCTION}).json()["id"]
    backend.tasks[id].state = state
    assert client.get(f"/v1/tasks/{id}").json()["state"] == state
    for asked in TASK_STATES:
        found = client.get(f"/v1/tasks?state={asked}").json()["tasks"]
        assert [task["id"] for task in found] == ([id] if asked == state else [])


def test_an_unknown_task_state_gets_status_500(backend: Backend, client: TestClient) -> None:
    id = client.post("/v1/tasks", json={"instruction": INSTRUCTION}).json()["id"]
    backend.tasks[id].state = "dancing"
    assert problem_detail(client.get(f"/v1/tasks/{id}"), 500).startswith(
        "the planner named a state 'dancing'"
    )


def test_a_task_is_accepted_watched_and_cancelled(backend: Backend, client: TestClient) -> None:
    response = client.post("/v1/tasks", json={"instruction": INSTRUCTION})
    assert response.status_code == 202
    task = response.json()
    assert (task["state"], task["instruction"], task["object"]) == ("queued", INSTRUCTION, "mug")
    assert client.get(f"/v1/tasks/{task['id']}").json() == task
    assert client.get("/v1/tasks").json() == {"tasks": [task]}
    assert client.post(f"/v1/tasks/{task['id']}/cancel").json()["state"] == "cancelled"
    assert "has ended" in problem_detail(client.post(f"/v1/tasks/{task['id']}/cancel"), 409)


def test_the_newest_task_comes_first(backend: Backend, client: TestClient) -> None:
    for _ in range(3):
        client.post("/v1/tasks", json={"instruction": INSTRUCTION})
    assert [t["id"] for t in client.get("/v1/tasks").json()["tasks"]] == ["t3", "t2", "t1"]


def test_phases_before_the_current_one_are_done(backend: Backend, client: TestClient) -> None:
    client.post("/v1/tasks", json={"instruction": INSTRUCTION})
    backend.tasks["t1"].state, backend.tasks["t1"].phase = "running", "find_receptacle"
    phases = client.get("/v1/tasks/t1").json()["phases"]
    assert [p["name"] for p in phases] == ["find_object", "pick", "find_receptacle", "place"]
    assert [p["state"] for p in phases] == ["done", "done", "active", "waiting"]


@pytest.mark.parametrize("seen", [True, False, None])
def test_a_task_reports_whether_its_object_was_seen_at_the_goal(
    seen: bool | None, backend: Backend, client: TestClient
) -> None:
    client.post("/v1/tasks", json={"instruction": INSTRUCTION})
    backend.change_task("t1", "succeeded")
    if seen is not None:
        backend.tasks["t1"].seen_at_goal = seen
    answer = client.get("/v1/tasks/t1").json()
    assert answer["seen_at_goal"] is seen
    assert Task.from_json(answer).seen_at_goal is seen


def test_the_time_left_is_a_range_or_null_if_unknown(backend: Backend, client: TestClient) -> None:
    client.post("/v1/tasks", json={"instruction": INSTRUCTION})
    answer = client.get("/v1/tasks/t1").json()
    assert answer["eta_s"] is None
    assert Task.from_json(answer).eta_s is None
    backend.change_task("t1", "running", eta_low_s=40.0, eta_high_s=310.5)
    answer = client.get("/v1/tasks/t1").json()
    assert answer["eta_s"] == [40.0, 310.5]
    assert Task.from_json(answer).eta_s == [40.0, 310.5]


def test_a_missing_time_limit_is_null_in_json_and_none_in_python(
    backend: Backend, client: TestClient
) -> None:
    client.post("/v1/tasks", json={"instruction": INSTRUCTION})
    backend.change_task("t1", "running", time_limit_s=0.0)
    answer = client.get("/v1/tasks/t1").json()
    assert answer["time_limit_s"] is None
    assert Task.from_json(answer).time_limit_s is None
    backend.change_task("t1", "running", time_limit_s=60.0)
    assert Task.from_json(client.get("/v1/tasks/t1").json()).time_limit_s == 60.0


def test_an_instruction_that_is_not_understood_is_refused_with_the_reason(
    backend: Backend, client: TestClient
) -> None:
    detail = problem_detail(client.post("/v1/tasks", json={"instruction": "dance"}), 400)
    assert "understood" in detail
    assert "'dance'" in detail


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (b"", "the body is empty"),
        (b"{", "JSON"),
        (b"[1]", "no JSON object"),
        (b'{"instruction": 5}', "instruction is 5; wanted a valid string"),
        (b'{"instruction": "  "}', "the instruction is empty; say what to move"),
        (b'{"instruction": "move \\ud800 it"}', "half a character"),
        (b'{"instruction": "\xff move"}', "body"),
        (b'{"instruction": "move it", "max_steps": -1}', "max_steps"),
        (b'{"instruction": "move it", "max_steps": 1e400}', "max_steps"),
        (b'{"instruction": "move it", "speed": 9}', "speed"),
        (json.dumps({"instruction": "move " * 2001}).encode(), "10005 characters; send at most"),
        (b"[" * 50_000, "body"),
    ],
)
def test_an_invalid_body_gets_status_400_with_the_reason(
    backend: Backend, client: TestClient, body: bytes, says: str
) -> None:
    headers = {"content-type": "application/json"}
    detail = problem_detail(client.post("/v1/tasks", content=body, headers=headers), 400)
    assert says in detail
    assert backend.calls == []


def test_a_body_above_the_limit_is_refused_unread(backend: Backend, client: TestClient) -> None:
    big = json.dumps({"instruction": "move " * 20_000}).encode()
    assert "65536" in problem_detail(client.post("/v1/tasks", content=big), 413)

    def pieces():
        for _ in range(100):
            yield b"x" * 1024

    problem_detail(client.post("/v1/tasks", content=pieces()), 413)


def test_a_command_from_another_origin_is_refused(backend: Backend, client: TestClient) -> None:
    other = {"origin": "https://example.org"}
    problem_detail(client.post("/v1/robot/clear-stop", headers=other), 403)
    own = {"origin": "http://localhost"}
    assert client.post("/v1/robot/clear-stop", headers=own).status_code == 200


def test_unknown_paths_and_tasks_get_status_404(backend: Backend, client: TestClient) -> None:
    for path in ("/v1/tasks/none", "/v1/tasks/none/decisions", "/v1/nothing", "/static/none.js"):
        problem_detail(client.get(path), 404)
    problem_detail(client.post("/v1/tasks/none/cancel"), 404)
    problem_detail(client.delete("/v1/tasks"), 405)


def test_a_missing_service_gets_status_503_and_an_internal_error_status_500(
    hub: MemoryHub, client: TestClient
) -> None:
    for path in ("/v1/tasks", "/v1/objects", "/v1/map", "/v1/map/occupancy.png", "/v1/camera.jpg"):
        problem_detail(client.get(path), 503)
    problem_detail(client.post("/v1/robot/stop"), 503)

    def fault(_: pb.SubmitRequest) -> pb.Task:
        raise Internal("the planner's disk is full")

    MemoryBus(hub).serve(SUBMIT, fault)
    response = client.post("/v1/tasks", json={"instruction": INSTRUCTION})
    assert problem_detail(response, 500) == "the planner's disk is full"


def test_a_task_for_an_agent_that_does_not_run_gets_status_409_with_the_command(
    hub: MemoryHub, client: TestClient, tmp_path: Path
) -> None:
    settings = PlannerSettings(state_dir=tmp_path, agent="helios")
    planner = PlannerService(MemoryBus(hub), settings, Health())
    try:
        asked = {"instruction": INSTRUCTION, "agent": "helios-paper"}
        detail = problem_detail(client.post("/v1/tasks", json=asked), 409)
        assert "helios up --agent helios-paper" in detail
        assert "or submit the task for agent 'helios'" in detail
        assert client.get("/v1/tasks").json()["tasks"] == []
    finally:
        planner.close()


def test_a_late_answer_gets_status_504(
    hub: MemoryHub, backend: Backend, client: TestClient
) -> None:
    from helios_core.errors import DeadlineExceeded

    def late(_: pb.TaskRequest) -> pb.Task:
        raise DeadlineExceeded("planner/get gave no answer in 5 s")

    MemoryBus(hub).serve(GET_TASK, late)
    problem_detail(client.get("/v1/tasks/t1"), 504)


def test_decisions_carry_candidates_with_their_terms(backend: Backend, client: TestClient) -> None:
    client.post("/v1/tasks", json={"instruction": INSTRUCTION})
    backend.decide()
    backend.decided[0].candidates[1].terms["information_gain"] = math.nan
    backend.decided[0].candidates[1].position_m.z = math.inf
    response = client.get("/v1/tasks/t1/decisions")
    [decision] = response.json()["decisions"]
    assert decision["rule"] == "global_search (eq. 10)"
    assert [c["chosen"] for c in decision["candidates"]] == [True, False, False, False]
    assert decision["candidates"][1]["terms"]["information_gain"] is None
    assert "NaN" not in response.text
    assert "Infinity" not in response.text


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    body=st.recursive(
        st.none() | st.booleans() | st.floats(allow_nan=False) | st.text(),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(st.sampled_from(["instruction", "max_steps", "x"]), inner, max_size=3)
        ),
        max_leaves=8,
    )
)
def test_no_request_body_causes_status_500(
    backend: Backend, client: TestClient, body: object
) -> None:
    response = client.post(
        "/v1/tasks", content=json.dumps(body).encode(), headers={"content-type": "application/json"}
    )
    assert response.status_code in (202, 400)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(name=st.text(min_size=1, max_size=30), query=st.text(max_size=10))
def test_no_path_or_query_causes_status_500(
    backend: Backend, client: TestClient, name: str, query: str
) -> None:
    from urllib.parse import quote

    part = quote(name.encode("utf-8", "replace"), safe="")
    for path in (f"/v1/tasks/{part}", f"/v1/map/value/{part}.png", f"/v1/map/value/{part}.npz"):
        assert client.get(path).status_code in (200, 404, 405)  # 405: "0%2Fpause" is POST only
    cells = client.get("/v1/map/cells.png", params={"layer": query.encode("utf-8", "replace")})
    assert cells.status_code in (200, 404)
    size = client.get("/v1/map/occupancy.png", params={"size_px": query.encode("utf-8", "replace")})
    assert size.status_code in (200, 400)
