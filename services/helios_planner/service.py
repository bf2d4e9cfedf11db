"""The planner service: receives tasks over the bus, runs them in one worker and publishes them."""

from __future__ import annotations

import logging
import math
import re
import threading
import time
import uuid
from collections import deque

from helios_core import proto as pb
from helios_core import tracing
from helios_core.agent_presets import AGENT_NAMES
from helios_core.bus import Bus
from helios_core.errors import Conflict, DeadlineExceeded, InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.keyframe_acks import KeyframeAcks
from helios_core.name_rules import same_name
from helios_core.plugins import AGENTS
from helios_core.printable_text import counted
from helios_core.service_process import until_warm
from helios_core.topics import (
    CANCEL,
    CHECK,
    DECISIONS,
    GET_TASK,
    LIST_TASKS,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    PAUSE,
    PLAN,
    RESERVE,
    RESUME,
    ROBOT_DESCRIPTION,
    SUBMIT,
    VOCABULARY,
)

from helios_planner.agents import agent_named, fault_of
from helios_planner.decisions.counterfactual import changes_of, recompute
from helios_planner.instruction.language_model import language_model
from helios_planner.instruction.parser import Instruction, parse_with_help
from helios_planner.settings import Settings, for_task
from helios_planner.task import HELD, Cause, State, Task
from helios_planner.tasks.executor import TaskExecutor
from helios_planner.tasks.messages import decision_from_proto, recomputed_to_proto, task_to_proto
from helios_planner.tasks.registry import Reservation, TaskRegistry, waiting_words
from helios_planner.tasks.run_control import PauseControl
from helios_planner.tasks.search_context import check_able, in_vocabulary
from helios_planner.tasks.started_agents import (
    OBJECT_MAP_SETTINGS,
    reported_agent,
    started_for_another,
)
from helios_planner.tasks.store import Store
from helios_planner.warm_up import warm_up

log = logging.getLogger(__name__)

MOST_PRIORITY = 100
ALIVE_EVERY_S = 5.0
MEND_S = 1.0  # period of retries while tasks cannot be stored
SETTINGS_S = 1.0
TASK_ID = re.compile("[0-9a-f]{8,32}")  # ids that a client may choose
VOCABULARY_S = 1.5  # longest wait at submission; the worker waits longer


