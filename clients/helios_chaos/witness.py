"""Watches the simulated robot by its ground truth: its actions, and where it drives."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import HeliosError
from helios_core.topics import GET_STATE, LIST_TASKS, TRUTH_TRACE, WORLD_STATE, Method
from numpy.typing import NDArray

POLL_S, CALL_S = 0.05, 2.0
SOON_S = 0.3  # for a call that a lost link may swallow
PAUSE_S = 0.15  # a robot without a physics step of a drive for this long stands


@dataclass(frozen=True)
class Counts:
    """Actions since the start of the world, at a time of the monotonic clock."""

    begun: int
    ended: int
    at_s: float


class Witness:
    """Polls the world in a thread of its own, directly at the router. Thread-safe."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._lock = threading.Condition()
        self._counts = Counts(0, 0, 0.0)
        self._steps: list[NDArray[np.float64]] = []  # [n, 3]: monotonic seconds, x, y
        self._ends_s: list[float] = []  # time at which an action was seen to have ended
        self._since_ns = time.monotonic_ns()
        self._ending = threading.Event()
        threading.Thread(target=self._run, name="witness", daemon=True).start()

    def close(self) -> None:
        self._ending.set()

    def counts(self, after_s: float, within_s: float) -> Counts | None:
        """First counts that were asked for after a time; None if there are none in time."""
        return self._wait(lambda: self._counts.at_s > after_s, within_s)

    def wait_action(self, after_s: float, within_s: float) -> float | None:
        """Time at which an action was seen to have ended that began after `after_s`; None if
        none has in time."""
        until_s = after_s + within_s
        first = self.counts(after_s, until_s - time.monotonic())
        if first is None:
            return None
        found = self._wait(lambda: self._counts.ended > first.begun, until_s - time.monotonic())
        return found and found.at_s

    def wait_driving(self, speed_m_s: float, within_s: float) -> bool:
        """Wait until the robot drives straight at this speed or faster."""
        return self._wait(lambda: self._speed_m_s() >= speed_m_s, within_s) is not None

    def drive_after(self, stamp_s: float) -> NDArray[np.float64]:
        """Steps [n, 3] of the drive that runs at a time, from then on: monotonic s, x m, y m."""
        with self._lock:
            steps = np.concatenate(self._steps) if self._steps else np.empty((0, 3))
        newer = steps[steps[:, 0] > stamp_s - PAUSE_S]
        gaps = np.flatnonzero(np.diff(newer[:, 0]) > PAUSE_S)
        if len(newer) == 0 or newer[0, 0] > stamp_s:  # it stood
            return np.empty((0, 3))
        drive = newer[: gaps[0] + 1] if len(gaps) else newer
        return drive[drive[:, 0] > stamp_s]

    def between_actions_s(self) -> list[float]:
        """Times between the ends of actions so far."""
        with self._lock:
            return [b - a for a, b in zip(self._ends_s, self._ends_s[1:], strict=False)]

    def _wait(self, condition, within_s: float) -> Counts | None:
        with self._lock:
            return self._counts if self._lock.wait_for(condition, max(0.0, within_s)) else None

    def _speed_m_s(self) -> float:
        """Mean speed in the last physics steps of a drive that still runs."""
        if not self._steps:
            return 0.0
        last = self._steps[-1][-10:]
        if len(last) < 2 or time.monotonic() - last[-1, 0] > PAUSE_S:
            return 0.0
        return float(np.hypot(*(last[-1, 1:] - last[0, 1:])) / max(last[-1, 0] - last[0, 0], 1e-3))

    def _run(self) -> None:
        while not self._ending.wait(POLL_S):
            asked_s = time.monotonic()
            try:
                request = pb.TruthTraceRequest(since_ns=self._since_ns)
                trace = self._bus.call(TRUTH_TRACE, request, CALL_S)
            except HeliosError:
                continue
            began_s = self._since_ns / 1e9
            steps = np.column_stack((trace.after_s, trace.x_m, trace.y_m)).reshape(-1, 3)
            steps[:, 0] += began_s
            with self._lock:
                more = trace.actions - self._counts.ended
                self._ends_s += [time.monotonic()] * more
                self._counts = Counts(trace.begun, trace.actions, asked_s)
                if len(steps):
                    self._steps.append(steps)
                    self._since_ns = round(steps[-1, 0] * 1e9) + 1
                self._lock.notify_all()


def length_m(drive: NDArray[np.float64]) -> float:
    """Length of the path through steps [n, 3]."""
    return float(np.hypot(*np.diff(drive[:, 1:], axis=0).T).sum()) if len(drive) > 1 else 0.0


class ControlChain:
    """Tells when the robot can be driven again: planner, bridge and world answer at the router."""

    METHODS: tuple[Method[pb.Empty, Any], ...] = (WORLD_STATE, GET_STATE, LIST_TASKS)

    def __init__(self, opened: Callable[[float], Bus]) -> None:
        """opened: a new bus, within some seconds. One that lost its router would answer late."""
        self._opened = opened
        self._threads = ThreadPoolExecutor(1 + len(self.METHODS), "chain")

    def close(self) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)

    def whole_after(self, lost_s: float, within_s: float) -> Callable[[], float]:
        """Begin to watch. The result waits, and is the time at which all have answered a call
        that was made after `lost_s`; infinite if one did not in time. One watch at a time."""
        return self._threads.submit(self._watch, lost_s + within_s).result

    def _watch(self, until_s: float) -> float:
        try:
            bus = self._opened(max(0.0, until_s - time.monotonic()))
        except HeliosError:
            return math.inf
        try:
            parts = [self._threads.submit(self._answers, bus, m, until_s) for m in self.METHODS]
            return max(part.result() for part in parts)
        finally:
            bus.close()

    def _answers(self, bus: Bus, method: Method[pb.Empty, Any], until_s: float) -> float:
        while (asked_s := time.monotonic()) < until_s:
            try:
                bus.call(method, pb.Empty(), SOON_S)
            except HeliosError:
                time.sleep(max(0.0, asked_s + POLL_S - time.monotonic()))
            else:
                return time.monotonic()
        return math.inf
