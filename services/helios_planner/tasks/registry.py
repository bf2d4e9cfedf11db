"""Registry of the planner's tasks: adding, changing, publishing, ending and restoring them."""

from __future__ import annotations

import logging
import math
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import Conflict, HeliosError, InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.topics import DECISION, PLAN, TASK, M, Topic
from helios_core.types import FrameId
from numpy.typing import NDArray

from helios_planner.decisions.counterfactual import with_replay_settings
from helios_planner.decisions.decision import Decision
from helios_planner.instruction.parser import Instruction
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.robot.step_spans import note_decision
from helios_planner.settings import Settings
from helios_planner.task import HELD, Cause, Phase, State, Task
from helios_planner.tasks.messages import (
    decision_to_proto,
    plan_to_proto,
    task_from_proto,
    task_to_proto,
)
from helios_planner.tasks.progress import ProgressEstimate
from helios_planner.tasks.store import Store

log = logging.getLogger(__name__)

MOST_LATE = 500
_SUBMIT_AGAIN = (
    "so it is not known how far this one came; the robot goes on with nothing by itself: see what "
    "it holds, and submit the task again"
)
CLOCK_STEP_S = 5.0  # by which a corrected clock may go back
AWAY = "was away for too long while the task ran; submit it again"
UNPROVEN = f"ended at a time when it could not write down how its tasks went, {_SUBMIT_AGAIN}"
OUTDATED = f"began another task later and has no end of this one, {_SUBMIT_AGAIN}"
UNREADABLE = f"cannot read its journal of the task, {_SUBMIT_AGAIN}"
NOT_KEPT = "this could not be kept: a planner that is restarted will not know it"
PLACES = ("frontier", "receptacle")  # candidates that are places to visit
LONGEST_RESERVATION_S = 600.0
LONGEST_REASON = 200  # characters