class PlannerService:
    """Service object of the planner. `_lock` guards the queue; no call to the bus runs under it."""

    def __init__(self, bus: Bus, settings: Settings, health: Health) -> None:
        """Raises InvalidInput if the agent of the settings cannot be loaded."""
        agent_named(settings.agent)
        self._bus, self._settings, self._health = bus, settings, health
        self._lock = threading.Lock()
        self._submitting = threading.Lock()  # orders requests that name the id of their task
        self._wake = threading.Condition(self._lock)
        self._description: pb.RobotDescription | None = None
        self._described, self._warm = threading.Event(), threading.Event()
        self._ending = threading.Event()
        self._acks = KeyframeAcks()
        self._store = Store(settings.state_dir)
        self._model = language_model(settings)
        self._registry = TaskRegistry(bus, settings, health, self._store)
        self._store.watch(self._tell_health)
        self._queue = deque(self._registry.restore())
        self._arriving = 0  # tasks that are being stored and have a place in the queue
        self._tell_waiting()
        self._cancels = {id: threading.Event() for id in self._queue}
        self._holds = {id: self._new_hold(id) for id in self._queue if self._is_under_way(id)}
        self._reservation = Reservation()  # guarded by _lock
        bus.subscribe(ROBOT_DESCRIPTION, self._on_description)
        bus.subscribe(MAP2D_ACK, self._acks.add)
        bus.subscribe(OBJECTMAP_ACK, self._acks.add)
        bus.serve(SUBMIT, self.submit)
        bus.serve(CHECK, self.check)
        bus.serve(GET_TASK, self.get)
        bus.serve(LIST_TASKS, self.list_tasks)
        bus.serve(CANCEL, self.cancel)
        bus.serve(PAUSE, self.pause)
        bus.serve(RESUME, self.resume)
        bus.serve(DECISIONS, self.decisions)
        bus.serve(RESERVE, self.reserve)
        self._worker = threading.Thread(target=self._work, name="worker", daemon=True)
        self._worker.start()
        self._alive_thread = threading.Thread(target=self._note_alive, name="alive", daemon=True)
        self._alive_thread.start()
        self._tell_health()

    def close(self) -> None:
        """Stop within one action. A running task ends: only a crashed planner's task is resumed."""
        self._ending.set()
        self._registry.closing.set()
        with self._lock:
            for event in self._cancels.values():
                event.set()
            self._wake.notify_all()
        self._worker.join(1.5)
        self._alive_thread.join(1.5)
        self._registry.close()

    # --- methods -------------------------------------------------------------------------------
    def submit(self, request: pb.SubmitRequest) -> pb.Task:
        """Store a task, queue it and return it. A request for the id of a known task returns that
        task. Raises Unavailable while tasks cannot be stored."""
        if tracing.current_traceparent():
            return self._submit(request)
        with tracing.span(SUBMIT.name):  # begins the task's trace
            return self._submit(request)

    def _submit(self, request: pb.SubmitRequest) -> pb.Task:
        self._registry.check_keeping()
        if not request.id:
            return self._add(self._drafted(request, uuid.uuid4().hex[:12]))
        if not TASK_ID.fullmatch(request.id):
            raise InvalidInput(
                f"id is {request.id[:40]!r}; wanted 8 to 32 lower-case hexadecimal digits"
            )
        if (known := self._registry.find(request.id)) is not None:
            return known
        drafted = self._drafted(request, request.id)
        with self._submitting:
            known = self._registry.find(request.id)
            return self._add(drafted) if known is None else known

    def check(self, request: pb.SubmitRequest) -> pb.Task:
        """The task that a request would add now; nothing is queued.

        Raises InvalidInput, and Conflict for an agent that cannot run.
        """
        return task_to_proto(self._drafted(request, request.id))

    def _drafted(self, request: pb.SubmitRequest, id: str) -> Task:
        """Task of a request. Raises InvalidInput, and Conflict for an agent that cannot run."""
        instruction = parse_with_help(request.instruction, self._model)
        agent = self._known_agent(request.agent or self._settings.agent)
        for_task(self._settings, request.settings)
        if abs(request.priority) > MOST_PRIORITY:
            raise InvalidInput(
                f"priority is {request.priority}; wanted {-MOST_PRIORITY} to {MOST_PRIORITY}"
            )
        if not (math.isfinite(request.time_limit_s) and request.time_limit_s >= 0):
            raise InvalidInput(
                f"time_limit_s is {request.time_limit_s}; wanted seconds, or 0 for the setting"
            )
        try:
            if not instruction.kind.only_moves:
                vocabulary = self._bus.call(VOCABULARY, pb.Empty(), VOCABULARY_S)
                instruction = in_vocabulary(instruction, vocabulary)
        except (Unavailable, DeadlineExceeded) as error:
            log.info("the names are checked when the task starts: %s", error.message)
        if self._description is not None:
            check_able(instruction, self._description)
        words = HELD if request.on_hold else self._waiting_words(instruction)
        return Task(
            id=id,
            text=" ".join(request.instruction.split()),  # one line
            instruction=instruction,
            state=State.QUEUED,
            max_steps=request.max_steps or self._settings.max_steps,
            time_limit_s=request.time_limit_s or instruction.limit_s or self._settings.time_limit_s,
            created_s=time.time(),
            message=words,
            context_id=id,
            agent=agent,
            priority=request.priority,
            settings=dict(request.settings),
            traceparent=tracing.current_traceparent(),
            on_hold=request.on_hold,
        )

    def _add(self, task: Task) -> pb.Task:
        """Store, publish and queue a new task. One that is cancelled meanwhile ends instead. Raises
        Conflict if too many wait."""
        id, most = task.id, self._settings.max_waiting
        with self._lock:
            if len(self._queue) + self._arriving >= most:
                raise Conflict(
                    f"{most} tasks wait already, the most that this planner takes "
                    "(planner.max_waiting): cancel some, or submit it again once they have run"
                )
            self._arriving += 1
            cancelled = self._cancels[id] = threading.Event()
        try:
            added = self._registry.add(task)  # before the worker can publish it as running
        except BaseException:
            with self._lock:
                self._arriving -= 1
                self._cancels.pop(id, None)
            raise
        with self._lock:
            self._arriving -= 1
            queued = not cancelled.is_set()
            if queued:
                self._queue.append(id)
                self._tell_waiting()
                self._wake.notify_all()
            else:
                self._cancels.pop(id, None)
        return added if queued else self._end_queued(id)

    def _tell_waiting(self) -> None:
        self._health.set("tasks_waiting", len(self._queue))

    def _waiting_words(self, instruction: Instruction) -> str:
        with self._lock:
            why = self._reservation.why
        return waiting_words(instruction, self._description is not None, why)

    def _known_agent(self, said: str) -> str:
        """The agent's name as listed; `said` may have any case. Raises InvalidInput for an
        unknown agent or one that no task may name, and Conflict for one that needs other settings
        than the services have."""
        listed = dict.fromkeys((*AGENT_NAMES, *AGENTS.entry_names(), self._settings.agent))
        name = same_name(said, listed) or said
        if self._settings.agents_of_tasks == "listed" and name not in listed:
            raise InvalidInput(
                f"there is no agent {name[:80]!r} for tasks here; choose one of "
                f"{', '.join(listed)}; one of your own is started with the planner "
                f"(helios up --agent {name[:80]}), or allowed to tasks with "
                "HELIOS_PLANNER_AGENTS_OF_TASKS=any"
            )
        agent_named(name)
        if said := self._started_for_another(name):
            raise Conflict(said)
        return name

    def _started_for_another(self, agent: str) -> str:
        """See `started_for_another`. An object map that does not answer at once is asked again when
        the task starts."""
        try:
            object_map = reported_agent(self._bus.call(OBJECT_MAP_SETTINGS, pb.Empty(), SETTINGS_S))
        except (Unavailable, DeadlineExceeded) as error:
            log.info("the agent of the object map is checked when the task starts: %s", error)
            object_map = ""
        return started_for_another(agent, self._settings.agent, object_map)

    def get(self, request: pb.TaskRequest) -> pb.Task:
        return task_to_proto(self._registry.known(request.id))

    def list_tasks(self, _: pb.Empty) -> pb.TaskList:
        return pb.TaskList(tasks=[task_to_proto(t) for t in self._registry.tasks()])

    def cancel(self, request: pb.TaskRequest) -> pb.Task:
        """End a queued task at once, a running one within its current action."""
        task = self._registry.known(request.id)
        with self._lock:
            queued = request.id in self._queue
            if queued:
                self._queue.remove(request.id)
                self._tell_waiting()
                self._holds.pop(request.id, None)
            if event := self._cancels.get(request.id):
                event.set()
            if queued:
                self._cancels.pop(request.id, None)
        if queued:
            return self._end_queued(request.id)
        if not task.state.ended:
            self._registry.cancel(request.id)
        return task_to_proto(task)

    def _end_queued(self, id: str) -> pb.Task:
        """End a cancelled task that no worker has, and return it."""
        task = self._registry.known(id)
        begun = task.state.under_way
        when = f"after {counted(task.steps, 'step')}" if begun else "before it began"
        self._registry.end(id, State.CANCELLED, f"cancelled {when}")
        return task_to_proto(self._registry.known(id))

    def pause(self, request: pb.TaskRequest) -> pb.Task:
        """Pause a task: the current action finishes, and no other begins until `resume`. A queued
        task does not start until then."""
        return self._set_on_hold(request.id, True)

    def resume(self, request: pb.TaskRequest) -> pb.Task:
        return self._set_on_hold(request.id, False)

    def decisions(self, request: pb.TaskRequest) -> pb.DecisionList:
        """All stored decisions of a task; with settings, each also as recomputed under them, unless
        another version stored it in another form."""
        self._registry.known(request.id)
        changes = changes_of(request.settings)
        kept = self._store.decisions(request.id)
        if changes:
            for decision in kept:
                try:
                    again = recompute(decision_from_proto(decision), changes)
                except (ValueError, LookupError) as error:
                    what = f"decision {decision.index} of task {request.id}"
                    log.warning("%s cannot be recomputed: %r", what, error)
                    continue
                decision.recomputed.CopyFrom(recomputed_to_proto(again))
        return pb.DecisionList(decisions=kept)

    def reserve(self, request: pb.ReserveRequest) -> pb.ReserveReply:
        """Reserve the planner: no task starts until the reservation ends. With a token, end that
        one. Raises Conflict while a task is queued or running; the queue's lock orders the two."""
        with self._lock:
            if request.token:
                self._reservation.end(request.token)
                self._wake.notify_all()
                return pb.ReserveReply()
            for task in self._registry.tasks():
                if not task.state.ended:
                    raise Conflict(
                        f"task {task.id} is {task.state} and relies on the present maps; wait for "
                        "its end, or cancel it"
                    )
            return pb.ReserveReply(token=self._reservation.begin(request.why, request.for_s))

    # --- the worker ----------------------------------------------------------------------------
    def _work(self) -> None:
        if not until_warm(self._health, warm_up, self._ending):
            return
        self._warm.set()
        self._tell_health()
        while (id := self._next()) is not None:
            try:
                traceparent = self._registry.known(id).traceparent
                with tracing.span("task", task=id, parent=traceparent):
                    self._run(id)
            except (Exception, SystemExit) as error:  # a custom agent may raise anything
                if self._ending.is_set():
                    return
                log.exception("task %s ended by a fault", id)
                said = fault_of(self._registry.known(id).agent, error)
                self._registry.end(id, State.FAILED, said, Cause.SYSTEM_ERROR)
            self._registry.publish(PLAN, pb.Plan(task_id=id))

    def _next(self) -> str | None:
        """Next task of the queue, once the robot is known; None when the planner ends."""
        while not self._described.wait(0.2):
            if self._ending.is_set():
                return None
        with self._lock:
            while (
                self._store.fault
                or self._reservation.why
                or not (ready := [id for id in self._queue if self._may_go(id)])
            ):
                if self._ending.is_set():
                    return None
                self._wake.wait(0.5)
            if self._ending.is_set():
                return None
            id = max(ready, key=self._rank)  # the first of equal ones
            self._queue.remove(id)
            self._tell_waiting()
            return id

    def _may_go(self, id: str) -> bool:
        """True if a task may start. An interrupted task may although it is on hold: its last action
        must be settled."""
        return self._is_under_way(id) or not self._registry.known(id).on_hold

    def _is_under_way(self, id: str) -> bool:
        return self._registry.known(id).state.under_way

    def _rank(self, id: str) -> tuple[bool, int]:
        """Sort key in the queue: interrupted tasks before new ones, then by priority."""
        task = self._registry.known(id)
        return task.state.under_way, task.priority

    def _run(self, id: str) -> None:
        assert self._description is not None
        try:
            task = self._registry.known(id)
            began_s = task.started_s or time.time()
            word = "goes on where it was" if task.started_s else "starting"
            state = State.PAUSED if task.on_hold else State.RUNNING
            word = HELD if task.on_hold else word
            task = self._registry.change(id, state=state, started_s=began_s, message=word)
            cancelled = self._cancels[id]
            with self._lock:
                hold = self._holds.setdefault(id, self._new_hold(id))
            TaskExecutor(
                self._bus,
                for_task(self._settings, task.settings),
                self._description,
                self._acks,
                self._store,
                self._registry,
                task,
                cancelled,
                hold,
            ).run()
        finally:
            with self._lock:
                self._holds.pop(id, None)
                self._cancels.pop(id, None)

    def _new_hold(self, id: str) -> PauseControl:
        """Pause control of a task that has begun; paused if the task is on hold."""
        task = self._registry.known(id)
        cancelled = self._cancels[id]
        hold = PauseControl(task.time_limit_s, task.started_s + task.time_limit_s, cancelled)
        if task.on_hold:
            hold.pause()
        return hold

    def _set_on_hold(self, id: str, on_hold: bool) -> pb.Task:
        """Store the pause or its end, then apply it. Raises Conflict for a task that has ended."""
        task = self._registry.known(id)
        if self._registry.has_ended(id):
            what = "paused" if on_hold else "resumed"
            how = f"is {task.state}" if task.state.ended else "has ended"
            raise Conflict(f"task {id} {how}; what has ended cannot be {what}")
        changes: dict[str, object] = {"on_hold": on_hold}
        with self._lock:
            if id in self._queue:
                why = self._reservation.why
                words = waiting_words(task.instruction, self._description is not None, why)
                changes["message"] = HELD if on_hold else words
                if task.state.under_way:
                    changes["state"] = State.PAUSED if on_hold else State.RUNNING
        changed = self._registry.change(id, **changes)
        with self._lock:
            if hold := self._holds.get(id):  # another request may have set the opposite meanwhile
                (hold.pause if self._registry.known(id).on_hold else hold.resume)()
            self._wake.notify_all()
        return task_to_proto(changed)

    def _note_alive(self) -> None:
        """Store periodically that the planner is alive, so that the next one knows how long none
        was. While tasks cannot be stored, retry that."""
        while not self._ending.wait(MEND_S if self._store.fault else ALIVE_EVERY_S):
            if self._store.fault:
                self._registry.mend()
            else:
                self._registry.note_alive()

    def _on_description(self, description: pb.RobotDescription) -> None:
        self._description = description
        self._described.set()
        self._tell_health()

    def _tell_health(self) -> None:
        if not self._warm.is_set():
            self._health.waiting("compiles its path planner; seconds at the first start")
        elif fault := self._store.fault:
            self._health.degraded(f"{fault}; until then no task and no action is begun")
        elif not self._described.is_set():
            self._health.waiting("waits for the bridge to describe the robot")
        else:
            self._health.ready(self._store.said)
