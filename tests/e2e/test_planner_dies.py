"""SIGKILL of the planner process in mid-task: it goes on, and nothing was forgotten."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.topics import CONTEXT, TRUTH_EPISODE
from helios_core.zenoh_bus import ZenohBus

from tests.house import House
from tests.restarts import Restart, restarted
from tests.support import wait_until

pytestmark = pytest.mark.timeout(420)


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    house = House(tmp_path_factory.mktemp("state"))
    try:
        wait_until(house.ready, 180, "all services are ready")
        yield house
    finally:
        house.close()


def test_a_killed_planner_goes_on_where_it_was(house: House) -> None:
    bus = ZenohBus(f"tcp/127.0.0.1:{house.router_port}")
    contexts: list[str] = []
    bus.subscribe(CONTEXT, lambda c: contexts.append(c.id))
    try:
        instruction = bus.call(TRUTH_EPISODE, pb.Empty(), 10).instruction
        id = house.post("/v1/tasks", {"instruction": instruction})["id"]
        restarts: list[Restart] = []
        for steps in (20, 45):  # while it looks around, and while it searches
            wait_until(lambda steps=steps: house.task(id)["steps"] >= steps, 150, "it works")
            restarts.append(killed(house, bus, id))
        # Five seconds on a quiet machine, in words that hold on a busy one: `tests/bench/
        # planner_restart.py` prints them as they are. What is slow by itself is slow both times.
        assert max(r.cpu_s for r in restarts) < 5
        assert min(r.of_first_word for r in restarts) < 5
        assert set(contexts) == {id}, "another search context forgets what was searched"
        indices = [d["index"] for d in house.get(f"/v1/tasks/{id}/decisions")["decisions"]]
        assert indices == list(range(len(indices)))
        assert house.task(id)["state"] == "running"
        house.post(f"/v1/tasks/{id}/cancel")
        wait_until(lambda: house.task(id)["state"] == "cancelled", 60, "it is cancelled")
    finally:
        bus.close()


def killed(house: House, bus: Bus, id: str) -> Restart:
    """Kill the planner, and wait until it goes on; what was explored is never less."""
    explored_m2 = house.get("/v1/map")["explored_m2"]
    least_m2 = [explored_m2]
    restart = restarted(
        house, bus, id, 150, lambda: least_m2.append(house.get("/v1/map")["explored_m2"])
    )
    print(restart)
    assert min(least_m2) > explored_m2 - 0.1
    assert house.task(id)["state"] == "running"
    return restart