class TaskRegistry:
    """Registry of tasks. Thread-safe; no lock is held during calls to the bus. While `closing` is
    set, a cancelled task is one that the planner left, and `close` ends it.

    A task is published as ended once its end is stored. If the store refuses it, the task's message
    reports that, and `mend` publishes the end later: once it is stored, or after `keep_within_s`.
    """

    def __init__(self, bus: Bus, settings: Settings, health: Health, store: Store) -> None:
        self._bus, self._settings, self._health, self._store = bus, settings, health, store
        self._lock, self._writing = threading.Lock(), threading.Lock()
        self._tasks: dict[str, Task] = {}
        self._cancelled: set[str] = set()  # running tasks that are to end, but have not yet
        self._ends: dict[str, Task] = {}  # ended tasks whose end is not stored yet
        self._unkept: set[str] = set()  # tasks whose stored state is out of date
        self._late: deque[pb.Decision] = deque(maxlen=MOST_LATE)  # decisions that are not stored
        self.closing = threading.Event()

    def restore(self) -> list[str]:
        """Read the stored tasks; returns the ids of those to do, first the one that ran when the
        planner died. It resumes only if the planner died within `resume_within_s`, was not stopped,
        and the store is proven complete. Else it ends, and queued tasks wait to be resumed. Of
        several running tasks only the newest resumes. A clock that was set back does not tell when
        the planner died."""
        away_s = time.time() - self._store.alive_s()
        just_left = -CLOCK_STEP_S <= away_s <= self._settings.resume_within_s
        readable = filter(None, map(_readable, self._store.tasks()))
        self._tasks = {task.id: task for task in readable}
        under_way = [t for t in self._tasks.values() if t.state.under_way]
        newest_s = max((t.started_s for t in under_way), default=0.0)
        again, queued = [], []
        for task in list(self._tasks.values()):
            if task.state is State.QUEUED:
                queued.append(task.id)
                if not ((just_left and self._store.proven) or task.on_hold):
                    self.change(task.id, on_hold=True, message=f"was queued before; {HELD}")
            elif not task.state.under_way:
                continue
            elif why := self._why_not_resumed(task, just_left, newest_s):
                self._leave(task.id, why)
            else:
                again.append(task.id)
                state = State.PAUSED if task.on_hold else State.RUNNING
                self.change(task.id, state=state, message="the planner was restarted")
        self.mend()
        return [*again, *queued]

    def _why_not_resumed(self, task: Task, just_left: bool, newest_s: float) -> str:
        """Why a task under way ends at the start; empty if it resumes. newest_s: start of the
        newest task under way."""
        if not just_left:
            return AWAY
        if not self._store.proven:
            return UNPROVEN
        if task.started_s < newest_s:
            return OUTDATED
        try:
            self._store.entry(task.id)
        except ValueError as error:
            log.error("the journal of task %s cannot be read: %s", task.id, error)
            return UNREADABLE
        return ""

    def note_alive(self) -> None:
        """Store that the planner is alive now."""
        self._store.note_alive(time.time())

    def mend(self) -> None:
        """Write the outdated tasks, and publish the ends that waited for it."""
        with self._writing:
            with self._lock:
                ends = dict(self._ends)
                asked = frozenset(self._unkept)
                decisions = [d for d in self._late if d.task_id in self._tasks]
                rest = [t for id in asked - ends.keys() if (t := self._to_keep(id))]
            rest = [t.with_(message=t.message.removesuffix(f"; {NOT_KEPT}")) for t in rest]
            kept = self._store.mend(
                [task_to_proto(t) for t in rest if not t.state.ended],
                [task_to_proto(t) for t in (*ends.values(), *rest) if t.state.ended],
                decisions,
            )
            late: dict[str, Task] = {}
            if kept:
                with self._lock:
                    self._unkept -= asked
                    stored = set(map(id, decisions))
                    rows = [d for d in self._late if id(d) not in stored]
                    self._late = deque(rows, MOST_LATE)
                    known = self._tasks
                    late = {t.id: t for t in rest if t.id in known and known[t.id].state.ended}
                    self._tasks |= late
        if kept:
            for task in late.values():
                self.publish(TASK, task_to_proto(task))
            for task in ends.values():
                self._tell_end(task)
        elif self._store.fault_s > self._settings.keep_within_s:
            for task in ends.values():
                self._tell_end(task.with_(message=f"{task.message}; {NOT_KEPT}"))

    def close(self) -> None:
        """End the running tasks, and close the store."""
        for id in [task.id for task in self.tasks() if task.state.under_way]:
            with self._lock:
                ended = self._ends.get(id)
            if ended is not None:
                self._tell_end(ended.with_(message=f"{ended.message}; {NOT_KEPT}"))
            else:
                self._leave(id, "was stopped while the task ran; submit it again")
        self._store.note_alive(0.0)
        self._store.close()

    def _leave(self, id: str, why: str) -> None:
        """End a task that cannot go on, and publish it even if it is not stored: the next planner
        would end it too."""
        self.end(id, State.FAILED, f"the planner {why}", Cause.SYSTEM_ERROR)
        with self._lock:
            waits = self._ends.get(id)
        if waits is not None:
            self._tell_end(waits)

    # --- one task ------------------------------------------------------------------------------
    def tasks(self) -> list[Task]:
        """All tasks, oldest first."""
        with self._lock:
            return sorted(self._tasks.values(), key=lambda t: t.created_s)

    def known(self, id: str) -> Task:
        """The task with an id. Raises InvalidInput for an unknown one."""
        with self._lock:
            task = self._tasks.get(id)
        if task is None:
            raise InvalidInput(f"there is no task {id[:40]!r}; list them with GET /v1/tasks")
        return task

    def find(self, id: str) -> pb.Task | None:
        """The task with an id; None for an unknown one."""
        with self._lock:
            task = self._tasks.get(id)
        return None if task is None else task_to_proto(task)

    def check_keeping(self) -> None:
        """Raises Unavailable while tasks cannot be stored."""
        if self._store.fault:
            raise self._not_taken()

    def _not_taken(self) -> Unavailable:
        return Unavailable(f"no task is taken now: {self._store.fault}; then submit it again")

    def add(self, task: Task) -> pb.Task:
        """Store a new task, then publish it; the oldest ended ones beyond `keep_tasks` are deleted.
        Raises Unavailable if it cannot be stored."""
        message = task_to_proto(task)
        if not self._store.put(message, safe=True):
            raise self._not_taken()
        with self._lock:
            self._tasks[task.id] = task
            ended = sorted((t.created_s, t.id) for t in self._tasks.values() if t.state.ended)
            gone = [id for _, id in ended[: -self._settings.keep_tasks]]
            for id in gone:
                del self._tasks[id]
                self._unkept.discard(id)
        for id in gone:
            self._store.forget(id)
        self.publish(TASK, message)
        return message

    def change(self, id: str, **changes: object) -> Task:
        """Set fields of a task and return it; an ended task does not change."""
        with self._lock:
            if self._tasks[id].state.ended:
                return self._tasks[id]
            task = self._tasks[id] = self._tasks[id].with_(**changes)
        self._keep(id, safe="on_hold" in changes)
        return self._publish_present(id) or task

    def cancel(self, id: str) -> None:
        """Mark a running task to end. This is stored at once: if the planner dies before the task
        ends, the next planner does not resume it. A task that has ended does not change."""
        with self._lock:
            task = self._tasks.get(id)
            if task is None or task.state.ended:
                return
            self._cancelled.add(id)
        self._keep(id, safe=True)

    def end(
        self, id: str, state: State, message: str, cause: Cause | None = None, **more: object
    ) -> None:
        """End a task, unless it has ended. more: other fields that are known at its end."""
        if state is State.CANCELLED and self.closing.is_set():
            return
        if state is State.SUCCEEDED:
            more["progress"] = 1.0
        with self._lock:
            if self._tasks[id].state.ended or id in self._ends:
                return
            task = self._tasks[id].with_(
                state=state, message=message, cause=cause, ended_s=time.time(), eta_s=None, **more
            )
            self._ends[id] = task
        with self._writing:
            kept = self._store.finish(task_to_proto(task))
        if kept:
            self._tell_end(task)
            return
        with self._lock:
            if id not in self._ends:  # it was published meanwhile
                return
            waits = f"{message}; told as {state} once that is kept: {self._store.fault}"
            self._tasks[id] = self._tasks[id].with_(message=waits, eta_s=None)
            self._unkept.add(id)
        self._publish_present(id)

    def has_ended(self, id: str) -> bool:
        """True if a task has ended, even if that is not published yet."""
        with self._lock:
            return id in self._ends or self._tasks[id].state.ended

    def _tell_end(self, task: Task) -> None:
        with self._lock:
            if self._ends.pop(task.id, None) is None:
                return
            self._tasks[task.id] = task
            self._cancelled.discard(task.id)
        self.publish(TASK, task_to_proto(task))
        self._health.count(f"tasks_{task.state}")
        log.info("task %s %s: %s", task.id, task.state, task.message)

    # --- storing and publishing ----------------------------------------------------------------
    def _keep(self, id: str, safe: bool = False) -> None:
        with self._writing:  # the last write holds the newest state
            with self._lock:
                task = self._to_keep(id)
            if task is None:
                return
            kept = self._store.put(task_to_proto(task), safe)
            with self._lock:
                (self._unkept.discard if kept else self._unkept.add)(id)

    def _to_keep(self, id: str) -> Task | None:
        """Task as the next planner must read it. The caller holds the lock."""
        task = self._ends.get(id) or self._tasks.get(id)
        if task is not None and id in self._cancelled and not task.state.ended:
            task = task.with_(state=State.CANCELLED, message="cancelled", ended_s=time.time())
        return task

    def keep(self, decision: pb.Decision) -> None:
        """Store a decision and publish it. One that cannot be stored now is stored later."""
        if not self._store.add(decision):
            with self._lock:
                self._late.append(decision)
        self.publish(DECISION, decision)

    def _publish_present(self, id: str) -> Task | None:
        """Publish a task as it is now, and return it. An ended one is not published again: its end
        may have come while its earlier state was stored."""
        with self._lock:
            task = self._tasks.get(id)
        if task is not None and not task.state.ended:
            self.publish(TASK, task_to_proto(task))
        return task

    def publish(self, topic: Topic[M], message: M) -> None:
        try:
            self._bus.publish(topic, message)
        except HeliosError as error:
            log.warning("%s was not told: %s", topic.name, error.message)


