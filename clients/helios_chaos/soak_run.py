"""`helios soak`: tasks and idling in turn for hours, with notes of memory and latency."""

from __future__ import annotations

import json
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from helios_core.atomic_file import write_file
from helios_eval.provenance import commit, machine

from helios_chaos.figures import percentiles
from helios_chaos.resources import ResourceLog, Sample, growth, slope_per_h
from helios_chaos.soak_plot import plot
from helios_chaos.stack import Stack, StackPlan, open_bus, running_stack
from helios_chaos.tasks import PlayedTask, TaskPlayer

TURN_S = 300.0  # of tasks, and of idling
LAST_TASK_S = 120.0
MOST_THINGS = 4  # a household asks for the same things again; the maps know them after the warm-up
PERIOD_S = 10.0
WARM_UP_S, WARM_UP_SHARE = 1200.0, 0.25  # the shorter one is left out of the slopes
MOST_RSS_MB_H, MOST_HANDLES, MOST_THREADS, MOST_STATE_MB = 1.0, 1.0, 1.0, 200.0
Say = Callable[[str], None]


@dataclass(frozen=True)
class ServiceGrowth:
    """Growth of one service after the warm-up."""

    rss_mb: float  # median
    rss_mb_per_h: float
    handles_more: float
    threads_more: float
    latency_ms: dict[str, float | None]
    starts: int  # processes of it that were seen


@dataclass(frozen=True)
class SoakResult:
    """Result of a soak."""

    hours: float
    services: dict[str, ServiceGrowth]
    state_mb: float  # largest size of the state folder
    tasks: list[PlayedTask]

    def misses(self) -> list[str]:
        out = [f"task {t.id} is lost: {t.untrue or t.state}" for t in self.tasks if t.lost]
        for name, g in self.services.items():
            for value, most, what in (
                (g.rss_mb_per_h, MOST_RSS_MB_H, "MB of memory per hour"),
                (g.handles_more, MOST_HANDLES, "open handles"),
                (g.threads_more, MOST_THREADS, "threads"),
            ):
                if value > most:
                    out.append(f"{name} grows by {value:.2f} {what}; wanted at most {most:g}")
            if g.starts > 1:
                out.append(f"{name} was started {g.starts} times")
        if self.state_mb > MOST_STATE_MB:
            out.append(f"the state folder takes {self.state_mb:.0f} MB; wanted {MOST_STATE_MB:g}")
        return out

    def as_json(self) -> dict[str, Any]:
        ends = [task.state for task in self.tasks]
        return {
            "machine": machine(),
            "commit": commit(),
            "hours": round(self.hours, 3),
            "tasks": len(ends),
            "succeeded": ends.count("succeeded"),
            "lost": sum(task.lost for task in self.tasks),
            "state_mb": self.state_mb,
            "services": {name: vars(g) for name, g in self.services.items()},
            "passed": not self.misses(),
            "misses": self.misses(),
        }


def run_soak(hours: float, seed: int, out: Path, say: Say) -> SoakResult:
    """Run a soak; write `soak.csv`, `soak.json` and `soak.png` to `out`."""
    with running_stack(StackPlan(out, seed)) as (stack, _):
        say("starting HELIOS in a simulated home")
        stack.wait_ready()
        log = ResourceLog(stack, out / "soak.csv", PERIOD_S)
        began_s = time.monotonic()
        tasks = _play(stack, seed, hours * 3600.0, log, say)
        samples = log.close()
    result = SoakResult(
        (time.monotonic() - began_s) / 3600,
        growths(samples),
        max((s.state_mb for s in samples), default=0.0),
        tasks,
    )
    write_file(out / "soak.json", json.dumps(result.as_json(), indent=1) + "\n")
    plot(samples, out / "soak.png")
    return result


def growths(samples: Sequence[Sample]) -> dict[str, ServiceGrowth]:
    """Growth of each service after the warm-up: latency from all samples, the rest from those at
    rest."""
    last_s = max((s.at_s for s in samples), default=0.0)
    warm_s = min(WARM_UP_S, WARM_UP_SHARE * last_s)
    by_service: dict[str, list[Sample]] = defaultdict(list)
    for sample in samples:
        if sample.at_s >= warm_s:
            by_service[sample.service].append(sample)
    out = {}
    for name, found in by_service.items():
        at_rest = [s for s in found if s.at_rest]
        rss = [s.rss_mb for s in at_rest]
        waits = [s.latency_ms for s in found if s.latency_ms is not None]
        out[name] = ServiceGrowth(
            sorted(rss)[len(rss) // 2] if rss else 0.0,
            round(slope_per_h([s.at_s for s in at_rest], rss), 3),
            growth([s.handles for s in at_rest]),
            growth([s.threads for s in at_rest]),
            percentiles(waits, 50, 99, digits=2),
            len({s.pid for s in found}),
        )
    return out


def _play(stack: Stack, seed: int, seconds: float, log: ResourceLog, say: Say) -> list[PlayedTask]:
    """Tasks for `TURN_S`, then as long without; until the time is over."""
    bus, tasks, start_xy = open_bus(stack.router), list[PlayedTask](), None
    ends_s, turn = time.monotonic() + seconds, 0
    try:
        with stack.client() as helios:
            while (left_s := ends_s - time.monotonic()) > 0:
                player = TaskPlayer(helios, bus, seed + turn, start_xy, MOST_THINGS)
                start_xy = player.start_xy
                log.at_rest = False
                player.start()
                time.sleep(min(TURN_S, left_s))
                player.finish(LAST_TASK_S)
                log.at_rest = True
                tasks += player.played
                say(f"{left_s / 60:6.0f} min left; {len(tasks)} tasks played")
                time.sleep(max(0.0, min(TURN_S, ends_s - time.monotonic())))
                turn += 1
    finally:
        bus.close()
    return tasks
