"""`helios soak --load`: the same tasks without and with load, and what the load changes.

Load: dashboards, reads and a deaf reader (`load_clients`), 20 tasks submitted at once, and a frame
stream at 30 Hz. The services' own times per step are compared.
"""

from __future__ import annotations

import itertools
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import httpx
from helios_client.sdk import Helios
from helios_core import proto as pb
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError
from helios_core.topics import TRUTH_OBJECTS
from helios_eval.provenance import commit, machine

from helios_chaos.load_clients import REQUESTS_PER_S
from helios_chaos.stack import Stack, StackPlan, open_bus, running_stack

TASKS, TASK_S, STREAM_HZ = 20, 25.0, "30"
EXPLORE_S = 12.0
QUEUE = "helios_event_queue"
MOST_EVENTS = 2000  # that wait for one reader, before it is dropped
TASKS_WITHIN_S = 900.0
POLL_S, CALL_S = 1.0, 10.0
MOST_SLOWER = 0.10
LATE_SHARE = 0.05  # of requests that the clients could not send in time
FIGURE = re.compile(r'^helios_service_figure\{name="(\w+)",robot="\w+",service="(\w+)"\} (\S+)$')
PLAIN = re.compile(r'^(helios_event_\w+)\{robot="\w+"\} (\S+)$')
Say = Callable[[str], None]


@dataclass
class Run:
    """One run of the tasks. step_ms: service/step -> median; queues: name -> longest seen."""

    accepted: int = 0
    ended: int = 0
    seconds: float = 0.0
    step_ms: dict[str, float] = field(default_factory=dict)
    queues: dict[str, float] = field(default_factory=dict)
    clients: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class LoadResult:
    """Both runs."""

    without: Run
    loaded: Run

    def ratios(self) -> dict[str, float]:
        """Time of each step under load, as a multiple of its time without."""
        base = self.without.step_ms
        return {
            name: round(ms / base[name], 3)
            for name, ms in sorted(self.loaded.step_ms.items())
            if base.get(name, 0.0) >= 0.1  # shorter ones are below the clock's noise
        }

    def misses(self) -> list[str]:
        out = [
            f"{name} takes {ratio:.2f} times as long under load; wanted at most {1 + MOST_SLOWER:g}"
            for name, ratio in self.ratios().items()
            if ratio > 1 + MOST_SLOWER
        ]
        for run in (self.without, self.loaded):
            if run.ended < TASKS:
                out.append(f"{run.ended} of {TASKS} tasks ended")
        if self.loaded.queues.get(QUEUE, 0.0) > MOST_EVENTS:
            out.append(
                f"{self.loaded.queues[QUEUE]:g} events waited for one reader; wanted at most "
                f"{MOST_EVENTS}"
            )
        if self.loaded.clients.get("failed"):
            kinds = self.loaded.clients["failures"].items()
            told = ", ".join(f"{n} times {kind}" for kind, n in kinds)
            out.append(f"{self.loaded.clients['failed']} requests failed: {told}")
        if self.loaded.clients.get("late", 0) > LATE_SHARE * self.loaded.clients.get("requests", 0):
            out.append(
                f"the clients sent only {self.loaded.clients['requests_per_s']:g} requests a "
                f"second of {REQUESTS_PER_S}; use a machine with more cores"
            )
        return out

    def as_json(self) -> dict[str, Any]:
        return {
            "machine": machine(),
            "commit": commit(),
            "stream_hz": float(STREAM_HZ),
            "without": vars(self.without),
            "loaded": vars(self.loaded),
            "ratios": self.ratios(),
            "passed": not self.misses(),
            "misses": self.misses(),
        }


def run_load(seed: int, out: Path, say: Say) -> LoadResult:
    """Run both; write `load.json` to `out`."""
    runs = []
    for name, environment in (("without", {}), ("loaded", {"HELIOS_BRIDGE_STREAM_HZ": STREAM_HZ})):
        plan = StackPlan(out / name, seed, environment=environment)
        with running_stack(plan) as (stack, _):
            say(f"starting HELIOS, {name if name == 'loaded' else 'without load'}")
            stack.wait_ready()
            runs.append(_play(stack, name == "loaded"))
            say(f"{runs[-1].ended} tasks ended in {runs[-1].seconds:.0f} s")
    result = LoadResult(*runs)
    write_file(out / "load.json", json.dumps(result.as_json(), indent=1) + "\n")
    return result


def _play(stack: Stack, loaded: bool) -> Run:
    run, clients = Run(), None
    if loaded:
        argv = [sys.executable, "-m", "helios_chaos.load_clients", str(stack.port)]
        clients = subprocess.Popen(argv, stdout=subprocess.PIPE, text=True)
    try:
        with stack.client(30.0) as helios:
            began_s = time.monotonic()
            with ThreadPoolExecutor(TASKS) as threads:  # all at once
                ids = list(threads.map(partial(_submit, helios), _instructions(stack)))
            run.accepted = len(ids)
            while time.monotonic() - began_s < TASKS_WITHIN_S:
                _note_figures(stack, run)
                ended = _ended(helios, ids)
                if ended is not None:
                    run.ended = ended
                if run.ended == TASKS:
                    break
                time.sleep(POLL_S)
            run.seconds = round(time.monotonic() - began_s, 1)
    finally:
        if clients is not None:
            clients.send_signal(signal.SIGTERM)
            text, _ = clients.communicate(timeout=30)
            run.clients = json.loads(text or "{}")
    return run


def _instructions(stack: Stack) -> list[str]:
    """Instructions of every kind that leaves the home as it is, by the home's true contents."""
    bus = open_bus(stack.router)
    try:
        truth = bus.call(TRUTH_OBJECTS, pb.Empty(), CALL_S)
    finally:
        bus.close()
    things = sorted({one.class_name for one in truth.instances if one.graspable})
    places = sorted({one.class_name for one in truth.instances if not one.graspable})
    kinds = itertools.cycle(
        (
            lambda n: "explore",
            lambda n: "go home",
            lambda n: f"Find the {things[n % len(things)]}",
            lambda n: f"Go to the {places[n % len(places)]}",
        )
    )
    return [kind(n) for n, kind in zip(range(TASKS), kinds, strict=False)]


def _submit(helios: Helios, instruction: str) -> str:
    if instruction == "explore":
        return helios.explore(EXPLORE_S).id
    if instruction == "go home":
        return helios.home().id
    return helios.submit(instruction.replace("_", " "), time_limit_s=TASK_S).id


def _ended(helios: Helios, ids: list[str]) -> int | None:
    try:
        states = {task.id: task.ended for task in helios.tasks()}
    except HeliosError:
        return None
    return sum(states.get(id, False) for id in ids)


def _note_figures(stack: Stack, run: Run) -> None:
    """Take the services' figures over from the gateway's metrics."""
    try:
        text = httpx.get(f"http://127.0.0.1:{stack.port}/metrics", timeout=30.0).text
    except httpx.HTTPError:
        return
    for line in text.splitlines():
        if found := FIGURE.match(line):
            name, service, value = found.groups()
            if name.endswith("_ms_median"):
                run.step_ms[f"{service}/{name.removesuffix('_ms_median')}"] = float(value)
            elif "queue" in name or "waiting" in name:
                _note_most(run.queues, f"{service}/{name}", float(value))
        elif found := PLAIN.match(line):
            _note_most(run.queues, found[1], float(found[2]))


def _note_most(queues: dict[str, float], name: str, value: float) -> None:
    queues[name] = max(queues.get(name, 0.0), value)