def _readable(stored: pb.Task) -> Task | None:
    """The stored task; None if this planner cannot read it."""
    try:
        return task_from_proto(stored)
    except ValueError as error:
        log.error("task %s cannot be read (%s): it is left out", stored.id, error)
        return None


def waiting_words(instruction: Instruction, robot_known: bool, reserved: str = "") -> str:
    """Message of a queued task. reserved: why none starts now."""
    words = f"waits for its turn: {reserved}" if reserved else "waits for its turn"
    if not robot_known:
        words += "; the bridge has not described the robot yet"
    if instruction.unused:
        words += f"; not used: {', '.join(f'“{u}”' for u in instruction.unused)}"
    return words


class Reservation:
    """Time in which no task starts, while a client replaces the maps that tasks rely on.

    There is at most one. It expires by itself. The lock of the planner's queue guards it.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._token, self._why, self._ends_s = "", "", 0.0

    @property
    def why(self) -> str:
        """Reason that tasks wait for; empty without a reservation."""
        return self._why if self._token and self._clock() < self._ends_s else ""

    def begin(self, why: str, for_s: float) -> str:
        """Begin a reservation and return its token. Raises InvalidInput, and Conflict
        during another one."""
        if not (math.isfinite(for_s) and 0 < for_s <= LONGEST_RESERVATION_S):
            raise InvalidInput(
                f"for_s is {for_s}; wanted more than 0 and at most {LONGEST_RESERVATION_S:g} s"
            )
        if not 0 < len(why) <= LONGEST_REASON:
            raise InvalidInput(f"why has {len(why)} letters; wanted 1 to {LONGEST_REASON}")
        if self.why:
            raise Conflict(f"{self.why} at this moment; try again when that is over")
        self._token, self._why = uuid.uuid4().hex, why
        self._ends_s = self._clock() + for_s
        return self._token

    def end(self, token: str) -> None:
        """End the reservation; no effect on one that is over."""
        if token == self._token:
            self._token = ""


class TaskReporter:
    """Publishes the progress of one task; called from the worker alone."""

    def __init__(
        self, registry: TaskRegistry, task: Task, settings: Settings, first_decision: int = 0
    ) -> None:
        self._registry, self._id, self._settings = registry, task.id, settings
        self._pace = ProgressEstimate(
            task.instruction.kind, task.max_steps, task.steps, task.progress
        )
        self._ends_s = math.inf  # of the monotonic clock
        if task.time_limit_s:
            left_s = task.started_s + task.time_limit_s - time.time()
            self._ends_s = time.monotonic() + left_s
        self._decisions = first_decision
        self._frame: FrameId | None = None  # the newest
        self._before: str | None = None  # message before a wait

    def on_phase(self, phase: Phase, seeking: str, message: str) -> None:
        self._pace.on_phase(phase)
        self._registry.change(
            self._id, phase=phase, seeking=seeking, message=message, eta_s=self._eta_s()
        )

    def on_steps(self, steps: int) -> None:
        self._pace.on_step(steps, time.monotonic())
        self._registry.change(
            self._id, steps=steps, progress=self._pace.progress, eta_s=self._eta_s()
        )

    def on_picks(self, picks: int) -> None:
        self._registry.change(self._id, picks=picks)

    def on_paused(self, why: str) -> None:
        message = f"the robot is stopped ({why}); clear the stop or cancel the task"
        self._rest(state=State.PAUSED, message=message)

    def on_resumed(self) -> None:
        self._registry.change(self._id, state=State.RUNNING, message="goes on")

    def on_wait(self, what: str | None) -> None:
        """Publish that a service is away; None: it is back, and the earlier message returns."""
        if self._before is None:
            self._before = self._registry.known(self._id).message
        message = self._before if what is None else f"waits for {what}"
        self._rest(message=message)
        if what is None:
            self._before = None

    def on_hold(self, paused: bool) -> None:
        """Publish that the task is paused or goes on."""
        if paused:
            self._rest(state=State.PAUSED, message=HELD)
        else:
            self.on_resumed()

    def on_keyframe(self, frame: FrameId) -> None:
        self._frame = frame

    def on_decision(self, decision: Decision) -> None:
        task = self._registry.known(self._id)
        kept = with_replay_settings(decision, self._settings)
        places = sum(c.kind in PLACES for c in decision.candidates)
        if places:
            self._pace.on_choice(places)
        message = decision_to_proto(kept, task, self._decisions, self._frame, time.time())
        note_decision(self._decisions, decision.rule, decision.do)
        self._decisions += 1
        self._registry.keep(message)

    def on_plan(self, route_m: NDArray[np.float64], goal: Pose2 | None, purpose: str) -> None:
        self._pace.on_way(float(np.hypot(*np.diff(route_m, axis=0).T).sum()) if len(route_m) else 0)
        self._registry.publish(PLAN, plan_to_proto(self._id, route_m, goal, purpose))

    def _rest(self, **changes: object) -> None:
        """Publish a change while the robot stands for an unknown time."""
        self._pace.on_rest()
        self._registry.change(self._id, eta_s=None, **changes)

    def _eta_s(self) -> tuple[float, float] | None:
        return self._pace.eta_s(self._ends_s - time.monotonic())
