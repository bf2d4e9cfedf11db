"""Study of a fleet: what one more simulated robot costs, and what ends first.

    python -m helios_eval.studies.fleet --robots 1,2,4 --out runs/fleet

For each number it starts `helios up --robot sim --robots N` with robots at the speed of real ones,
measures them at rest, then gives every robot a task to explore, through the fleet's queue, and
measures again. Processor time per step and memory depend little on what else the machine does;
steps per second depend on it much. PSS counts a page that several processes share in equal parts.
Linux only.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
import zenoh
from helios_client.sdk import Helios
from helios_client.supervision import state_file
from helios_client.supervision.service_specs import free_port
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.zenoh_config import client_config

from helios_eval.provenance import commit, machine

READY_WITHIN_S = 1200.0
BEGUN_WITHIN_S = 120.0
POLL_S = 0.2
TASK = "explore the home"
SHARED = ("router", "gateway", "supervisor")
WORLD = "world"  # only a simulated robot has it
NETWORK_MB_S = 110.0  # what a link of 1 Gbit/s carries
KEPT = 0.8  # share of the fastest fleet's steps per second that a fleet without congestion keeps
COPIES = 3  # of a message on the link of a router whose clients are all elsewhere: one in, two out
ROWS = {
    "ready after, s": "ready_s",
    "load of the machine": "load",
    "steps per second": "steps_per_s",
    "services, ms of a core per step": "services_ms_per_step",
    "simulated world, ms per step": "world_ms_per_step",
    "gateway, ms per step": "gateway_ms_per_step",
    "router, ms per step": "router_ms_per_step",
    "published, kB per step": "published_kb_per_step",
    "services at rest, cores": "idle_services_cores",
    "shared at rest, cores (all robots)": "idle_shared_cores",
    "services, MB": "services_pss_mb",
    "simulated world, MB": "world_pss_mb",
    "shared, MB (all robots)": "shared_pss_mb",
}


@dataclass(frozen=True)
class Reading:
    """Counters of one moment: processor seconds and PSS (MB) by row, and steps of all tasks."""

    at_s: float
    cpu_s: dict[str, float]
    pss_mb: dict[str, float]
    steps: int


@dataclass(frozen=True)
class Cost:
    """What a fleet of this size used. Per robot, unless the name says otherwise.

    Services: those of a real robot, without the simulated world. Shared: router, gateway and
    supervisor together. cores: processor seconds per second.
    """

    robots: int
    ready_s: float
    load: float  # processes that wanted to run on this machine, mean of the last minute
    steps_per_s: float
    services_ms_per_step: float
    world_ms_per_step: float
    gateway_ms_per_step: float
    router_ms_per_step: float
    published_kb_per_step: float  # messages on the robots' topics, each counted once
    idle_services_cores: float
    idle_shared_cores: float  # of the whole fleet
    services_pss_mb: float
    world_pss_mb: float
    shared_pss_mb: float  # of the whole fleet


Span = tuple[Reading, Reading]


def cost(robots: int, ready_s: float, rest: Span, work: Span, published_kb_per_step: float) -> Cost:
    """Cost of a fleet from the counters before and after a time of rest and one of work. Raises
    Unavailable if no robot made a step."""
    steps = work[1].steps - work[0].steps
    if steps <= 0:
        raise Unavailable(f"{robots} robots made no step in the time of work; give more --seconds")

    def used_s(span: Span, *kinds: str) -> float:
        before, after = span[0].cpu_s, span[1].cpu_s
        return sum(after[r] - before.get(r, 0.0) for r in after if kind_of(r) in kinds)

    def held_mb(*kinds: str) -> float:
        return sum(mb for row, mb in work[1].pss_mb.items() if kind_of(row) in kinds)

    rest_s, work_s = rest[1].at_s - rest[0].at_s, work[1].at_s - work[0].at_s
    return Cost(
        robots=robots,
        ready_s=ready_s,
        load=os.getloadavg()[0],
        steps_per_s=steps / work_s / robots,
        services_ms_per_step=1e3 * used_s(work, "services") / steps,
        world_ms_per_step=1e3 * used_s(work, WORLD) / steps,
        gateway_ms_per_step=1e3 * used_s(work, "gateway") / steps,
        router_ms_per_step=1e3 * used_s(work, "router") / steps,
        published_kb_per_step=published_kb_per_step,
        idle_services_cores=used_s(rest, "services") / rest_s / robots,
        idle_shared_cores=used_s(rest, *SHARED) / rest_s,
        services_pss_mb=held_mb("services") / robots,
        world_pss_mb=held_mb(WORLD) / robots,
        shared_pss_mb=held_mb(*SHARED),
    )


def kind_of(row: str) -> str:
    """Kind of a row of the process table: services, world, or a shared process's own name."""
    service = row.rpartition("/")[2]
    return service if service in (*SHARED, WORLD) else "services"


