"""A router that hangs is replaced, and the services go on without a restart of their own."""

from __future__ import annotations

import os
import signal
from contextlib import closing
from pathlib import Path

import pytest

from tests.stack import Stack
from tests.support import wait_until

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]


def test_a_router_that_passes_nothing_on_is_replaced(tmp_path: Path) -> None:
    with closing(Stack(tmp_path / "state")) as stack:
        wait_until(stack.ready, 120, "the stack is ready")
        hung = stack.pid("router")
        services = {name: stack.pid(name) for name in ("planner", "objectmap", "bridge", "gateway")}
        os.kill(hung, signal.SIGSTOP)

        def replaced() -> bool:
            router = stack.service("router")
            return router["restarts"] == 1 and router["pid"] not in (0, hung)

        wait_until(replaced, 60, "the router is replaced")
        assert "no service was heard over it" in stack.service("router")["reason"]
        wait_until(stack.ready, 60, "the services are back")
        task = stack.post("/v1/tasks", {"instruction": "go home"})["id"]
        wait_until(lambda: stack.task(task)["state"] == "succeeded", 90, "a task succeeded")
        assert {name: stack.pid(name) for name in services} == services
        assert stack.service("router")["restarts"] == 1
