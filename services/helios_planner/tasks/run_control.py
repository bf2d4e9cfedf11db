"""Controls one running task: its journal before every action, pause, time limit, and recovery.

A journal entry holds the newest action, its id, its result, and the memory of the mission. A
planner that takes the task up again repeats that action under the same id. The bridge carries out
an id once, so no action is repeated and none is left out.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import action_from_proto, state_from_proto
from helios_core.errors import Conflict, DeadlineExceeded, Unavailable
from helios_core.robot import Action
from helios_core.topics import ACT, GET_STATE, LEASE, Method, Rep, Req
from helios_core.types import RobotState

from helios_planner.robot.rpc import HOLDER, RETRY_S, RobotConnection, number_of
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskCancelled, TaskFailed, TimeIsUp
from helios_planner.tasks.registry import TaskReporter
from helios_planner.tasks.store import Entry, Memory, Store

log = logging.getLogger(__name__)


class Journal:
    """Of one running task; used by its worker alone. `memory` gives what the mission remembers."""

    def __init__(self, store: Store, task_id: str, entry: Entry) -> None:
        self._store, self.task_id, self.entry = store, task_id, entry
        self.memory: Callable[[], Memory] = lambda: self.entry.memory

    @property
    def is_settled(self) -> bool:
        """Whether it is known what came of the newest action."""
        return self.entry.request is None or self.entry.result is not None

    @property
    def fault(self) -> str:
        """Why nothing can be kept now."""
        return self._store.fault

    def before(self, request: pb.ActionRequest) -> bool:
        """Whether an action is written down, so that it may begin."""
        entry = replace(self.entry, request=request, result=None, memory=self.memory())
        if not self._store.keep(self.task_id, entry):
            return False
        self.entry = entry
        return True

    def after(self, result: pb.ActionResult) -> None:
        epoch = self.entry.epoch
        if result.HasField("keyframe"):
            epoch = (result.keyframe.robot_boot_id, result.keyframe.world_epoch)
        self._keep(replace(self.entry, result=result, epoch=epoch))

    def note(self) -> None:
        """What is remembered now."""
        self._keep(replace(self.entry, memory=self.memory()))

    def _keep(self, entry: Entry) -> None:
        self.entry = entry
        self._store.keep(self.task_id, entry)


class TaskCalls:
    """The calls of one task: they end in time, begin no action while it is paused, and have every
    action in the journal before the robot is asked for it."""

    def __init__(
        self, bus: Bus, journal: Journal, hold: PauseControl, reporter: TaskReporter,
        keep_within_s: float,
    ) -> None:  # fmt: skip
        """keep_within_s: for how long an action may wait until it can be written down."""
        self._bus, self._journal, self._hold, self._reporter = bus, journal, hold, reporter
        self._keep_within_s = keep_within_s
        self.held_s = 0.0  # for how long the pauses lasted that calls had to wait for

    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep:
        if isinstance(request, pb.LeaseRequest) and request.release_token:
            return self._bus.call(method, request, timeout_s)  # also when its time is over
        self._hold.check()
        if not isinstance(request, pb.ActionRequest) or method.name != ACT.name:
            return self._bus.call(method, request, timeout_s)
        since_s = time.monotonic()
        self._written_down(request)
        self.held_s += time.monotonic() - since_s
        reply = self._bus.call(method, request, timeout_s)
        assert isinstance(reply, pb.ActionResult)
        self._journal.after(reply)
        return reply

    def _written_down(self, request: pb.ActionRequest) -> None:
        """Return when an action has begun: the journal has it, written while the task was not
        paused. Raises TaskFailed where the journal cannot take it for too long."""
        faulty_s = 0.0
        while True:
            self._hold.wait(self._reporter.on_hold)
            written = self._hold.begin(lambda: self._journal.before(request))
            if written:
                break
            if written is None:  # paused since the wait
                continue
            if faulty_s > self._keep_within_s:
                raise TaskFailed(
                    Cause.SYSTEM_ERROR,
                    f"the robot stood for {faulty_s:.0f} s, since its next action could not be "
                    f"written down: {self._journal.fault}; then submit the task again",
                )
            if not faulty_s:
                self._reporter.on_wait(f"its journal: {self._journal.fault}")
            began_s = time.monotonic()
            self._hold.rest(RETRY_S)
            faulty_s += time.monotonic() - began_s
        if faulty_s:
            self._reporter.on_wait(None)


class PauseControl:
    """Of one running task. Thread-safe: asked by its worker, set from anywhere."""

    def __init__(self, limit_s: float, ends_s: float, cancelled: threading.Event) -> None:
        """limit_s: as it was asked for, 0 for none; ends_s: when it is over, seconds since 1970."""
        self._limit_s, self._ends_s, self._cancelled = limit_s, ends_s, cancelled
        self._go = threading.Event()
        self._go.set()
        self._turn = threading.Lock()  # orders pauses and the beginnings of actions

    def pause(self) -> None:
        """When this returns, no action is begun until `resume`; one that was begun goes on."""
        with self._turn:
            self._go.clear()

    def resume(self) -> None:
        with self._turn:
            self._go.set()

    @property
    def paused(self) -> bool:
        return not self._go.is_set()

    def begin(self, start: Callable[[], bool]) -> bool | None:
        """What `start` returns, which is called unless paused; None where paused. A pause that is
        asked for meanwhile waits until `start` has returned."""
        with self._turn:
            return None if self.paused else start()

    def check(self) -> None:
        """Raises TimeIsUp when the task's time is over; its cause is that of the step budget."""
        if self._limit_s and time.time() > self._ends_s:
            raise TimeIsUp(f"the task's {self._limit_s:g} s are used up")

    def wait(self, tell: Callable[[bool], None]) -> None:
        """While paused: tell so, and wait. Raises TaskCancelled and TaskFailed."""
        if not self.paused:
            return
        tell(True)
        while not self._go.wait(0.1):
            self._check_all()
        tell(False)

    def rest(self, seconds: float) -> None:
        """Wait so long. Raises TaskCancelled and TaskFailed."""
        self._cancelled.wait(seconds)
        self._check_all()

    def _check_all(self) -> None:
        if self._cancelled.is_set():
            raise TaskCancelled
        self.check()


