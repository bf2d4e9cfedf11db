"""Tells how one task goes while it runs; the `Listener` of a `BusBody`."""

from __future__ import annotations

import math
import time
from typing import Protocol

import numpy as np
from helios_core import proto as pb
from helios_core.topics import PLAN, M, Topic
from helios_core.types import FrameId
from numpy.typing import NDArray

from helios_planner.decisions.decide import Decision
from helios_planner.decisions.recompute import as_kept
from helios_planner.ground.grid import Pose2
from helios_planner.settings import Settings
from helios_planner.task import HELD, Phase, State, Task
from helios_planner.tasks.pace import Pace
from helios_planner.tasks.telling import decision_to_proto, plan_to_proto

PLACES = ("frontier", "receptacle")  # candidates that are places to go to and look


class Desk(Protocol):
    """Where tasks and decisions are kept and told from."""

    def known(self, id: str) -> Task: ...
    def change(self, id: str, **changes: object) -> Task: ...
    def keep(self, decision: pb.Decision) -> None: ...
    def publish(self, topic: Topic[M], message: M) -> None: ...


class TaskVoice:
    """Tells how one task goes; called from the worker alone."""

    def __init__(self, desk: Desk, task: Task, settings: Settings, first_decision: int = 0) -> None:
        self._desk, self._id, self._settings = desk, task.id, settings
        self._pace = Pace(task.instruction.kind, task.max_steps, task.steps, task.progress)
        limit_s = task.time_limit_s
        self._ends_s = task.started_s + limit_s if limit_s else math.inf
        self._decisions = first_decision
        self._before: str | None = None  # what was told before it had to wait

    def on_phase(self, phase: Phase, seeking: str, message: str) -> None:
        self._pace.on_phase(phase)
        self._desk.change(
            self._id, phase=phase, seeking=seeking, message=message, eta_s=self._eta_s()
        )

    def on_steps(self, steps: int) -> None:
        self._pace.on_step(steps, time.monotonic())
        self._desk.change(
            self._id, steps=steps, progress=self._pace.progress, eta_s=self._eta_s()
        )  # fmt: skip

    def on_picks(self, picks: int) -> None:
        self._desk.change(self._id, picks=picks)

    def on_paused(self, why: str) -> None:
        message = f"the robot is stopped ({why}); clear the stop or cancel the task"
        self._rest(state=State.PAUSED, message=message)

    def on_resumed(self) -> None:
        self._desk.change(self._id, state=State.RUNNING, message="goes on")

    def on_wait(self, what: str | None) -> None:
        """Somebody is away; None: they are there again, and it goes on with what it did."""
        if self._before is None:
            self._before = self._desk.known(self._id).message
        message = self._before if what is None else f"waits for {what}"
        self._rest(message=message)
        if what is None:
            self._before = None

    def on_hold(self, paused: bool) -> None:
        """Somebody paused the task, or lets it go on."""
        if paused:
            self._rest(state=State.PAUSED, message=HELD)
        else:
            self.on_resumed()

    def on_decision(self, decision: Decision, frame: FrameId | None) -> None:
        task = self._desk.known(self._id)
        kept = as_kept(decision, self._settings)
        places = sum(c.kind in PLACES for c in decision.candidates)
        if places:
            self._pace.on_choice(places)
        told = decision_to_proto(kept, task, self._decisions, frame, time.time())
        self._decisions += 1
        self._desk.keep(told)

    def on_plan(self, route_m: NDArray[np.float64], goal: Pose2 | None, purpose: str) -> None:
        self._pace.on_way(float(np.hypot(*np.diff(route_m, axis=0).T).sum()) if len(route_m) else 0)
        self._desk.publish(PLAN, plan_to_proto(self._id, route_m, goal, purpose))

    def _rest(self, **changes: object) -> None:
        """It stands, and nobody knows for how long."""
        self._pace.on_rest()
        self._desk.change(self._id, eta_s=None, **changes)

    def _eta_s(self) -> tuple[float, float] | None:
        return self._pace.eta_s(self._ends_s - time.time())