def limits(
    of: Cost, smallest: Cost, steps_per_s: float, cores: int, memory_mb: float
) -> dict[str, float]:
    """Number of robots at which each resource ends, if every robot makes so many steps per second.

    smallest: cost of the smallest fleet; from there to `of`, the memory of the shared processes
    grows with the robots. simulated: with the world of each robot on this machine. The gateway is
    one Python process, so one core is its end.
    """
    more = of.robots - smallest.robots
    shared_per_robot_mb = (of.shared_pss_mb - smallest.shared_pss_mb) / more if more else 0.0
    free_mb = memory_mb - of.shared_pss_mb + shared_per_robot_mb * of.robots
    own_mb = of.services_pss_mb + shared_per_robot_mb
    per_s = steps_per_s / 1e3
    shared_ms = of.gateway_ms_per_step + of.router_ms_per_step
    own_cores = of.services_ms_per_step * per_s
    return {
        "processor": cores / (own_cores + shared_ms * per_s),
        "processor, simulated": cores / (own_cores + (shared_ms + of.world_ms_per_step) * per_s),
        "memory": free_mb / own_mb,
        "memory, simulated": free_mb / (own_mb + of.world_pss_mb),
        "gateway": 1.0 / max(of.gateway_ms_per_step * per_s, 1e-9),
        "router on all cores": cores / max(of.router_ms_per_step * per_s, 1e-9),
        "network of 1 Gbit/s": NETWORK_MB_S
        * 1e3
        / max(COPIES * of.published_kb_per_step * steps_per_s, 1e-9),
    }


def measured(robots: int, seconds: float, folder: Path) -> Cost:
    """Start a fleet, measure it, and stop it. Raises Unavailable if it does not get ready."""
    port = free_port()
    with _running(robots, port, folder) as process, Helios(f"http://127.0.0.1:{port}") as helios:
        ready_s = _wait_until_ready(process, folder)
        rest = _span(helios, folder, seconds / 2)
        ids = [helios.submit_to_fleet(TASK).id for _ in range(robots)]
        deadline_s = time.monotonic() + BEGUN_WITHIN_S
        while not all(helios.fleet_task(id).begun for id in ids):
            if time.monotonic() > deadline_s:
                raise Unavailable("the robots did not begin their tasks; see the logs in the state")
            time.sleep(POLL_S)
        work = _span(helios, folder, seconds)
        published = _published_kb_per_step(helios, folder, seconds / 3)
    return cost(robots, ready_s, rest, work, published)


