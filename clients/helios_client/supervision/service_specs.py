"""Processes of HELIOS on one machine, and their command lines."""

from __future__ import annotations

import json
import os
import socket
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from helios_core.router_link import RouterLink, router_link

from helios_client.supervision.child_process import ProcessSpec

LOOPBACK = "127.0.0.1"
REMOTE = "remote"  # the robot's driver runs on another machine
TOGETHER = "services"  # process of `helios up --compact` with the services in it
OWN_PROCESS = ("router", "world")  # never in it: others need the router, the world is no service
NEEDED = ("bridge", "detector", "objectmap", "map2d", "planner")  # by a robot, for a task
RECORDED_DETECTOR = "recorded"  # detector that repeats the recorded detections


@dataclass(frozen=True)
class StackOptions:
    """Options of the stack that `helios up` or `helios replay` starts."""

    robot: str  # sim, replay, spot, ros2, bus, push, remote or package:Class
    router_port: int
    state_dir: Path
    name: str = "robot"  # name of the robot in every bus key
    port: int | None = None  # port of the gateway; None: neither gateway nor planner
    seed: int = 0
    preset: str = "demo-v1"
    home: Path | None = None  # plan of the simulated home, instead of a preset
    level: str | None = None  # level of the plan; None: the one with the most rooms
    home_name: str = ""  # name of the plan with a digest of its content
    furniture: str | None = None  # kind of furniture in the home; None: the simulator's setting
    detector: str = "simulated"
    scorer: str | None = None  # None: the detector's setting
    agent: str | None = None  # of planner and object map; None: their settings
    noise: str | None = None  # noise table of the simulated detector; None: the detector's setting
    max_steps: int | None = None  # most actions of a task; None: the planner's setting
    robot_host: str | None = None  # address of a robot on the network; None: its driver's setting
    source: Path | None = None  # recording or data set that a replay plays
    limit: int = 0  # number of frames to replay; 0: all
    from_s: float | None = None  # start of a replay, seconds into the recording; None: its start
    to_s: float | None = None  # end of a replay, seconds into the recording; None: its end
    rate: float | None = None  # speed of a replay; 1: as recorded; None: without waiting
    topics: str | None = None  # topic names in a ROS bag
    contexts: bool = False  # a replay starts the recorded searches itself
    strict: bool = False  # a replay ends at an unreadable frame
    record: Path | None = None  # folder for recordings; None: no recorder
    ros2_python: str | None = None  # interpreter with rclpy; None: no process uses ROS
    ros2_node: str | None = None  # None: that of the settings
    ros2_output: bool = False  # publish maps, objects and tasks to ROS
    lockstep: bool = False
    ack_timeout_s: float | None = None  # timeout of the bridge in lockstep; None: its setting
    certs: Path | None = None  # folder of `helios certs`; None: the bus is not encrypted
    router_host: str = LOOPBACK  # address that the router listens on
    compact: bool = False  # all services in one process
    tracing: bool = False  # every service records spans
    log_format: str | None = None  # text or json; None: the services' setting
    services: frozenset[str] | None = None  # services of this machine; None: all
    router_at: str = ""  # endpoint of a router elsewhere; empty: it runs here

    @property
    def router(self) -> str:
        """Endpoint of the router for the services of this machine."""
        return self.router_at or self._endpoint(LOOPBACK)

    @property
    def listen(self) -> str:
        """Endpoint that the router listens on."""
        host = self.router_host
        return self._endpoint(f"[{host}]" if ":" in host else host)

    def link(self, service: str, robot: str = "") -> RouterLink:
        """Connection of a robot's service to the router. Raises InvalidInput without its
        certificate."""
        return router_link(self.router, self.certs, service, robot or self.name)

    @property
    def robot_names(self) -> tuple[str, ...]:
        """Names of the robots on the bus."""
        return (self.name,)

    def elsewhere(self) -> tuple[str, ...]:
        """Needed services that other machines run."""
        return tuple(name for name in NEEDED if self._is_elsewhere(name))

    def _is_elsewhere(self, service: str) -> bool:
        if self.services is not None and service not in self.services:
            return True
        return service == "bridge" and self.robot == REMOTE

    def _endpoint(self, host: str) -> str:
        return f"{'tcp' if self.certs is None else 'tls'}/{host}:{self.router_port}"

    @property
    def address(self) -> str:
        """URL of the dashboard and the HTTP interface."""
        return f"http://{LOOPBACK}:{self.port}"

    @property
    def log_dir(self) -> Path:
        return self.state_dir / "logs"

    def processes(self) -> tuple[ProcessSpec, ...]:
        """Processes, in the order of the process table; they may start in any order."""
        here = tuple(s for s in self._apart() if self.services is None or s.name in self.services)
        return together(here) if self.compact else here

    def _apart(self) -> tuple[ProcessSpec, ...]:
        """Processes of all services, with one service each."""
        out = [
            ProcessSpec(
                "router",
                _python("helios_core.router", "--listen", self.listen, *self._certs()),
                ends_last=True,
            )
        ]
        if self.robot == "sim":
            out.append(
                self._service(
                    "world",
                    "helios_sim",
                    seed=self.seed,
                    preset=self.preset,
                    home=self.home,
                    level=self.level,
                    furniture=self.furniture,
                )
            )
        if self.robot != REMOTE:
            out.append(self._bridge())
        out.append(self._detecting())
        kept = self.state_dir if self.port is not None else None  # a replay starts with empty maps
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
            out += self._planning(self.port)
        if self.record is not None:
            out.append(self._service("recorder", "helios_recorder", out=self.record))
        if self.ros2_output:
            flags = {"python": self.ros2_python, "node": self.ros2_node}
            out.append(self._service("ros2", "helios_ros2", **flags))
        return tuple(out)

    def _detecting(self) -> ProcessSpec:
        if self.detector == RECORDED_DETECTOR:
            return self._service("detector", "helios_replay", source=self.source)
        return self._service(
            "detector",
            "helios_detector",
            detector=self.detector,
            scorer=self.scorer,
            noise=self.noise,
            noise_seed=self._noise_seed(),
        )

    def _planning(self, port: int) -> tuple[ProcessSpec, ProcessSpec]:
        """Planner, and gateway at a port."""
        planner = self._service(
            "planner",
            "helios_planner",
            state_dir=self._tasks_dir(),
            agent=self.agent,
            max_steps=self.max_steps,
        )
        gateway = self._service(
            "gateway",
            "helios_gateway",
            port=port,
            audit=self.state_dir / "audit.jsonl",
            faults=self.state_dir / "faults",
            fleet_queue=self.state_dir / "fleet.sqlite",
        )
        return planner, gateway

    def _noise_seed(self) -> int | None:
        """Seed of the simulated detector's errors: that of the home, unless the environment sets
        another. Names of objects repeat across homes, so each home needs errors of its own."""
        if self.robot != "sim" or "HELIOS_DETECTOR_NOISE_SEED" in os.environ:
            return None
        return self.seed or None

    def _bridge(self) -> ProcessSpec:
        return self._service(
            "bridge", "helios_bridge", driver=self.robot, address=self.robot_host,
            source=self.source, limit=self.limit or None, from_s=self.from_s, to_s=self.to_s,
            rate=self.rate, topics=self.topics,
            contexts=(self.contexts or self.detector == RECORDED_DETECTOR) or None,
            strict=self.strict or None, lockstep=self.lockstep or None,
            ack_timeout_s=self.ack_timeout_s, state_dir=self._stop_dir(),
            python=self.ros2_python if self.robot == "ros2" else None,
        )  # fmt: skip

    def _certs(self) -> tuple[str, ...]:
        return () if self.certs is None else ("--certs", str(self.certs))

    def _tasks_dir(self) -> Path:
        """State folder of the planner. Each simulated home has its own, as the tasks of one home
        mean nothing in another."""
        tasks = self.state_dir / "planner"
        if self.robot != "sim":
            return tasks
        home = self.home_name or self.preset
        return tasks / f"sim-{home}-{self.seed}".replace("/", "_")  # `helios_sim` refuses it

    def _stop_dir(self) -> Path | None:
        """State folder of the bridge. A simulated robot keeps its stop itself, and ends with it."""
        return None if self.port is None or self.robot == "sim" else self.state_dir / "bridge"

    def _service(
        self, name: str, module: str, python: str | None = None, **flags: object
    ) -> ProcessSpec:
        argv = ["--router", self.router, "--robot", self.name, *self._certs()]
        flags |= {"tracing": self.tracing or None, "log_format": self.log_format}
        for flag, value in flags.items():
            if value is True:
                argv.append(f"--{flag.replace('_', '-')}")
            elif value is not None:
                argv += [f"--{flag.replace('_', '-')}", str(value)]
        return ProcessSpec(name, _python(module, *argv, python=python))


