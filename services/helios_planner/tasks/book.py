"""The tasks as they are: kept, changed, told, ended, and read again after a restart."""

from __future__ import annotations

import logging
import threading
import time

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import HeliosError, InvalidInput
from helios_core.health import Health
from helios_core.topics import DECISION, TASK, M, Topic

from helios_planner.language.instruction import Instruction
from helios_planner.settings import Settings
from helios_planner.task import HELD, Cause, State, Task
from helios_planner.tasks.store import Store
from helios_planner.tasks.telling import task_from_proto, task_to_proto

log = logging.getLogger(__name__)

UNDER_WAY = (State.RUNNING, State.PAUSED)


class TaskBook:
    """Thread-safe; no lock is held while the bus is used. While `closing` is set, a cancelled task
    is one that the planner left, and `close` ends it."""

    def __init__(self, bus: Bus, settings: Settings, health: Health, store: Store) -> None:
        self._bus, self._settings, self._health, self._store = bus, settings, health, store
        self._lock, self._writing = threading.Lock(), threading.Lock()
        self._tasks: dict[str, Task] = {}
        self._cancelled: set[str] = set()  # running tasks that are to end, but have not yet
        self.closing = threading.Event()

    def restore(self) -> list[str]:
        """Read what was kept; the tasks to do, first what ran when the planner died a moment
        ago. Where that is longer ago, or the planner was stopped, the robot begins nothing by
        itself: what is queued waits to be resumed."""
        away_s = time.time() - self._store.alive_s()
        just_left = away_s <= self._settings.resume_within_s
        again, queued = [], []
        for stored in self._store.tasks():
            task = self._tasks[stored.id] = task_from_proto(stored)
            if task.state is State.QUEUED:
                queued.append(task.id)
                if not (just_left or task.on_hold):
                    self.change(task.id, on_hold=True, message=f"was queued before; {HELD}")
            elif task.state in UNDER_WAY and just_left:
                again.append(task.id)
                state = State.PAUSED if task.on_hold else State.RUNNING
                self.change(task.id, state=state, message="the planner was restarted")
            elif task.state in UNDER_WAY:
                self._leave(task.id, "was away for too long")
        self.pulse()
        return [*again, *queued]

    def pulse(self) -> None:
        """The planner is alive now."""
        self._store.pulse(time.time())

    def close(self) -> None:
        """End what is still under way, and the store."""
        for task in self.tasks():
            if task.state in UNDER_WAY:
                self._leave(task.id, "was stopped")
        self._store.pulse(0.0)
        self._store.close()

    def _leave(self, id: str, why: str) -> None:
        message = f"the planner {why} while the task ran; submit it again"
        self.end(id, State.FAILED, message, Cause.SYSTEM_ERROR)

    # --- one task ------------------------------------------------------------------------------
    def tasks(self) -> list[Task]:
        """All, oldest first."""
        with self._lock:
            return sorted(self._tasks.values(), key=lambda t: t.created_s)

    def known(self, id: str) -> Task:
        """Raises InvalidInput for one that there is not."""
        with self._lock:
            task = self._tasks.get(id)
        if task is None:
            raise InvalidInput(f"there is no task {id[:40]!r}; list them with GET /v1/tasks")
        return task

    def add(self, task: Task) -> pb.Task:
        """A new one; of those that ended long ago the oldest is forgotten."""
        with self._lock:
            self._tasks[task.id] = task
            ended = sorted((t.created_s, t.id) for t in self._tasks.values() if t.state.ended)
            gone = [id for _, id in ended[: -self._settings.keep_tasks]]
            for id in gone:
                del self._tasks[id]
        for id in gone:
            self._store.forget(id)
        return self._tell(task)

    def change(self, id: str, **changes: object) -> Task:
        with self._lock:
            task = self._tasks[id] = self._tasks[id].with_(**changes)
        self._tell(task)
        return task

    def cancel(self, id: str) -> None:
        """A running task is to end. It is kept at once, so that a planner which dies before the
        task obeys does not go on against it."""
        with self._lock:
            self._cancelled.add(id)
        self._keep(id)

    def end(
        self, id: str, state: State, message: str, cause: Cause | None = None, **more: object
    ) -> None:
        """more: other fields of the task, known at its end."""
        if state is State.CANCELLED and self.closing.is_set():
            return
        if state is State.SUCCEEDED:
            more["progress"] = 1.0
        self.change(id, state=state, message=message, cause=cause, ended_s=time.time(), **more)
        self._store.settle(id)
        with self._lock:
            self._cancelled.discard(id)
        self._health.count(f"tasks_{state}")
        log.info("task %s %s: %s", id, state, message)

    # --- telling -------------------------------------------------------------------------------
    def _tell(self, task: Task) -> pb.Task:
        self._keep(task.id)
        told = task_to_proto(task)
        self.publish(TASK, told)
        return told

    def _keep(self, id: str) -> None:
        with self._writing:  # what is written last is what is newest
            with self._lock:
                task, cancelled = self._tasks.get(id), id in self._cancelled
            if task is None:
                return
            if cancelled and not task.state.ended:
                task = task.with_(state=State.CANCELLED, message="cancelled", ended_s=time.time())
            self._store.put(task_to_proto(task))

    def keep(self, decision: pb.Decision) -> None:
        """Store a decision and tell it."""
        self._store.add(decision)
        self.publish(DECISION, decision)

    def publish(self, topic: Topic[M], message: M) -> None:
        try:
            self._bus.publish(topic, message)
        except HeliosError as error:
            log.warning("%s was not told: %s", topic.name, error.message)


def waiting_words(instruction: Instruction, robot_known: bool) -> str:
    """What a queued task says of itself."""
    words = "waits for its turn"
    if not robot_known:
        words += "; the bridge has not described the robot yet"
    if instruction.unused:
        words += f"; not used: {', '.join(f'“{u}”' for u in instruction.unused)}"
    return words
