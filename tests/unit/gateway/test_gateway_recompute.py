"""Decisions over HTTP, recomputed under other settings, and the time limit of a task."""

from __future__ import annotations

import pytest
from fastapi.testclient import TestClient
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import DECISIONS, SUBMIT

from tests.gateway_backend import Backend

INSTRUCTION = "Move the mug from the coffee table to the kitchen counter"
DECIDED = pb.Decision(
    task_id="t1",
    rule="global search (eq. 8-10)",
    do="search_receptacle",
    why="search it",
    candidates=[pb.Candidate(kind="receptacle", name="table", id=7, chosen=True)],
)


@pytest.fixture
def requested_settings(
    backend: Backend, hub: MemoryHub, client: TestClient
) -> list[dict[str, str]]:
    """Submit a task with one decision; return the settings of every request for it."""
    heard: list[dict[str, str]] = []

    def decisions(request: pb.TaskRequest) -> pb.DecisionList:
        heard.append(dict(request.settings))
        if "alpha" in request.settings:
            raise InvalidInput("decisions cannot be recomputed under another 'alpha'")
        out = pb.DecisionList(decisions=[DECIDED])
        if request.settings:
            out.decisions[0].recomputed.CopyFrom(
                pb.Recomputed(
                    do="go_to_frontier",
                    why="explore it",
                    flips=True,
                    certain=True,
                    candidates=[pb.Candidate(kind="frontier", terms={"total": 0.5}, chosen=True)],
                )
            )
        return out

    MemoryBus(hub).serve(DECISIONS, decisions)
    client.post("/v1/tasks", json={"instruction": INSTRUCTION})
    return heard


def test_decisions_without_settings_are_not_recomputed(
    requested_settings: list, client: TestClient
) -> None:
    [decision] = client.get("/v1/tasks/t1/decisions").json()["decisions"]
    assert (decision["do"], decision["recomputed"]) == ("search_receptacle", None)
    assert requested_settings == [{}]


def test_decisions_with_settings_are_recomputed(
    requested_settings: list, client: TestClient
) -> None:
    answer = client.get("/v1/tasks/t1/decisions", params={"set": ["alpha_d=0.01", "tau_g = 0.6"]})
    [decision] = answer.json()["decisions"]
    assert requested_settings == [{"alpha_d": "0.01", "tau_g": "0.6"}]
    again = decision["recomputed"]
    assert (again["do"], again["flips"], again["certain"]) == ("go_to_frontier", True, True)
    assert again["candidates"][0]["terms"] == {"total": 0.5}


@pytest.mark.parametrize("wrong", ["alpha_d", "=1", "alpha_d=", "alpha=1"])
def test_invalid_settings_get_status_400(
    requested_settings: list, client: TestClient, wrong: str
) -> None:
    assert client.get("/v1/tasks/t1/decisions", params={"set": wrong}).status_code == 400


def test_decisions_of_an_unknown_task_get_status_404_also_with_settings(
    requested_settings: list, client: TestClient
) -> None:
    answer = client.get("/v1/tasks/none/decisions", params={"set": "alpha_d=1"})
    assert answer.status_code == 404


def test_a_time_limit_reaches_the_planner(
    backend: Backend, hub: MemoryHub, client: TestClient
) -> None:
    heard: list[float] = []

    def submit(request: pb.SubmitRequest) -> pb.Task:
        heard.append(request.time_limit_s)
        return pb.Task(id="t", state="queued", time_limit_s=request.time_limit_s)

    MemoryBus(hub).serve(SUBMIT, submit)
    body = {"instruction": INSTRUCTION, "time_limit_s": 90}
    assert client.post("/v1/tasks", json=body).json()["time_limit_s"] == 90
    assert (
        client.post("/v1/tasks", json={"instruction": INSTRUCTION}).json()["time_limit_s"] is None
    )
    assert heard == [90, 0]
    assert client.post("/v1/tasks", json=body | {"time_limit_s": -1}).status_code == 400
