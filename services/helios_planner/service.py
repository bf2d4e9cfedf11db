"""The planner's shell: tasks come over the bus, one worker does them, everybody is told."""

from __future__ import annotations

import logging
import threading
import time
import uuid
from collections import deque

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import context_to_proto
from helios_core.errors import DeadlineExceeded, HeliosError, InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.topics import (
    CANCEL,
    CONTEXT,
    DECISION,
    DECISIONS,
    GET_TASK,
    LIST_TASKS,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    PLAN,
    ROBOT_DESCRIPTION,
    SUBMIT,
    TASK,
    VOCABULARY,
    M,
    Topic,
)

from helios_planner.acks import AckBook
from helios_planner.agents import agent_named
from helios_planner.bus_body import BusBody
from helios_planner.calls import patiently
from helios_planner.context import check_able, in_vocabulary, search_context
from helios_planner.flow import Mission
from helios_planner.instruction import Instruction
from helios_planner.language_model import LanguageModel, parse_with_help
from helios_planner.motion import warm_up
from helios_planner.recompute import changes_of, recompute
from helios_planner.settings import Settings
from helios_planner.store import Store
from helios_planner.task import Cause, State, Task, TaskCancelled, TaskFailed
from helios_planner.telling import (
    decision_from_proto,
    recomputed_to_proto,
    task_from_proto,
    task_to_proto,
)
from helios_planner.voice import TaskVoice

log = logging.getLogger(__name__)

VOCABULARY_S = 1.5  # longest wait at submission; the worker asks again with patience


def language_model(settings: Settings) -> LanguageModel | None:
    """The model that the settings name."""
    s = settings
    key = s.llm_key.get_secret_value()
    return LanguageModel(s.llm_url, s.llm_model, key, s.llm_timeout_s) if s.llm_url else None


def waiting_words(instruction: Instruction) -> str:
    """What a queued task says of itself."""
    words = "waits for its turn"
    if instruction.unused:
        words += f"; not used: {', '.join(f'“{u}”' for u in instruction.unused)}"
    return words


