"""Measure over the bus how long a killed planner takes until it acts again."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import psutil
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.topics import TASK, status_topic

from tests.stack import Stack


@dataclass(frozen=True)
class Restart:
    """Wall-clock seconds after SIGKILL. `cpu_s`: processor time of the new process until its first
    action is done; `imports_cpu_s`: the part of it until the first status message."""

    started_s: float  # the supervisor has restarted the planner
    imported_s: float  # first status message: imports are done, the router is connected
    ready_s: float  # the kernels are loaded, and the robot is known
    acted_s: float  # the first action is done
    imports_cpu_s: float
    cpu_s: float

    @property
    def of_first_word(self) -> float:
        """Time to the first action as a multiple of the time to the first status message.

        The time to that message is mostly imports: a second on an idle machine, and on a busy
        machine it grows like all else.
        """
        return self.acted_s / self.imported_s


class _Witness:
    """Records when the new planner process reports each state, and when the task has a new step."""

    def __init__(self, bus: Bus, task_id: str, old_pid: int) -> None:
        self._task_id, self._old_pid = task_id, old_pid
        self._steps: int | None = None  # of the task when the new process resumed it
        self.at_s: dict[str, float] = {}
        self.cpu_s: dict[str, float] = {}
        self.acted = threading.Event()
        self._process: psutil.Process | None = None
        self._heard = (
            bus.subscribe(status_topic("planner"), self._on_status),
            bus.subscribe(TASK, self._on_task),
        )

    def close(self) -> None:
        for heard in self._heard:
            heard.close()

    def _on_status(self, status: pb.ServiceStatus) -> None:
        if status.pid == self._old_pid:
            return
        if self._process is None:
            self._process = psutil.Process(status.pid)
            self._note("imported")
        if status.state == "ready" and "ready" not in self.at_s:
            self._note("ready")

    def _on_task(self, task: pb.Task) -> None:
        if task.id != self._task_id or self._process is None or self.acted.is_set():
            return
        if self._steps is None:
            self._steps = task.steps
        elif task.steps > self._steps:
            self._note("acted")
            self.acted.set()

    def _note(self, what: str) -> None:
        assert self._process is not None
        used = self._process.cpu_times()
        self.at_s[what], self.cpu_s[what] = time.time(), used.user + used.system


def restarted(
    stack: Stack,
    bus: Bus,
    task_id: str,
    within_s: float,
    meanwhile: Callable[[], object] = lambda: None,
) -> Restart:
    """Kill the planner in the middle of a task, and wait until it has acted again."""
    pid = stack.pid("planner")
    witness = _Witness(bus, task_id, pid)
    started_s = None
    try:
        killed_s = time.time()
        os.kill(pid, signal.SIGKILL)
        while not witness.acted.wait(0.02):
            if started_s is None and stack.pid("planner") not in (pid, 0):
                started_s = time.time()
            meanwhile()
            assert time.time() - killed_s < within_s, f"it did not go on within {within_s:g} s"
    finally:
        witness.close()
    assert started_s is not None
    at_s = {what: t - killed_s for what, t in witness.at_s.items()}
    return Restart(
        started_s - killed_s,
        at_s["imported"],
        at_s.get("ready", at_s["acted"]),
        at_s["acted"],
        witness.cpu_s["imported"],
        witness.cpu_s["acted"],
    )