@contextmanager
def _running(robots: int, port: int, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    argv = [
        sys.executable, "-m", "helios_client", "up", "--robot", "sim", "--robots", str(robots),
        "--port", str(port), "--state", str(folder / "state"),
    ]  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    environment = os.environ | {"HELIOS_WORLD_PACE": "1"}
    with (folder / "up.log").open("wb") as log:
        process = subprocess.Popen(argv, stdout=log, stderr=subprocess.STDOUT, env=environment)
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def _wait_until_ready(process: subprocess.Popen[bytes], folder: Path) -> float:
    began_s = time.monotonic()
    while not (state_file.read(folder / "state") or {}).get("ready"):
        log = (folder / "up.log").read_text(errors="replace")[-500:]
        if process.poll() is not None:
            raise Unavailable(f"helios up ended with {process.returncode}: {log}")
        if time.monotonic() - began_s > READY_WITHIN_S:
            raise Unavailable(f"helios up was not ready in {READY_WITHIN_S:g} s: {log}")
        time.sleep(POLL_S)
    return time.monotonic() - began_s


def _span(helios: Helios, folder: Path, seconds: float) -> Span:
    before = _reading(helios, folder)
    time.sleep(seconds)
    return before, _reading(helios, folder)


def _reading(helios: Helios, folder: Path) -> Reading:
    known = state_file.read(folder / "state") or {}
    pids = {row["name"]: row["pid"] for row in known["services"]}
    pids["supervisor"] = known["supervisor_pid"]
    cpu_s, pss_mb = {}, {}
    for row, pid in pids.items():
        process = psutil.Process(pid)
        times = process.cpu_times()
        cpu_s[row] = times.user + times.system
        pss_mb[row] = process.memory_full_info().pss / 1e6
    return Reading(time.monotonic(), cpu_s, pss_mb, _steps(helios))


def _steps(helios: Helios) -> int:
    return sum((task.task or {}).get("steps", 0) for task in helios.fleet_tasks())


def _published_kb_per_step(helios: Helios, folder: Path, seconds: float) -> float:
    """Bytes of all messages on the bus per step, counted by a further subscriber. (On one machine
    large messages go through shared memory, so a socket shows few of them.)"""
    router = str((state_file.read(folder / "state") or {})["router"])
    count = 0

    def add(sample: zenoh.Sample) -> None:
        nonlocal count
        count += len(sample.payload)

    with zenoh.open(client_config(router)) as session:
        session.declare_subscriber("**", add)
        time.sleep(1.0)  # retained messages come first
        count, steps = 0, _steps(helios)
        time.sleep(seconds)
        return count / 1e3 / max(1, _steps(helios) - steps)


def read(path: Path) -> list[Cost]:
    """Costs in a fleet.json that this study wrote."""
    return [Cost(**row) for row in json.loads(path.read_text())["costs"]]


def report(costs: Sequence[Cost]) -> str:
    """Markdown: the measured cost by number of robots, and the calculation beyond, from the largest
    fleet without congestion."""
    out = [
        "| per robot | " + " | ".join(f"{c.robots} robots" for c in costs) + " |",
        "|---|" + "--:|" * len(costs),
    ]
    for words, name in ROWS.items():
        out.append(f"| {words} | " + " | ".join(f"{getattr(c, name):.3g}" for c in costs) + " |")
    pace = max(c.steps_per_s for c in costs)
    cores, memory_mb = os.cpu_count() or 1, psutil.virtual_memory().total / 1e6
    basis = [c for c in costs if c.steps_per_s >= KEPT * pace][-1]
    ends = limits(basis, costs[0], pace, cores, memory_mb)
    out += [
        "",
        f"Calculated for {pace:.2f} steps per second and robot, {cores} cores and "
        f"{memory_mb / 1e3:.0f} GB, from the column of {basis.robots} robots:",
        "",
        "| resource | ends at, robots |",
        "|---|--:|",
    ]
    out += [f"| {what} | {count:.1f} |" for what, count in sorted(ends.items(), key=lambda e: e[1])]
    return "\n".join(out)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.fleet",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--robots", default="1,2,4", help="numbers of robots; default 1,2,4")
    parser.add_argument("--seconds", type=float, default=60.0, help="time of work; default 60")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--out", type=Path, help="folder for figures and logs")
    where.add_argument(
        "--report", type=Path, help="a fleet.json: print its tables, measure nothing"
    )
    args = parser.parse_args(argv)
    if args.report is not None:
        print(report(read(args.report)))
        return 0
    try:
        numbers = sorted({int(part) for part in args.robots.split(",")})
        if numbers[0] < 1 or args.seconds <= 0:
            raise ValueError
    except ValueError:
        parser.error(
            f"--robots {args.robots} --seconds {args.seconds}: wanted numbers from 1, and "
            "seconds above 0"
        )
    costs: list[Cost] = []
    try:
        if sys.platform != "linux":
            raise InvalidInput("PSS is known on Linux only; run the study there")
        for number in numbers:
            costs.append(measured(number, args.seconds, args.out / str(number)))
            about = {"machine": machine(), "commit": commit()}
            rows = {"costs": [asdict(c) for c in costs]}
            write_file(args.out / "fleet.json", json.dumps(about | rows, indent=1))
            print(report(costs), flush=True)
    except HeliosError as error:
        print(f"fleet: {error.message}", file=sys.stderr)
        return 1
    text = f"{machine()}\n\n{report(costs)}\n"
    write_file(args.out / "fleet.md", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
