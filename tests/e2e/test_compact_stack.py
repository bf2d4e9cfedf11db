"""`helios up --compact`: nobody on the bus or over HTTP sees a difference to one process each."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from helios_core import proto as pb
from helios_core.bus_access import ACCESS
from helios_core.topics import (
    DECISION,
    KEYFRAME,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    OBSERVATION,
    PLAN,
    ROBOT_STATE,
    TASK,
    TRUTH_EPISODE,
    TRUTH_METRICS,
    Topic,
    settings_method,
    spans_method,
    status_topic,
)
from helios_core.zenoh_bus import ZenohBus

from tests.helios_up import Up, helios_up
from tests.stack import Stack
from tests.support import wait_until

pytestmark = pytest.mark.timeout(600)

TOGETHER = ("bridge", "detector", "objectmap", "map2d", "planner", "gateway")
ALL = ("router", "world", *TOGETHER)
PUBLISHED: tuple[Topic[Any], ...] = (
    ROBOT_STATE,
    KEYFRAME,
    OBSERVATION,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    TASK,
    PLAN,
    DECISION,
    *map(status_topic, TOGETHER),
)


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    stack = Stack(tmp_path_factory.mktemp("state"), "--compact")
    try:
        wait_until(stack.ready, 180, "all services are ready")
        yield stack
    finally:
        stack.close()


@pytest.fixture
def bus(stack: Stack) -> Iterator[ZenohBus]:
    bus = ZenohBus(f"tcp/127.0.0.1:{stack.router_port}")
    yield bus
    bus.close()


def test_the_status_names_every_service_and_one_process_runs_them(stack: Stack) -> None:
    port = stack.address.rsplit(":", 1)[1]
    done = subprocess.run(
        [sys.executable, "-m", "helios_client", "status", "--json", "--port", port],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    status = json.loads(done.stdout)
    rows = {s["name"]: s for s in status["services"]}
    assert status["ready"]
    assert set(rows) == set(ALL)
    assert all(set(s) == {"name", "state", "reason", "restarts", "pid"} for s in rows.values())
    assert {s["state"] for s in rows.values()} == {"ready"}
    assert len({rows[name]["pid"] for name in TOGETHER}) == 1
    assert len({s["pid"] for s in rows.values()}) == 3
    assert all(psutil.pid_exists(s["pid"]) for s in rows.values())


def test_every_service_announces_itself_and_serves_all_its_methods(bus: ZenohBus) -> None:
    alive: set[str] = set()
    bus.watch(lambda service, instance, is_alive: alive.add(service))
    wait_until(lambda: alive >= {"world", *TOGETHER}, 60, "all are announced")
    for name in TOGETHER:
        reply = bus.call(settings_method(name), pb.Empty(), 10)
        assert json.loads(reply.json)["robot"]["value"] == "robot"
        for method in set(ACCESS[name].serves) - {spans_method(name)}:  # tracing is off
            querier: Any = bus._session.declare_querier(method.key(bus.robot))
            wait_until(lambda q=querier: q.matching_status.matching, 60, f"{method.name} is served")
            querier.undeclare()


@pytest.mark.long
def test_a_task_goes_on_after_the_process_was_killed_and_succeeds(
    stack: Stack, bus: ZenohBus
) -> None:
    heard: set[str] = set()
    for topic in PUBLISHED:
        bus.subscribe(topic, lambda _, name=topic.name: heard.add(name))
    instruction = bus.call(TRUTH_EPISODE, pb.Empty(), 10).instruction
    id = stack.post("/v1/tasks", {"instruction": instruction})["id"]
    wait_until(lambda: stack.task(id)["steps"] >= 10, 150, "it looks around")
    pid = stack.pid("planner")
    os.kill(pid, signal.SIGKILL)
    wait_until(lambda: stack.pid("planner") not in (0, pid), 60, "it is started again")
    assert {stack.service(name)["restarts"] for name in TOGETHER} == {1}
    wait_until(
        lambda: stack.task(id)["state"] not in ("running", "unknown"), 400, "the task has ended"
    )
    assert stack.task(id)["state"] == "succeeded", stack.task(id)
    assert bus.call(TRUTH_METRICS, pb.Empty(), 10).success
    assert heard == {topic.name for topic in PUBLISHED}


def test_the_log_of_a_service_is_that_of_the_process(stack: Stack) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "helios_client", "logs", "map2d", "--state", str(stack.state)],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    for name in TOGETHER:
        assert f" {name} INFO ready" in done.stdout


def test_a_wrong_setting_of_one_service_ends_the_start_with_what_to_do(
    tmp_path: Path,
) -> None:
    wrong = {"HELIOS_MAP2D_CELL_M": "-1"}
    with (
        pytest.raises(AssertionError, match="helios-map2d: wrong setting: cell_m"),
        helios_up(tmp_path, "--robot", "sim", "--compact", kind=Up, environment=wrong) as up,
    ):
        wait_until(up.ready, 60, "it ends")