@dataclass(frozen=True)
class LastAction:
    """The newest action that the robot was asked for; succeeded: None where it was refused, and
    what the robot holds says more."""

    action: Action | None
    succeeded: bool | None
    reason: str
    held: str


def last_action(
    line: RobotConnection,
    settings: Settings,
    journal: Journal,
    held_s: Callable[[], float] = lambda: 0.0,
) -> LastAction:
    """Settle what was in flight, and say what came of it. held_s: for how long somebody has paused
    the task until now, which is nobody's fault.

    Raises TaskFailed when the robot is not in the world that the journal speaks of, or has done
    more of this task than the journal knows.
    """
    _same_world(line, journal)
    _not_stale(_state(line).last_action_id, journal)
    entry = journal.entry
    request, result = entry.request, entry.result
    if request is not None and result is None:
        result = _again(line, settings, journal, request, held_s)
    held = _state(line).held
    action = action_from_proto(request.action) if request is not None else None
    if result is None:
        return LastAction(action, None, "", held)
    return LastAction(action, result.succeeded, result.reason, held)


def _same_world(line: RobotConnection, journal: Journal) -> None:
    epoch = journal.entry.epoch
    state = _state(line)
    now = (state.robot_boot_id, state.world_epoch)
    if epoch is not None and epoch[0] and now != epoch:
        raise TaskFailed(
            Cause.SYSTEM_ERROR,
            "the robot restarted or its localisation jumped while the planner was away; submit the "
            "task again",
        )


def _not_stale(done: str, journal: Journal) -> None:
    """done: id of the action that the robot did last, of whatever task."""
    known = journal.entry.request
    if done.startswith((f"{journal.task_id}-", f"{journal.task_id}.")) and (
        known is None or number_of(done) > number_of(known.action_id)
    ):
        raise TaskFailed(
            Cause.SYSTEM_ERROR,
            f"the robot has done action {done} of this task, which is not in the journal (the "
            "computer lost power, or its disk was full): how far the task came is not known; see "
            "what the robot holds, and submit the task again",
        )


def _state(line: RobotConnection) -> RobotState:
    return state_from_proto(line.call(GET_STATE, pb.Empty()))


def _again(
    line: RobotConnection,
    settings: Settings,
    journal: Journal,
    request: pb.ActionRequest,
    held_s: Callable[[], float],
) -> pb.ActionResult | None:
    """Ask under the same id until somebody answers; None where it is refused and so was not done,
    for example because stop-now is latched."""
    began_s, within_s = time.monotonic(), settings.away_s + settings.action_timeout_s
    again = pb.ActionRequest()
    again.CopyFrom(request)
    again.time_remaining_s = settings.action_timeout_s
    while True:
        try:
            lease = line.call(LEASE, pb.LeaseRequest(holder=HOLDER), refusals=(Conflict,))
            again.lease_token = lease.token
            result = line.bus.call(ACT, again, settings.action_timeout_s + 5.0)
            log.info("action %s was settled", request.action_id)
            return result
        except (Conflict, Unavailable, DeadlineExceeded) as error:
            if isinstance(error, Conflict) and _state(line).stopped:
                return None
            if time.monotonic() - began_s - held_s() > within_s:
                raise TaskFailed(Cause.SYSTEM_ERROR, error.message) from error
            line.rest(RETRY_S)
