"""Measures how soon a planner that is killed during a task acts again, and where the time goes.

    python -m tests.bench.planner_restart [--kills 5]

The full stack runs with the simulated robot. The planner's process gets SIGKILL repeatedly while it
searches. The supervisor restarts a process at once only after some steady seconds; the task is
paused for that long in between.
The figures are wall-clock seconds after the kill: quote them from an otherwise idle machine.
Processor time of the new process is listed with them, and holds on a busy machine, too.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from dataclasses import fields
from pathlib import Path

from helios_client.supervision.supervisor import STEADY_S
from helios_core import proto as pb
from helios_core.topics import TRUTH_EPISODE
from helios_core.zenoh_bus import ZenohBus

from tests.restarts import Restart, restarted
from tests.stack import Stack
from tests.support import wait_until


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=5)
    kills = parser.parse_args().kills
    with tempfile.TemporaryDirectory() as folder:
        stack = Stack(Path(folder))
        bus = None
        try:
            wait_until(stack.ready, 180, "all services are ready")
            bus = ZenohBus(f"tcp/127.0.0.1:{stack.router_port}")
            instruction = bus.call(TRUTH_EPISODE, pb.Empty(), 10).instruction
            id = stack.post("/v1/tasks", {"instruction": instruction})["id"]
            wait_until(lambda: stack.task(id)["steps"] >= 20, 150, "it searches")
            found: list[Restart] = []
            for _ in range(kills):
                stack.post(f"/v1/tasks/{id}/pause")  # else it would be done before the last kill
                time.sleep(STEADY_S + 1)
                stack.post(f"/v1/tasks/{id}/resume")
                steps = stack.task(id)["steps"]
                wait_until(lambda n=steps: stack.task(id)["steps"] > n + 1, 300, "it acts")
                found.append(restarted(stack, bus, id, 300))
        finally:
            if bus is not None:
                bus.close()
            stack.close()
    print("seconds after SIGKILL, and of processor time:")
    for name in (field.name for field in fields(Restart)):
        values = [getattr(restart, name) for restart in found]
        each = " ".join(f"{v:.2f}" for v in values)
        print(f"{name:>14}: {statistics.median(values):6.2f}  ({each})")


if __name__ == "__main__":
    main()
