"""Starts and ends `helios up` with a user's own robot for the tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx

from tests.helios_up import Up, helios_up
from tests.support import LOOPBACK, wait_until


class OwnUp(Up):
    """A running `helios up` in which only some services can become ready."""

    def services(self) -> dict[str, dict[str, Any]]:
        """The gateway's services by name; empty while the gateway does not answer."""
        try:
            answer = LOOPBACK.get(f"{self.address}/v1/status", timeout=60)
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
    """Run `helios up`; enters when the `needed` services are ready."""
    flags = ("--robot", robot, "--detector", detector)
    home = {"XDG_STATE_HOME": str(folder / "home")}
    with helios_up(folder / "state", *flags, kind=OwnUp, environment=home) as up:
        wait_until(
            lambda: up.process.poll() is not None or up.are_ready(*needed),
            120,
            f"{' and '.join(needed)} are ready",
        )
        assert up.process.poll() is None, "helios up ended"
        yield up
