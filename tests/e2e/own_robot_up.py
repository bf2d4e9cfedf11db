"""`helios up` with a robot of one's own, as its tests start and end it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx

from tests.helios_up import Up, helios_up
from tests.support import LOOPBACK, wait_until


class OwnUp(Up):
    """A running `helios up`, of which only some services can be ready."""

    def services(self) -> dict[str, dict[str, Any]]:
        """By name, as the gateway tells them; empty while it cannot be asked."""
        try:
            answer = LOOPBACK.get(f"{self.address}/v1/status", timeout=10)
            return {s["name"]: s for s in answer.json()["services"]}
        except (httpx.TransportError, KeyError, ValueError):
            return {}

    def are_ready(self, *names: str) -> bool:
        services = self.services()
        return all(services.get(name, {}).get("state") == "ready" for name in names)


@contextmanager
def own_robot_up(
    folder: Path,
    robot: str,
    needed: tuple[str, ...] = ("bridge", "map2d"),
    detector: str = "ground-truth",
) -> Iterator[OwnUp]:
    """Until these are ready."""
    flags = ("--robot", robot, "--detector", detector)
    home = {"XDG_STATE_HOME": str(folder / "home")}
    with helios_up(folder / "state", *flags, kind=OwnUp, environment=home) as up:
        wait_until(
            lambda: up.process.poll() is not None or up.are_ready(*needed),
            120, f"{' and '.join(needed)} are ready",
        )  # fmt: skip
        assert up.process.poll() is None, "helios up ended"
        yield up
