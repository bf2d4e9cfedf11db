"""A router and single services as separate processes on a free port, for tests of one service."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from helios_client.supervision.child_process import ChildProcess, ProcessSpec
from helios_client.supervision.service_specs import free_port
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import Unavailable
from helios_core.topics import status_topic
from helios_core.zenoh_bus import ZenohBus

START_WITHIN_S = 120.0
# reasons of a service that is still starting
STARTING_REASONS = ("loading", "opening", "compiling", "starting", "warming")


class ServiceProcess:
    """`python -m helios_<name>` and a router as child processes, plus services started by `add`.

    `close` ends them all.
    """

    def __init__(self, name: str, arguments: tuple[str, ...], folder: Path) -> None:
        """arguments: for the service, besides the router's address. folder: for the logs."""
        self.name = name
        self.router = f"tcp/127.0.0.1:{free_port()}"
        self._folder = folder
        self._children = {
            "router": self._start("router", "helios_core.router", "--listen", self.router)
        }
        self.add(name, arguments)

    def add(self, name: str, arguments: tuple[str, ...] = ()) -> None:
        """Start one more service on the same router."""
        module = f"helios_{name}"
        self._children[name] = self._start(name, module, "--router", self.router, *arguments)

    def bus(self) -> Bus:
        """A bus on the router. Raises Unavailable if the router does not start in time."""
        deadline = time.monotonic() + START_WITHIN_S
        while True:
            try:
                return ZenohBus(self.router)
            except Unavailable:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.2)

    def ready(self, bus: Bus, name: str = "") -> int:
        """Wait until the service (or the added service `name`) is ready; return its process id.

        Raises Unavailable with the service's own reason.
        """
        name = name or self.name
        said: list[pb.ServiceStatus] = []
        bus.subscribe(status_topic(name), said.append)
        deadline = time.monotonic() + START_WITHIN_S
        while time.monotonic() < deadline:
            if said and said[-1].state == "ready":
                return said[-1].pid
            ending = self._children[name].poll_exit()
            if ending is not None or (said and _cannot_get_ready(said[-1])):
                raise Unavailable(f"{name}: {ending.reason if ending else said[-1].reason}")
            time.sleep(0.1)
        reason = said[-1].reason if said else "it has said nothing"
        raise Unavailable(f"{name} was not ready in {START_WITHIN_S:g} s: {reason}")

    def close(self) -> None:
        for child in reversed(self._children.values()):
            child.terminate()
            if not child.wait(5):
                child.kill()

    def _start(self, name: str, module: str, *argv: str) -> ChildProcess:
        spec = ProcessSpec(name, (sys.executable, "-m", module, *argv))
        return ChildProcess(spec, self._folder / f"{name}.log")


def _cannot_get_ready(status: pb.ServiceStatus) -> bool:
    """True if the service cannot get ready by itself, as when its model is missing or wrong."""
    begins = status.reason.startswith(STARTING_REASONS)
    return status.state == "degraded" or (status.state == "waiting" and not begins)
