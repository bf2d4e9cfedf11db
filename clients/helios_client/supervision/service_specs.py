"""Which processes make up HELIOS on one machine, and how each is called."""

from __future__ import annotations

import socket
import sys
from dataclasses import dataclass
from pathlib import Path

from helios_client.supervision.child_process import ProcessSpec

LOOPBACK = "127.0.0.1"
RECORDED = "recorded"  # the detector that finds what was found when it was recorded


@dataclass(frozen=True)
class ServiceSpecs:
    """What `helios up` and `helios replay` start."""

    robot: str  # sim, replay, spot, bus, push or package:Class
    router_port: int
    state_dir: Path
    name: str = "robot"  # first part of every key on the bus
    port: int | None = None  # of the gateway; None: neither gateway nor planner
    seed: int = 0
    preset: str = "demo-v1"
    furniture: str | None = None  # of the simulated home; None: its setting
    detector: str = "simulated"
    scorer: str | None = None  # None: its setting
    agent: str | None = (
        None  # who decides, with the settings its house runs with; None: its setting
    )
    robot_host: str | None = None  # of a robot on the network; None: its own settings
    source: Path | None = None  # what a replay plays
    limit: int = 0  # frames of a replay; 0: all
    from_s: float | None = None  # where a replay begins, seconds into it; None: its start
    to_s: float | None = None  # where it ends; None: its end
    rate: float | None = None  # of a replay: 1 as it was recorded; None: without waiting
    topics: str | None = None  # of a ROS bag
    contexts: bool = False  # a replay begins the recorded searches by itself
    strict: bool = False  # a replay ends at a frame that cannot be read
    record: Path | None = None  # folder of recordings; None: no recorder
    lockstep: bool = False
    ack_timeout_s: float | None = None  # of the bridge in lockstep; None: its setting

    @property
    def router(self) -> str:
        """Endpoint of the router."""
        return f"tcp/{LOOPBACK}:{self.router_port}"

    @property
    def address(self) -> str:
        """Of the dashboard and the HTTP interface."""
        return f"http://{LOOPBACK}:{self.port}"

    @property
    def log_dir(self) -> Path:
        return self.state_dir / "logs"

    def specs(self) -> tuple[ProcessSpec, ...]:
        """The processes; the order is that of the table, starting needs none."""
        out = [
            ProcessSpec(
                "router", _python("helios_core.router", "--listen", self.router), ends_last=True
            )
        ]
        if self.robot == "sim":
            out.append(
                self._service(
                    "world", "helios_sim", seed=self.seed, preset=self.preset,
                    furniture=self.furniture,
                )
            )  # fmt: skip
        out.append(
            self._service(
                "bridge", "helios_bridge", driver=self.robot, address=self.robot_host,
                source=self.source,
                limit=self.limit or None, from_s=self.from_s, to_s=self.to_s, rate=self.rate,
                topics=self.topics, contexts=(self.contexts or self.detector == RECORDED) or None,
                strict=self.strict or None, lockstep=self.lockstep or None,
                ack_timeout_s=self.ack_timeout_s,
            )
        )  # fmt: skip
        if self.detector == RECORDED:
            out.append(self._service("detector", "helios_replay", source=self.source))
        else:
            out.append(
                self._service(
                    "detector", "helios_detector", detector=self.detector, scorer=self.scorer
                )
            )
        kept = self.state_dir if self.port is not None else None  # a replay starts from nothing
        out.append(
            self._service(
                "objectmap",
                "helios_objectmap",
                state_dir=kept and kept / "objectmap",
                agent=self.agent,
            )
        )
        out.append(self._service("map2d", "helios_map2d", state_dir=kept and kept / "map2d"))
        if self.port is not None:
            out.append(
                self._service(
                    "planner",
                    "helios_planner",
                    state_dir=self._tasks_dir(),
                    agent=self.agent,
                )
            )
            out.append(self._service("gateway", "helios_gateway", port=self.port))
        if self.record is not None:
            out.append(self._service("recorder", "helios_recorder", out=self.record))
        return tuple(out)

    def _tasks_dir(self) -> Path:
        """Of the planner: each simulated home has one, for what was asked in another means nothing
        in it."""
        tasks = self.state_dir / "planner"
        if self.robot != "sim":
            return tasks
        return tasks / f"sim-{self.preset}-{self.seed}".replace("/", "_")  # the world refuses it

    def _service(self, name: str, module: str, **flags: object) -> ProcessSpec:
        argv = ["--router", self.router, "--robot", self.name]
        for flag, value in flags.items():
            if value is True:
                argv.append(f"--{flag.replace('_', '-')}")
            elif value is not None:
                argv += [f"--{flag.replace('_', '-')}", str(value)]
        return ProcessSpec(name, _python(module, *argv))


def _python(module: str, *args: str) -> tuple[str, ...]:
    return (sys.executable, "-m", module, *args)


def free_port() -> int:
    """A TCP port on loopback that was free a moment ago."""
    with socket.socket() as s:
        s.bind((LOOPBACK, 0))
        return int(s.getsockname()[1])


def port_trouble(port: int) -> OSError | None:
    """Why nothing can listen there, such as another program that does; None where it can."""
    with socket.socket() as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as servers do
        try:
            s.bind((LOOPBACK, port))
        except OSError as error:
            return error
    return None