def together(apart: Sequence[ProcessSpec]) -> tuple[ProcessSpec, ...]:
    """The same services with one process for all that can share it.

    The router and the simulated world keep their own, as do services with another interpreter.
    """
    of_all = (sys.executable, "-m")
    hosted = [s for s in apart if s.name not in OWN_PROCESS and s.argv[:2] == of_all]
    command_lines = json.dumps([spec.argv[2:] for spec in hosted])
    one = ProcessSpec(
        TOGETHER,
        _python("helios_core.compact_process", command_lines),
        hosts=tuple(spec.name for spec in hosted),
    )
    return (*(spec for spec in apart if spec not in hosted), one)


def _python(module: str, *args: str, python: str | None = None) -> tuple[str, ...]:
    """Command line of a module; python: its interpreter, None for this one."""
    return (python or sys.executable, "-m", module, *args)


def free_port(apart_from: int | None = None) -> int:
    """TCP port on loopback, not `apart_from`, that was free at the time of the call."""
    while True:
        with socket.socket() as s:
            s.bind((LOOPBACK, 0))
            port = int(s.getsockname()[1])
        if port != apart_from:
            return port


def port_bind_error(port: int, host: str = LOOPBACK) -> OSError | None:
    """Error of listening on a port of an address of this machine, for example a port in use; None
    if it is free."""
    try:
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as s:
            s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as servers do
            s.bind((host, port))
    except OSError as error:
        return error
    return None
