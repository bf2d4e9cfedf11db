"""One robot as the fleet sees it: its state, its open task, and what its map knows."""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import Literal

from helios_core import proto as pb
from helios_core.errors import HeliosError
from helios_core.name_rules import is_named
from helios_core.task_states import ENDED, HOLDS_ROBOT
from helios_core.topics import LIST_TASKS, TASK

from helios_gateway.fleet.assignment import IdleRobot, KnownThing
from helios_gateway.robot_registry import RobotEndpoint

FleetRobotState = Literal["idle", "busy", "not ready", "stopped", "away"]

LEAST_SCORE = 0.2  # lowest score Ψ of an object that a map knows
REFRESH_S = 30.0  # period in which the robot's tasks are listed anew
LIST_AGAIN_S = 5.0  # pause after a list that failed; each further failure doubles it
REMEMBERED = 64  # newest states of tasks


class FleetRobot:
    """One robot of the fleet. Thread-safe. `clock` is monotonic seconds."""

    def __init__(
        self,
        name: str,
        served: RobotEndpoint,
        timeout_s: float,
        on_task: Callable[[], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """on_task: called after each change of one of the robot's tasks."""
        self.name, self.served = name, served
        self._timeout_s, self._on_task, self._clock = timeout_s, on_task, clock
        self._lock = threading.Lock()
        self._tasks: OrderedDict[str, pb.Task] = OrderedDict()
        self._listed_s = -math.inf
        self._list_after_s = -math.inf  # no earlier, because the planner did not answer
        self._pause_s = LIST_AGAIN_S  # after the next list that fails
        self._away_since_s: float | None = clock()
        served.bus.subscribe(TASK, self._hear)

    # --- tasks at the robot --------------------------------------------------------------------
    def _hear(self, task: pb.Task) -> None:
        with self._lock:
            self._tasks[task.id] = task
            self._tasks.move_to_end(task.id)
            while len(self._tasks) > REMEMBERED:
                self._tasks.popitem(last=False)
        self._on_task()

    def newest(self, task_id: str) -> pb.Task | None:
        """Newest published state of a task; None if none was heard."""
        with self._lock:
            return self._tasks.get(task_id)

    def under_way(self) -> pb.Task | None:
        """Task that holds the robot, or that waits to start; None without one."""
        with self._lock:
            tasks = list(self._tasks.values())
        begun = [t for t in tasks if t.state in HOLDS_ROBOT]
        waiting = [t for t in tasks if t.state == "queued" and not t.on_hold]
        return next(iter((*begun, *waiting)), None)

    def refresh(self) -> None:
        """List the robot's tasks anew if that is due. Does nothing while the planner is away.

        One thread asks all robots, so a planner that hangs is asked ever more rarely.
        """
        now_s = self._clock()
        if not self.planner_here:
            self._listed_s = self._list_after_s = -math.inf
            self._pause_s = LIST_AGAIN_S
            return
        if now_s < self._list_after_s or now_s - self._listed_s < REFRESH_S:
            return
        self._listed_s = now_s
        with self._lock:
            known = [id for id, task in self._tasks.items() if task.state not in ENDED]
        try:
            listed = self.served.bus.call(LIST_TASKS, pb.Empty(), self._timeout_s).tasks
        except HeliosError:
            self._listed_s, self._list_after_s = -math.inf, self._clock() + self._pause_s
            self._pause_s = min(2 * self._pause_s, REFRESH_S)
            return
        self._pause_s = LIST_AGAIN_S
        open_tasks = {t.id: t for t in listed if t.state not in ENDED}
        with self._lock:
            for id in known:  # a task that was heard since may be newer than the list
                task = self._tasks.get(id)
                if task is not None and task.state not in ENDED and id not in open_tasks:
                    del self._tasks[id]  # it ended while nobody listened
            for id, task in open_tasks.items():
                self._tasks.setdefault(id, task)

    # --- state ---------------------------------------------------------------------------------
    @property
    def planner_here(self) -> bool:
        return self.served.monitor.services.is_alive("planner")

    @property
    def connected(self) -> bool:
        return self.served.monitor.services.is_alive("bridge")

    def note_presence(self) -> None:
        """Note whether the robot is there. Call it in every cycle, for `away_s`."""
        if self.connected:
            self._away_since_s = None
        elif self._away_since_s is None:
            self._away_since_s = self._clock()

    @property
    def away_s(self) -> float:
        """Time since the robot dropped out; 0 while it is there."""
        return 0.0 if self._away_since_s is None else self._clock() - self._away_since_s

    def reasons(self) -> list[str]:
        """Reasons why the robot cannot do a task now; empty if it can."""
        return self.served.monitor.not_ready_reasons()

    def state(self) -> FleetRobotState:
        if not self.connected:
            return "away"
        if self.served.monitor.stopped:
            return "stopped"
        if self.under_way() is not None:
            return "busy"
        return "not ready" if self.reasons() else "idle"

    def idle(self, things: Iterable[str]) -> IdleRobot:
        """The robot for an assignment, with those of the things that its map knows."""
        return IdleRobot(self.name, self._known(sorted({t for t in things if t})))

    def _known(self, things: list[str]) -> dict[str, KnownThing]:
        state = self.served.monitor.robot().state
        if not things or state is None or state.pose is None:
            return {}
        try:
            objects = self.served.monitor.maps.objects().objects
        except HeliosError:  # a robot without a map can still search
            return {}
        out: dict[str, KnownThing] = {}
        for one in objects:
            x_m, y_m = one.center_m[:2]
            if x_m is None or y_m is None or one.score is None or one.score < LEAST_SCORE:
                continue
            far_m = math.hypot(x_m - state.pose.x_m, y_m - state.pose.y_m)
            for thing in things:
                if is_named(thing, one.class_name) and (
                    thing not in out or far_m < out[thing].distance_m
                ):
                    out[thing] = KnownThing(one.score, far_m)
        return out
