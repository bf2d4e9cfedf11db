"""Tests SIGKILL of the planner during a task: the task continues and keeps its search state."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.topics import CONTEXT, TRUTH_EPISODE
from helios_core.zenoh_bus import ZenohBus

from tests.restarts import Restart, restarted
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


def test_a_killed_planner_continues_its_task(stack: Stack) -> None:
    bus = ZenohBus(f"tcp/127.0.0.1:{stack.router_port}")
    contexts: list[str] = []
    bus.subscribe(CONTEXT, lambda c: contexts.append(c.id))
    try:
        instruction = bus.call(TRUTH_EPISODE, pb.Empty(), 10).instruction
        id = stack.post("/v1/tasks", {"instruction": instruction})["id"]
        for steps in (20, 45):  # during the first look around, and during the search
            wait_until(lambda steps=steps: stack.task(id)["steps"] >= steps, 150, "it works")
            killed(stack, bus, id)  # tests/bench/planner_restart.py prints the times
        assert set(contexts) == {id}, "another search context forgets what was searched"
        indices = [d["index"] for d in stack.get(f"/v1/tasks/{id}/decisions")["decisions"]]
        assert indices == list(range(len(indices)))
        assert stack.task(id)["state"] == "running"
        stack.post(f"/v1/tasks/{id}/cancel")
        wait_until(lambda: stack.task(id)["state"] == "cancelled", 60, "it is cancelled")
    finally:
        bus.close()


def killed(stack: Stack, bus: Bus, id: str) -> Restart:
    """Kill the planner and wait until it continues. The explored area never shrinks."""
    explored_m2 = stack.get("/v1/map")["explored_m2"]
    least_m2 = [explored_m2]
    restart = restarted(
        stack, bus, id, 150, lambda: least_m2.append(stack.get("/v1/map")["explored_m2"])
    )
    print(restart)
    assert min(least_m2) > explored_m2 - 0.1
    assert stack.task(id)["state"] == "running"
    return restart
