"""Tests go, explore and come back through real processes with the simulated robot."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from typing import Any

import pytest
from helios_client.cli import run

from tests.stack import Stack
from tests.support import wait_until

pytestmark = pytest.mark.timeout(420)


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    stack = Stack(tmp_path_factory.mktemp("state"))
    try:
        wait_until(stack.ready, 180, "all services are ready")
        yield stack
    finally:
        stack.close()


def ended(stack: Stack, id: str) -> dict[str, Any]:
    wait_until(
        lambda: stack.task(id)["state"] in ("succeeded", "failed", "cancelled"), 240, "it ended"
    )
    return stack.task(id)


def pose(stack: Stack) -> tuple[float, float]:
    here = stack.get("/v1/robot")["state"]["pose"]
    return here["x_m"], here["y_m"]


def test_the_robot_explores_goes_and_comes_back(
    stack: Stack, capsys: pytest.CaptureFixture[str]
) -> None:
    port = stack.address.rsplit(":", 1)[1]
    start = pose(stack)
    explored = ended(stack, stack.post("/v1/robot/explore", {"time_limit_s": 15})["id"])
    assert explored["state"] == "succeeded", explored["message"]
    assert "m² of floor are known" in explored["message"]
    decisions = stack.get(f"/v1/tasks/{explored['id']}/decisions")["decisions"]
    assert decisions
    assert all(d["why"] for d in decisions)
    x, y = stack.get("/v1/map")["trajectory_m"][-1]  # where the robot fits for certain
    goal = start if (x, y) == start else (round(x, 2), round(y, 2))
    assert run(["go", str(goal[0]), str(goal[1]), "-90", "--port", port, "--json"]) == 0
    went = json.loads(capsys.readouterr().out)
    assert went["kind"] == "go_to_point"
    assert went["message"].startswith("stands at (")
    assert max(abs(a - b) for a, b in zip(pose(stack), goal, strict=True)) < 0.4
    back = ended(stack, stack.post("/v1/tasks", {"instruction": "come back"})["id"])
    assert back["state"] == "succeeded", back["message"]
    assert max(abs(a - b) for a, b in zip(pose(stack), start, strict=True)) < 0.65


def test_a_killed_planner_still_reaches_the_goal_when_the_detector_is_killed_too(
    stack: Stack,
) -> None:
    start = pose(stack)
    far = max(
        stack.get("/v1/map")["trajectory_m"],
        key=lambda p: (p[0] - start[0]) ** 2 + (p[1] - start[1]) ** 2,
    )
    id = stack.post("/v1/robot/go", {"x_m": far[0], "y_m": far[1]})["id"]
    wait_until(lambda: stack.task(id)["steps"] >= 2, 60, "it drives")
    for name in ("detector", "planner"):
        os.kill(stack.pid(name), signal.SIGKILL)
    done = ended(stack, id)
    assert done["state"] == "succeeded", done["message"]
    assert done["message"].startswith("stands at (")
    assert max(abs(a - b) for a, b in zip(pose(stack), far, strict=True)) < 0.4


def test_a_point_that_is_too_far_fails_as_unreachable_with_the_limit(stack: Stack) -> None:
    done = ended(stack, stack.post("/v1/robot/go", {"x_m": 500.0, "y_m": 0.0})["id"])
    assert (done["state"], done["cause"]) == ("failed", "goal unreachable")
    assert "m away; the robot is sent 100 m at most" in done["message"]
