"""`helios up` with a robot of one's own, as its tests start and end it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from tests.support import LOOPBACK, free_port, wait_until


@dataclass(frozen=True)
class Up:
    """A running `helios up`."""

    port: int
    router: str

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def services(self) -> dict[str, dict[str, Any]]:
        """By name, as the gateway tells them; empty while it cannot be asked."""
        try:
            answer = LOOPBACK.get(f"{self.address}/v1/status", timeout=10)
            return {s["name"]: s for s in answer.json()["services"]}
        except (httpx.TransportError, KeyError, ValueError):
            return {}

    def ready(self, *names: str) -> bool:
        services = self.services()
        return all(services.get(name, {}).get("state") == "ready" for name in names)


@contextmanager
def helios_up(
    folder: Path,
    robot: str,
    needed: tuple[str, ...] = ("bridge", "map2d"),
    detector: str = "ground-truth",
) -> Iterator[Up]:
    """Until these are ready. Ends it, and shows its output where the test failed."""
    port, router_port = free_port(), free_port()
    log = folder / "up.log"
    with log.open("wb") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "helios_client", "up", "--robot", robot,
             "--detector", detector, "--port", str(port), "--router-port", str(router_port),
             "--state", str(folder / "state")],
            stdout=out, stderr=subprocess.STDOUT,
            env=os.environ | {"XDG_STATE_HOME": str(folder / "home")},
        )  # fmt: skip
    up = Up(port, f"tcp/127.0.0.1:{router_port}")
    try:
        wait_until(
            lambda: process.poll() is not None or up.ready(*needed),
            120, f"{' and '.join(needed)} are ready",
        )  # fmt: skip
        assert process.poll() is None, "helios up ended"
        yield up
    except BaseException:
        print(log.read_text())
        raise
    finally:
        process.terminate()
        try:
            process.wait(20)
        finally:
            process.kill()
