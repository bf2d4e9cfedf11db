"""Tests the full stack as processes: it starts, survives the death of any service, does a task."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import psutil
import pytest
from helios_client.answer_types import ServiceAnswer
from helios_client.commands.status import find_status
from helios_client.sdk import Helios
from helios_core import proto as pb
from helios_core.topics import TRUTH_EPISODE, TRUTH_METRICS, WORLD_STATE
from helios_core.zenoh_bus import ZenohBus

from tests.helios_up import Up, helios_up, is_ready
from tests.support import ENDS_WITHIN_S, LOOPBACK, free_port, wait_until

SEED = 1
ROOT = Path(__file__).resolve().parents[2]
SERVICES = ("router", "world", "bridge", "detector", "objectmap", "map2d", "planner", "gateway")


class Stack(Up):
    """A running `helios up` with the simulated robot."""

    def get(self, path: str) -> httpx.Response:
        return LOOPBACK.get(f"{self.address}{path}", timeout=60)

    def status(self) -> dict[str, ServiceAnswer]:
        """The services by name, as `helios status` reports them."""
        with Helios(f"http://127.0.0.1:{self.port}", 3.0) as helios:
            found = find_status(helios, self.port, self.state)
        return {s["name"]: s for s in found["services"]}

    def kill(self, name: str) -> None:
        """Kill a service; returns when the status shows it restarted and all services are ready."""
        wait_until(self.ready, 90, "all services are ready")
        before = self.status()[name]
        pid = before["pid"]
        assert pid is not None
        os.kill(pid, signal.SIGKILL)

        def is_back() -> bool:
            now = self.status().get(name, {})
            return (
                now.get("state") == "ready"
                and now["pid"] != pid
                and now["restarts"] == before["restarts"] + 1
            )

        # 60 s allow for a busy machine; the 5 s are measured elsewhere.
        wait_until(is_back, 60, f"{name} is back")
        wait_until(self.ready, 90, "all services are ready again")


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    """A stack that must leave no process behind."""
    flags = ("--robot", "sim", "--seed", str(SEED))
    with helios_up(tmp_path_factory.mktemp("state"), *flags, kind=Stack) as stack:
        wait_until(stack.ready, 120, "all services are ready")
        yield stack


def check_answer(stack: Stack, path: str, kind: str) -> None:
    answer = stack.get(path)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"].startswith(kind)


def test_every_service_is_ready_in_its_own_process(stack: Stack) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "helios_client", "status", "--json", "--port", str(stack.port)],
        capture_output=True,
        text=True,
        timeout=20,
        check=False,
    )
    status = {s["name"]: s for s in json.loads(done.stdout)["services"]}
    assert set(SERVICES) <= set(status)
    assert {name: status[name]["state"] for name in SERVICES} == dict.fromkeys(SERVICES, "ready")
    pids = [status[name]["pid"] for name in SERVICES]
    assert len(set(pids)) == len(SERVICES)
    assert all(psutil.pid_exists(pid) for pid in pids)


@pytest.mark.parametrize(
    ("instruction", "said"),
    [
        ("", "instruction"),
        ("please make me happy", "understood"),
        ("Move the mug", "missing: the place"),
        ("x" * 20_000, "at most 400"),
    ],
)
def test_an_invalid_instruction_is_refused_with_a_reason(
    stack: Stack, instruction: str, said: str
) -> None:
    answer = LOOPBACK.post(
        f"http://127.0.0.1:{stack.port}/v1/tasks", json={"instruction": instruction}, timeout=60
    )
    assert 400 <= answer.status_code < 500
    assert re.search(said, answer.json()["detail"], re.IGNORECASE), answer.json()


@pytest.mark.parametrize("name", [s for s in SERVICES if s not in ("world", "bridge")])
def test_a_killed_service_is_restarted_and_the_status_counts_the_restart(
    stack: Stack, name: str
) -> None:
    stack.kill(name)


def test_a_killed_bridge_is_restarted_and_the_world_is_unchanged(stack: Stack) -> None:
    bus = ZenohBus(stack.router)
    try:
        before = bus.call(WORLD_STATE, pb.Empty(), 10)
        stack.kill("bridge")
        after = bus.call(WORLD_STATE, pb.Empty(), 10)
        assert list(after.T_world_base.rows) == pytest.approx(list(before.T_world_base.rows))
        assert after.robot_boot_id == before.robot_boot_id
    finally:
        bus.close()


@pytest.mark.timeout(420)
def test_a_language_task_succeeds_after_the_restarts(stack: Stack) -> None:
    bus = ZenohBus(stack.router)
    try:
        episode = bus.call(TRUTH_EPISODE, pb.Empty(), 10)
        done = subprocess.run(
            [sys.executable, "-m", "helios_client", "task", episode.instruction,
             "--port", str(stack.port), "--json"],
            capture_output=True, text=True, timeout=400, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-2000:]
        task = json.loads(done.stdout)
        assert task["state"] == "succeeded"
        metrics = bus.call(TRUTH_METRICS, pb.Empty(), 10)
        assert metrics.success, metrics
        decisions = stack.get(f"/v1/tasks/{task['id']}/decisions").json()["decisions"]
        assert decisions
        assert all(d["why"] for d in decisions)
        check_answer(stack, "/v1/map/value/pick.png", "image/png")
        check_answer(stack, "/v1/map/value/place.npz", "application/")
        for setting, flips in ("alpha_d=0.001", False), ("alpha_d=0.01", None):
            why = subprocess.run(
                [sys.executable, "-m", "helios_client", "why", task["id"], "--set", setting,
                 "--port", str(stack.port), "--json"],
                capture_output=True, text=True, timeout=60, check=True,
            )  # fmt: skip
            again = [d["recomputed"] for d in json.loads(why.stdout)["decisions"]]
            assert len(again) == len(decisions)
            assert flips is None or not any(r["flips"] for r in again)
    finally:
        bus.close()


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/v1/map/occupancy.png", "image/png"),
        ("/v1/map/occupancy.npz", "application/"),
        ("/v1/map/frontiers", "application/json"),
        ("/v1/objects", "application/json"),
        ("/v1/camera.jpg", "image/jpeg"),
        ("/healthz", "application/json"),
        ("/readyz", "application/json"),
        ("/metrics", "text/plain"),
        ("/openapi.json", "application/json"),
        ("/docs", "text/html"),
        ("/", "text/html"),
    ],
)
def test_every_path_of_the_http_interface_answers(stack: Stack, path: str, kind: str) -> None:
    check_answer(stack, path, kind)


def test_a_task_can_be_cancelled(stack: Stack) -> None:
    base = f"http://127.0.0.1:{stack.port}/v1/tasks"
    task = LOOPBACK.post(base, json={"instruction": "Find the remote"}, timeout=60).json()
    cancelled = LOOPBACK.post(f"{base}/{task['id']}/cancel", timeout=60)
    assert cancelled.status_code == 200
    wait_until(
        lambda: stack.get(f"/v1/tasks/{task['id']}").json()["state"] in ("cancelled", "succeeded"),
        60,
        "the task has ended",
    )


MODULES = {
    "bridge": ["helios_bridge"],
    "detector": ["helios_detector", "--detector", "ground-truth"],
    "objectmap": ["helios_objectmap"],
    "map2d": ["helios_map2d"],
    "planner": ["helios_planner"],
    "gateway": ["helios_gateway"],
    "world": ["helios_sim"],
}


@pytest.mark.parametrize("name", MODULES)
def test_a_service_started_alone_logs_that_it_waits_for_the_router_and_ends_on_sigterm(
    name: str, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    argv = [*MODULES[name], "--router", f"tcp/127.0.0.1:{free_port()}"]
    if name == "gateway":
        argv += ["--port", str(free_port())]
    if name == "planner":
        argv += ["--state-dir", str(tmp_path)]
    with log.open("wb") as out:
        process = subprocess.Popen([sys.executable, "-m", *argv], stderr=out, stdout=out)
    try:
        wait_until(lambda: "waiting for the router" in log.read_text(), 60, "it says so")
        process.terminate()
        assert process.wait(ENDS_WITHIN_S) == 0
    finally:
        process.kill()


def test_services_may_start_in_any_order(tmp_path: Path) -> None:
    router, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    extra = {
        "gateway": ["--port", str(port)],
        "planner": ["--state-dir", str(tmp_path / "tasks")],
        "detector": ["--detector", "ground-truth"],
    }
    started: dict[str, subprocess.Popen[bytes]] = {}

    def start(name: str, *argv: str) -> None:
        with (tmp_path / name).open("wb") as out:
            started[name] = subprocess.Popen([sys.executable, "-m", *argv], stderr=out, stdout=out)

    def waits(name: str) -> bool:
        return "waiting for the router" in (tmp_path / name).read_text()

    try:
        for name, argv in MODULES.items():
            if name != "world":
                start(name, argv[0], "--router", router, *extra.get(name, []))
        for name in list(started):
            wait_until(lambda name=name: waits(name), 60, f"{name} waits")
        start("router", "helios_core.router", "--listen", router)
        start("world", "helios_sim", "--router", router, "--seed", "0")
        wait_until(lambda: is_ready(port), 90, "all services are ready")
    finally:
        for process in started.values():
            process.kill()
            process.wait()


def test_a_missing_model_file_is_named_in_the_log(stack: Stack, tmp_path: Path) -> None:
    log = tmp_path / "log"
    with log.open("wb") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "helios_detector", "--detector", "onnx:/no/such.onnx",
             "--router", stack.router, "--robot", "another"],
            stderr=out, stdout=out,
        )  # fmt: skip
    try:
        wait_until(lambda: "/no/such.onnx" in log.read_text(), 60, "the file is named")
    finally:
        process.kill()
        process.wait()


def test_an_occupied_port_is_reported_with_its_number(stack: Stack, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "helios_client", "up", "--robot", "sim", "--port", str(stack.port),
         "--state", str(tmp_path)],
        capture_output=True, text=True, timeout=30, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert str(stack.port) in done.stderr