class PlannerService:
    """See the module. `_lock` guards the tasks; it is never held across a call to the bus."""

    def __init__(self, bus: Bus, settings: Settings, health: Health) -> None:
        self._bus, self._settings, self._health = bus, settings, health
        self._lock = threading.Lock()
        self._wake = threading.Condition(self._lock)
        self._tasks: dict[str, Task] = {}
        self._queue: deque[str] = deque()
        self._cancels: dict[str, threading.Event] = {}
        self._description: pb.RobotDescription | None = None
        self._described, self._warm = threading.Event(), threading.Event()
        self._ending = threading.Event()
        self._acks = AckBook()
        self._store = Store(settings.state_dir, settings.keep_decisions)
        self._model = language_model(settings)
        self._restore()
        bus.subscribe(ROBOT_DESCRIPTION, self._on_description)
        bus.subscribe(MAP2D_ACK, self._acks.add)
        bus.subscribe(OBJECTMAP_ACK, self._acks.add)
        bus.serve(SUBMIT, self.submit)
        bus.serve(GET_TASK, self.get)
        bus.serve(LIST_TASKS, self.list_tasks)
        bus.serve(CANCEL, self.cancel)
        bus.serve(DECISIONS, self.decisions)
        self._worker = threading.Thread(target=self._work, name="worker", daemon=True)
        self._worker.start()
        self._tell_health()

    def close(self) -> None:
        """Ends within an action; the running task becomes a system error at the next start."""
        self._ending.set()
        with self._lock:
            for event in self._cancels.values():
                event.set()
            self._wake.notify_all()
        self._worker.join(1.5)
        self._store.close()

    # --- methods -------------------------------------------------------------------------------
    def submit(self, request: pb.SubmitRequest) -> pb.Task:
        instruction = parse_with_help(request.instruction, self._model)
        agent = request.agent or self._settings.agent
        agent_named(agent)
        try:
            instruction = in_vocabulary(
                instruction, self._bus.call(VOCABULARY, pb.Empty(), VOCABULARY_S)
            )
        except (Unavailable, DeadlineExceeded) as error:
            log.info("the names are checked when the task starts: %s", error.message)
        if self._description is not None:
            check_able(instruction, self._description)
        id = uuid.uuid4().hex[:12]
        task = Task(
            id=id,
            text=request.instruction,
            instruction=instruction,
            state=State.QUEUED,
            max_steps=request.max_steps or self._settings.max_steps,
            created_s=time.time(),
            message=waiting_words(instruction),
            context_id=id,
            agent=agent,
        )
        with self._lock:
            self._tasks[id] = task
            self._cancels[id] = threading.Event()
        told = self._tell(task)  # before the worker can tell that it runs
        with self._lock:
            self._queue.append(id)
            self._wake.notify_all()
        return told

    def get(self, request: pb.TaskRequest) -> pb.Task:
        return task_to_proto(self.known(request.id))

    def list_tasks(self, _: pb.Empty) -> pb.TaskList:
        with self._lock:
            tasks = sorted(self._tasks.values(), key=lambda t: t.created_s)
        return pb.TaskList(tasks=[task_to_proto(t) for t in tasks])

    def cancel(self, request: pb.TaskRequest) -> pb.Task:
        """A queued task ends at once, a running one within its present action."""
        task = self.known(request.id)
        with self._lock:
            queued = request.id in self._queue
            if queued:
                self._queue.remove(request.id)
            if event := self._cancels.get(request.id):
                event.set()
        if queued:
            task = self.change(request.id, state=State.CANCELLED, message="cancelled before it "
                                "began", ended_s=time.time())  # fmt: skip
        return task_to_proto(task)

    def decisions(self, request: pb.TaskRequest) -> pb.DecisionList:
        """All that were kept; with settings, each with what it would have been under them."""
        self.known(request.id)
        kept = self._store.decisions(request.id)
        if request.settings:
            changes = changes_of(request.settings)
            for decision in kept:
                again = recompute(decision_from_proto(decision), changes)
                decision.recomputed.CopyFrom(recomputed_to_proto(again))
        return pb.DecisionList(decisions=kept)

    # --- the worker ----------------------------------------------------------------------------
    def _work(self) -> None:
        warm_up()
        self._warm.set()
        self._tell_health()
        while (id := self._next()) is not None:
            try:
                self._run(id)
            except Exception as error:
                if self._ending.is_set():
                    return
                log.exception("task %s ended by a fault", id)
                self._end(
                    id, State.FAILED, f"a fault in the planner: {error!r}", Cause.SYSTEM_ERROR
                )
            self.publish(PLAN, pb.Plan(task_id=id))

    def _next(self) -> str | None:
        """The next task in the queue, once the robot is known; None at the end."""
        while not self._described.wait(0.2):
            if self._ending.is_set():
                return None
        with self._lock:
            while not self._queue and not self._ending.is_set():
                self._wake.wait(0.5)
            return None if self._ending.is_set() else self._queue.popleft()

    def _run(self, id: str) -> None:
        cancelled = self._cancels[id]
        task = self.change(id, state=State.RUNNING, started_s=time.time(), message="starting")
        body: BusBody | None = None
        try:
            assert self._description is not None
            task = self._named(id, task, cancelled)
            check_able(task.instruction, self._description)
            context = search_context(task.context_id, task.instruction, self._settings)
            self._bus.publish(CONTEXT, context_to_proto(context))
            body = BusBody(
                self._bus, self._settings, self._description, self._acks, id, context.id,
                task.max_steps, TaskVoice(self, id, self._settings), cancelled,
                agent_named(task.agent).belief.answered,
            )  # fmt: skip
            body.begin()
            message = Mission(body, task.instruction, self._settings, task.agent).run()
            if body.collisions:
                message += f" (with {body.collisions} contacts on the way)"
            self._end(id, State.SUCCEEDED, message)
        except TaskCancelled:
            if not self._ending.is_set():
                self._end(id, State.CANCELLED, "cancelled; the robot stands")
        except TaskFailed as failure:
            cause, message = failure.cause, failure.message
            if cause is not Cause.SYSTEM_ERROR and body is not None and body.collisions:
                message += f" ({body.collisions} contacts on the way)"
            self._end(id, State.FAILED, message, cause)
        except HeliosError as error:
            self._end(id, State.FAILED, error.message, Cause.SYSTEM_ERROR)
        finally:
            if body is not None:
                body.end()

    def _named(self, id: str, task: Task, cancelled: threading.Event) -> Task:
        """The task in the detector's names; waits for a detector that is away."""

        def rest(seconds: float) -> None:
            if cancelled.wait(seconds):
                raise TaskCancelled

        vocabulary = patiently(
            lambda: self._bus.call(VOCABULARY, pb.Empty(), self._settings.call_timeout_s),
            self._settings.away_s, rest,
        )  # fmt: skip
        return self.change(id, instruction=in_vocabulary(task.instruction, vocabulary))

    # --- state of tasks ------------------------------------------------------------------------
    def _restore(self) -> None:
        """Queued tasks wait on; what was running cannot be taken up again."""
        for stored in self._store.tasks():
            task = task_from_proto(stored)
            if task.state in (State.RUNNING, State.PAUSED):
                task = task.with_(
                    state=State.FAILED, cause=Cause.SYSTEM_ERROR, ended_s=time.time(),
                    message="the planner was restarted while the task ran; submit it again",
                )  # fmt: skip
                self._store.put(task_to_proto(task))
            self._tasks[task.id] = task
            if task.state is State.QUEUED:
                self._cancels[task.id] = threading.Event()
                self._queue.append(task.id)

    def known(self, id: str) -> Task:
        with self._lock:
            task = self._tasks.get(id)
        if task is None:
            raise InvalidInput(f"there is no task {id!r}; list them with GET /v1/tasks")
        return task

    def change(self, id: str, **changes: object) -> Task:
        with self._lock:
            task = self._tasks[id] = self._tasks[id].with_(**changes)
        self._tell(task)
        return task

    def _end(self, id: str, state: State, message: str, cause: Cause | None = None) -> None:
        done = {"progress": 1.0} if state is State.SUCCEEDED else {}
        self.change(id, state=state, message=message, cause=cause, ended_s=time.time(), **done)
        with self._lock:
            self._cancels.pop(id, None)
        self._health.count(f"tasks_{state}")
        log.info("task %s %s: %s", id, state, message)

    def _tell(self, task: Task) -> pb.Task:
        told = task_to_proto(task)
        self._store.put(told)
        self.publish(TASK, told)
        return told

    def keep(self, decision: pb.Decision) -> None:
        """Store a decision and tell it."""
        self._store.add(decision)
        self.publish(DECISION, decision)

    def publish(self, topic: Topic[M], message: M) -> None:
        try:
            self._bus.publish(topic, message)
        except HeliosError as error:
            log.warning("%s was not told: %s", topic.name, error.message)

    def _on_description(self, description: pb.RobotDescription) -> None:
        self._description = description
        self._described.set()
        self._tell_health()

    def _tell_health(self) -> None:
        if not self._warm.is_set():
            self._health.waiting("compiles its path planner; seconds at the first start")
        elif not self._described.is_set():
            self._health.waiting("waits for the bridge to describe the robot")
        else:
            self._health.ready()
