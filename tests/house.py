"""A running `helios up` with the simulated robot, for tests of what happens when a part dies."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
import psutil

from tests.support import LOOPBACK, free_port


class House:
    """A running `helios up` with the simulated robot."""

    def __init__(self, state: Path) -> None:
        self.port, self.router_port, self.state = free_port(), free_port(), state
        self.log = (state / "up.log").open("wb")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "helios_client", "up", "--robot", "sim", "--seed", "1",
             "--detector", "ground-truth", "--port", str(self.port),
             "--router-port", str(self.router_port), "--state", str(state)],
            stdout=self.log, stderr=subprocess.STDOUT, env=os.environ | {"MUJOCO_GL": "egl"},
        )  # fmt: skip

    def get(self, path: str) -> Any:
        answer = LOOPBACK.get(f"http://127.0.0.1:{self.port}{path}", timeout=10)
        answer.raise_for_status()
        return answer.json()

    def post(self, path: str, body: dict | None = None) -> Any:
        answer = LOOPBACK.post(f"http://127.0.0.1:{self.port}{path}", json=body, timeout=10)
        answer.raise_for_status()
        return answer.json()

    def ready(self) -> bool:
        """Whether a task would start. Raises AssertionError where the process has ended."""
        ended = self.process.poll()
        assert ended is None, f"ended with {ended}: {(self.state / 'up.log').read_text()[-2000:]}"
        try:
            return LOOPBACK.get(f"http://127.0.0.1:{self.port}/readyz").status_code == 200
        except httpx.TransportError:
            return False

    def task(self, id: str) -> dict[str, Any]:
        """As it is told while the planner is away, too."""
        try:
            return self.get(f"/v1/tasks/{id}")
        except (httpx.HTTPStatusError, httpx.TransportError):
            return {"state": "unknown", "steps": -1}

    def service(self, name: str) -> dict[str, Any]:
        """How a service is, as `helios status` tells it: state, reason, pid, restarts."""
        status = json.loads((self.state / "supervisor.json").read_text())
        return next(s for s in status["services"] if s["name"] == name)

    def pid(self, name: str) -> int:
        return self.service(name)["pid"]

    def close(self) -> None:
        children = psutil.Process(self.process.pid).children(recursive=True)
        self.process.terminate()
        self.process.wait(15)
        self.log.close()
        for child in children:
            if child.is_running() and child.status() != psutil.STATUS_ZOMBIE:
                child.kill()
