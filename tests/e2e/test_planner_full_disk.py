"""Tests a full disk and a killed planner in real processes: an ended task never moves the robot."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from helios_core import proto as pb
from helios_core.topics import TRUTH_EPISODE
from helios_core.zenoh_bus import ZenohBus

from tests.full_disk import fill, small_disk
from tests.stack import Stack
from tests.support import LOOPBACK, wait_until

pytestmark = pytest.mark.timeout(420)


@pytest.fixture
def planner_disk(tmp_path: Path) -> Iterator[Path]:
    """The planner's folder in the state folder `tmp_path`, on a disk of 4 MB."""
    with small_disk(tmp_path / "planner", 4096) as folder:
        yield folder


def refused(stack: Stack, instruction: str) -> str:
    """The reason why the planner refuses a task; empty if it accepts the task."""
    answer = LOOPBACK.post(
        f"{stack.address}/v1/tasks", json={"instruction": instruction}, timeout=60
    )
    return answer.json()["detail"] if answer.status_code == httpx.codes.SERVICE_UNAVAILABLE else ""


def test_a_task_that_ended_on_a_full_disk_does_not_resume_after_the_planner_dies(
    planner_disk: Path, tmp_path: Path
) -> None:
    stack = Stack(tmp_path)
    try:
        wait_until(stack.ready, 180, "all services are ready")
        bus = ZenohBus(f"tcp/127.0.0.1:{stack.router_port}")
        instruction = bus.call(TRUTH_EPISODE, pb.Empty(), 10).instruction
        bus.close()
        id = stack.post("/v1/tasks", {"instruction": instruction})["id"]
        wait_until(lambda: stack.task(id)["steps"] >= 5, 150, "it works")
        filler = fill(planner_disk)
        wait_until(lambda: "waits for its journal" in stack.task(id)["message"], 60, "it stands")
        assert "make room on that disk" in stack.task(id)["message"]
        reasons = LOOPBACK.get(f"{stack.address}/readyz", timeout=60).json()["reasons"]
        assert any("planner" in r and "tasks cannot be kept" in r for r in reasons)
        assert "no task is taken now" in refused(stack, instruction)

        stack.post(f"/v1/tasks/{id}/cancel")
        wait_until(lambda: "told as cancelled" in stack.task(id)["message"], 90, "it has ended")
        steps, pose = stack.task(id)["steps"], stack.get("/v1/robot")["state"]["pose"]
        old = stack.pid("planner")
        os.kill(old, signal.SIGKILL)
        wait_until(lambda: stack.pid("planner") not in (0, old), 60, "it is started again")
        wait_until(lambda: stack.task(id)["state"] == "failed", 60, "it is not gone on with")
        assert "could not write down how its tasks went" in stack.task(id)["message"]
        assert refused(stack, instruction)
        assert stack.get("/v1/robot")["state"]["pose"] == pytest.approx(pose, abs=0.01)

        filler.unlink()
        wait_until(lambda: not refused(stack, instruction), 60, "tasks are taken again")
        tasks = stack.get("/v1/tasks")["tasks"]
        running = [t["id"] for t in tasks if t["state"] in ("queued", "running")]
        assert id not in running
        assert len(running) == 1
        wait_until(lambda: stack.task(running[0])["steps"] >= 2, 60, "it works")
        assert stack.task(id)["state"] == "failed"
        assert stack.task(id)["steps"] <= steps  # the last steps could not be written
    finally:
        stack.close()
