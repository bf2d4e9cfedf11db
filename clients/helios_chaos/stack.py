"""A running `helios up` behind relays: its processes, its links, its state folder and its clock."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil
from helios_client.sdk import Helios
from helios_client.supervision.fork_server import NAME as FORK_SERVER
from helios_client.supervision.service_specs import free_port
from helios_core.errors import HeliosError, Unavailable
from helios_core.zenoh_bus import ZenohBus

from helios_chaos.isolation import Abilities, mount_small_disk
from helios_chaos.relay import Relay
from helios_chaos.schedule import LINKS
from helios_chaos.wall_clock import WallClock

READY_WITHIN_S = 240.0
ENDS_WITHIN_S = 30.0
DISK_MB = 96
MARK = "HELIOS_CHAOS_MARK"  # in the environment of every process of a run
PACE = "1"  # drives take as long as on a real robot
MODULES = {
    "router": "helios_core.router",
    "world": "helios_sim",
    "bridge": "helios_bridge",
    "detector": "helios_detector",
    "objectmap": "helios_objectmap",
    "map2d": "helios_map2d",
    "planner": "helios_planner",
    "gateway": "helios_gateway",
}


@dataclass(frozen=True)
class StackPlan:
    """How to start the stack. environment: further variables of its services."""

    out: Path  # folder of state and logs
    seed: int = 0
    preset: str = "demo-v1"
    detector: str = "ground-truth"
    clock: bool = False  # the wall clock can jump
    small_disk: bool = False
    own_memory: bool = False
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def forked(self) -> bool:
        """Services share what they import, as with `helios up`."""
        return not (self.own_memory or self.clock)


class Stack:
    """A running stack. Create it with `running_stack`."""

    def __init__(
        self,
        plan: StackPlan,
        process: subprocess.Popen[bytes],
        port: int,
        router_port: int,
        links: dict[str, Relay],
        clock: WallClock | None,
    ) -> None:
        self.plan, self.process, self.port, self.links = plan, process, port, links
        self.state_dir = plan.out / "state"
        self.router = f"tcp/127.0.0.1:{router_port}"
        self.clock = clock

    def client(self, timeout_s: float = 10.0) -> Helios:
        return Helios(f"http://127.0.0.1:{self.port}", timeout_s)

    def pid(self, name: str) -> int:
        """Process id of a service, the `supervisor` or the `fork server`; 0 if it does not run."""
        if name == "supervisor":
            return self.process.pid
        module = FORK_SERVER if name == "fork server" else MODULES[name]
        with suppress(psutil.Error):
            for child in psutil.Process(self.process.pid).children():
                with suppress(psutil.Error):  # a forked service has one text as its command line
                    if module in " ".join(child.cmdline()).split():
                        return child.pid
        return 0

    def wait_ready(self, within_s: float = READY_WITHIN_S) -> None:
        """Wait until a task can be done. Raises Unavailable after the limit, or if it ends."""
        deadline_s = time.monotonic() + within_s
        with self.client() as helios:
            while not _ready(helios):
                log = (self.plan.out / "up.log").read_text(errors="replace")[-600:]
                if self.process.poll() is not None:
                    raise Unavailable(f"helios up ended: {log}")
                if time.monotonic() > deadline_s:
                    raise Unavailable(f"HELIOS was not ready within {within_s:g} s: {log}")
                time.sleep(0.2)


@contextmanager
def running_stack(plan: StackPlan) -> Iterator[tuple[Stack, list[int]]]:
    """Start the stack, and end it after the block.

    Yields the stack and a list, which holds the ids of the processes that it left behind once the
    block has ended. They are killed.
    """
    plan.out.mkdir(parents=True, exist_ok=True)
    port, router_port, mark = free_port(), free_port(), uuid.uuid4().hex
    state = plan.out / "state"
    if plan.small_disk:
        mount_small_disk(state, DISK_MB)
    links = {name: Relay(("127.0.0.1", router_port), plan.seed + n) for n, name in enumerate(LINKS)}
    options = {
        "robot": "sim",
        "router_port": router_port,
        "state_dir": str(state),
        "port": port,
        "seed": plan.seed,
        "preset": plan.preset,
        "detector": plan.detector,
        "links": {name: relay.port for name, relay in links.items()},
        "own_memory": plan.own_memory,
        "forked": plan.forked,
    }
    environment = os.environ | {MARK: mark, "HELIOS_WORLD_PACE": PACE} | plan.environment
    clock = WallClock(plan.out / "clock") if plan.clock else None
    if clock is not None:
        environment |= clock.environment
    argv = [sys.executable, "-m", "helios_chaos.relayed_up", json.dumps(options)]
    left: list[int] = []
    log = (plan.out / "up.log").open("wb")
    process = subprocess.Popen(argv, stdout=log, stderr=subprocess.STDOUT, env=environment)
    try:
        yield Stack(plan, process, port, router_port, links, clock), left
    finally:
        _end(process, mark, left)
        for relay in links.values():
            relay.close()
        log.close()


def open_bus(router: str, within_s: float = 60.0) -> ZenohBus:
    """Bus directly at the router. Raises Unavailable after the limit."""
    deadline_s = time.monotonic() + within_s
    while True:
        try:
            return ZenohBus(router)
        except Unavailable:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(0.1)


def _ready(helios: Helios) -> bool:
    try:
        return helios.ready()
    except HeliosError:
        return False


def _end(process: subprocess.Popen[bytes], mark: str, left: list[int]) -> None:
    for one in _marked(mark):  # a frozen service could not end
        with suppress(psutil.Error):
            one.send_signal(signal.SIGCONT)
    process.terminate()
    with suppress(subprocess.TimeoutExpired):
        process.wait(ENDS_WITHIN_S)
    orphans = _marked(mark)
    left += [one.pid for one in orphans]
    for one in orphans:
        with suppress(psutil.Error):
            one.kill()
    process.wait()


def _marked(mark: str) -> list[psutil.Process]:
    return [p for p in psutil.process_iter() if _environment(p).get(MARK) == mark]


def _environment(process: psutil.Process) -> dict[str, str]:
    try:
        return process.environ()
    except (psutil.Error, OSError):  # it has ended, or belongs to another user
        return {}


def plan_for(able: Abilities, out: Path, seed: int) -> StackPlan:
    """Plan that uses all abilities of this run."""
    return StackPlan(
        out,
        seed,
        clock="clock" not in able.skipped,
        small_disk=able.isolated,
        own_memory=able.isolated,
    )
