"""The lesson docs/tutorials/fleet.md on two machines: two network namespaces with a cable between.

Needs root and `ip` of iproute2; skipped elsewhere. The machines share no address, and the bus is
encrypted.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.support import wait_until

pytestmark = pytest.mark.slow

SERVER, BASE = "10.77.7.2", "10.77.7.3"
READY_S = 400.0  # the first start compiles kernels
ROBOT = "helios_examples.room_robot:RoomRobot"
OF_A_ROBOT = ("bridge", "objectmap", "map2d", "planner", "supervisor")


class Machine:
    """A network namespace with one address, and a folder of its own."""

    def __init__(self, name: str, folder: Path, running: ExitStack) -> None:
        self.name, self.folder, self._running = name, folder, running
        folder.mkdir(parents=True)
        run("ip", "netns", "add", name)
        running.callback(run, "ip", "netns", "del", name)

    def up(self, *flags: str) -> subprocess.Popen[bytes]:
        """Start `helios up` here; it ends with the test."""
        log = self._running.enter_context((self.folder / f"up{len(flags)}.log").open("ab"))
        process = subprocess.Popen(
            self._command("up", *flags),
            cwd=self.folder,
            env=self._environment(),
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        self._running.callback(end, process)
        return process

    def helios(self, *args: str) -> str:
        done = subprocess.run(
            self._command(*args),
            cwd=self.folder,
            env=self._environment(),
            capture_output=True,
            text=True,
            timeout=READY_S,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def fleet(self) -> dict[str, Any]:
        try:
            return json.loads(self.helios("fleet", "--json"))
        except AssertionError:  # the gateway is starting
            return {"robots": [], "tasks": []}

    def _command(self, *args: str) -> list[str]:
        return ["ip", "netns", "exec", self.name, sys.executable, "-m", "helios_client", *args]

    def _environment(self) -> dict[str, str]:
        paths = os.pathsep.join(str(Path(p).resolve()) for p in sys.path if p)
        return os.environ | {"XDG_STATE_HOME": str(self.folder / "state"), "PYTHONPATH": paths}


def run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True)


def end(process: subprocess.Popen[bytes]) -> None:
    everyone = family(process)
    for one in everyone:
        one.send_signal(signal.SIGCONT)
    process.terminate()
    process.wait(30)
    for one in everyone:
        if one.is_running():
            one.kill()


def family(process: subprocess.Popen[bytes]) -> list[psutil.Process]:
    parent = psutil.Process(process.pid)
    return [*parent.children(recursive=True), parent]


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[tuple[Machine, Machine]]:
    if os.geteuid() != 0 or shutil.which("ip") is None:
        pytest.skip("network namespaces need root and ip of iproute2")
    mark = os.getpid()
    with ExitStack() as running:
        try:
            server = Machine(f"server-{mark}", tmp_path / "server", running)
        except subprocess.CalledProcessError as error:
            pytest.skip(f"no network namespace can be made here: {error.stderr.decode()}")
        base = Machine(f"base-{mark}", tmp_path / "base", running)
        ends = (f"s{mark}", f"b{mark}")
        run("ip", "link", "add", ends[0], "type", "veth", "peer", "name", ends[1])
        for machine, link, address in zip((server, base), ends, (SERVER, BASE), strict=True):
            run("ip", "link", "set", link, "netns", machine.name)
            run("ip", "-n", machine.name, "addr", "add", f"{address}/24", "dev", link)
            for name in (link, "lo"):
                run("ip", "-n", machine.name, "link", "set", name, "up")
        yield server, base


def start(server: Machine, base: Machine) -> dict[str, subprocess.Popen[bytes]]:
    """Start the lesson's server and its two robots. Returns the robots."""
    server.helios("certs", "init", "certs", "--hosts", SERVER, "--robots", "kitchen,hall",
                  "--shared", "detector,gateway")  # fmt: skip
    sessions = base.folder / "certs/sessions"
    sessions.mkdir(parents=True, mode=0o700)
    for service in OF_A_ROBOT:
        for file in (server.folder / "certs/sessions").glob(f"{service}.*.json5"):
            shutil.copy2(file, sessions)
    server.up("--robot", "remote", "--robots", "kitchen,hall", "--services",
              "router,detector,gateway", "--detector", "paint", "--certs", "certs",
              "--router-host", "0.0.0.0")  # fmt: skip
    common = ("--robot", ROBOT, "--router", SERVER, "--certs", "certs", "--services",
              "bridge,objectmap,map2d,planner")  # fmt: skip
    return {
        "kitchen": base.up(*common, "--name", "kitchen"),
        "hall": base.up(*common, "--name", "hall", "--port", "8081"),
    }


def test_two_robots_on_another_machine_share_a_queue(machines: tuple[Machine, Machine]) -> None:
    server, base = machines
    robots = start(server, base)
    wait_until(
        lambda: [r["state"] for r in server.fleet()["robots"]] == ["idle", "idle"],
        READY_S,
        "both robots are idle",
    )
    found = json.loads(server.helios("task", "find the box", "--robot", "any", "--json"))
    assert found["state"] == "succeeded"
    again = json.loads(server.helios("task", "find the box", "--robot", "any", "--json"))
    assert again["robot"] == found["robot"]
    assert "map had the box" in again["why"]
    for _ in range(3):
        server.helios("task", "explore the home", "--robot", "any", "--no-wait")
    wait_until(lambda: sum(t["begun"] for t in server.fleet()["tasks"]) == 2, 60, "two have begun")
    for process in family(robots["kitchen"]):
        process.send_signal(signal.SIGSTOP)

    def tasks_of(robot: str) -> list[dict[str, Any]]:
        listed = json.loads(server.helios("tasks", "--robot", "any", "--json"))["tasks"]
        return [t for t in listed if t["robot"] == robot and t["instruction"].startswith("explore")]

    wait_until(lambda: len(tasks_of("hall")) == 2, 200, "the other robot has the waiting task")
    [kept] = tasks_of("kitchen")
    assert "is away; the task stays with it" in kept["message"]
