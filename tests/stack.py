"""Run `helios up` with the simulated robot, for tests in which a service dies."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx

from tests.helios_up import helios_up
from tests.support import LOOPBACK

FLAGS = ("--robot", "sim", "--seed", "1", "--detector", "ground-truth")


class Stack:
    """A running `helios up` with the simulated robot. Call `close` at the end."""

    def __init__(self, state: Path, *flags: str) -> None:
        self._running = ExitStack()
        self._up = self._running.enter_context(helios_up(state, *FLAGS, *flags))
        self.router_port, self.state = self._up.router_port, state
        self.ready, self.address = self._up.ready, self._up.address

    def get(self, path: str) -> Any:
        answer = LOOPBACK.get(f"{self._up.address}{path}", timeout=10)
        answer.raise_for_status()
        return answer.json()

    def post(self, path: str, body: dict | None = None) -> Any:
        answer = LOOPBACK.post(f"{self._up.address}{path}", json=body, timeout=10)
        answer.raise_for_status()
        return answer.json()

    def task(self, id: str) -> dict[str, Any]:
        """Return the task; its state is `unknown` while the planner does not answer."""
        try:
            return self.get(f"/v1/tasks/{id}")
        except (httpx.HTTPStatusError, httpx.TransportError):
            return {"state": "unknown", "steps": -1}

    def service(self, name: str) -> dict[str, Any]:
        """Return a service's entry in `helios status`: state, reason, pid, restarts."""
        status = json.loads((self.state / "supervisor.json").read_text())
        return next(s for s in status["services"] if s["name"] == name)

    def pid(self, name: str) -> int:
        return self.service(name)["pid"]

    def close(self) -> None:
        self._running.close()
