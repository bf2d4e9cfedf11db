"""Control of one running task: its journal before every action, pause, time limit, and recovery.

A journal entry holds the newest action, its id, its result, and the mission's checkpoint. A planner
that resumes the task repeats that action under the same id. The bridge carries out an id once, so
no action is repeated or left out.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import action_from_proto, state_from_proto
from helios_core.errors import Conflict, DeadlineExceeded, Unavailable
from helios_core.heartbeat import HeartbeatSender
from helios_core.robot import Action
from helios_core.topics import ACT, GET_STATE, LEASE, Method, Rep, Req
from helios_core.types import RobotState

from helios_planner.robot.rpc import HOLDER, RETRY_S, RobotConnection, number_of
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskCancelled, TaskFailed, TimeIsUp
from helios_planner.tasks.registry import TaskReporter
from helios_planner.tasks.store import Checkpoint, Entry, Store

log = logging.getLogger(__name__)


class Journal:
    """Journal of one running task, for its worker alone."""

    def __init__(self, store: Store, task_id: str, entry: Entry) -> None:
        self._store, self.task_id, self.entry = store, task_id, entry
        self.checkpoint: Callable[[], Checkpoint] = lambda: self.entry.checkpoint

    @property
    def is_settled(self) -> bool:
        """True if the outcome of the newest action is known."""
        return self.entry.request is None or self.entry.result is not None

    @property
    def fault(self) -> str:
        """Why the store cannot write now; empty if it can."""
        return self._store.fault

    def before(self, request: pb.ActionRequest) -> bool:
        """Write an action before it begins; False if it could not be written."""
        entry = replace(self.entry, request=request, result=None, checkpoint=self.checkpoint())
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
        """Write the mission's present checkpoint."""
        self._keep(replace(self.entry, checkpoint=self.checkpoint()))

    def _keep(self, entry: Entry) -> None:
        self.entry = entry
        self._store.keep(self.task_id, entry)


class TaskCalls:
    """Calls of one task. They respect its time limit, begin no action while it is paused, and write
    every action to the journal before it is sent."""

    def __init__(
        self,
        bus: Bus,
        journal: Journal,
        hold: PauseControl,
        reporter: TaskReporter,
        keep_within_s: float,
    ) -> None:
        """keep_within_s: longest wait of an action for the journal."""
        self._bus, self._journal, self._hold, self._reporter = bus, journal, hold, reporter
        self._keep_within_s = keep_within_s
        self.held_s = 0.0  # duration of the pauses that calls waited for
        self.task_over = False  # True once the task has ended: reads then have no time limit

    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep:
        if isinstance(request, pb.LeaseRequest) and request.release_token:
            return self._bus.call(method, request, timeout_s)  # also after the time limit
        if not isinstance(request, pb.ActionRequest) or method.name != ACT.name:
            if not self.task_over:
                self._hold.check()
            return self._bus.call(method, request, timeout_s)
        self._hold.check()
        since_s = time.monotonic()
        self._written_down(request)
        self.held_s += time.monotonic() - since_s
        reply = self._bus.call(method, request, timeout_s)
        assert isinstance(reply, pb.ActionResult)
        self._journal.after(reply)
        return reply

    def _written_down(self, request: pb.ActionRequest) -> None:
        """Return once the journal holds the action, written while the task was not paused. Raises
        TaskFailed if the journal fails for too long."""
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
    """Pause and time limit of one running task. Thread-safe: its worker reads it, any
    thread sets it."""

    def __init__(self, limit_s: float, ends_s: float, cancelled: threading.Event) -> None:
        """limit_s: time limit, 0 for none; ends_s: its end, in seconds since 1970. A later jump of
        the wall clock does not move the end."""
        self._limit_s, self._cancelled = limit_s, cancelled
        self._ends_s = time.monotonic() + ends_s - time.time()
        self._go = threading.Event()
        self._go.set()
        self._turn = threading.Lock()  # orders pauses and the starts of actions

    def pause(self) -> None:
        """Once this returns, no action begins until `resume`; a running one goes on."""
        with self._turn:
            self._go.clear()

    def resume(self) -> None:
        with self._turn:
            self._go.set()

    @property
    def paused(self) -> bool:
        return not self._go.is_set()

    def begin(self, start: Callable[[], bool]) -> bool | None:
        """Call `start` and return its result; None while paused. A pause meanwhile waits until
        `start` has returned."""
        with self._turn:
            return None if self.paused else start()

    def check(self) -> None:
        """Raises TimeIsUp after the time limit; its cause is that of the step budget."""
        if self._limit_s and time.monotonic() > self._ends_s:
            raise TimeIsUp(f"the task's {self._limit_s:g} s are used up")

    def wait(self, tell: Callable[[bool], None]) -> None:
        """While paused, report it and wait. Raises TaskCancelled and TaskFailed."""
        if not self.paused:
            return
        tell(True)
        while not self._go.wait(0.1):
            self._check_all()
        tell(False)

    def rest(self, seconds: float) -> None:
        """Sleep. Raises TaskCancelled and TaskFailed."""
        self._cancelled.wait(seconds)
        self._check_all()

    def _check_all(self) -> None:
        if self._cancelled.is_set():
            raise TaskCancelled
        self.check()


@dataclass(frozen=True)
class LastAction:
    """Newest action that was sent to the robot, and its outcome. succeeded: None if it was refused;
    the held object then tells more."""

    action: Action | None
    succeeded: bool | None
    reason: str
    held: str


def last_action(
    line: RobotConnection,
    settings: Settings,
    journal: Journal,
    held_s: Callable[[], float] = lambda: 0.0,
    heart: HeartbeatSender | None = None,
) -> LastAction:
    """Settle the action in flight and return its outcome. held_s: duration of pauses so far, which
    do not count as waiting. heart: sends heartbeats meanwhile; None sends and promises none.

    Raises TaskFailed if the robot is not in the journal's world, or has done more of this task than
    the journal holds.
    """
    _same_world(line, journal)
    _not_stale(_state(line).last_action_id, journal)
    entry = journal.entry
    request, result = entry.request, entry.result
    if request is not None and result is None:
        result = _again(line, settings, request, held_s, heart)
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
    """Check that the journal is up to date. done: id of the robot's last action, of any task."""
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
    request: pb.ActionRequest,
    held_s: Callable[[], float],
    heart: HeartbeatSender | None,
) -> pb.ActionResult | None:
    """Send the action under the same id until it is answered; None if it is refused and so was not
    done, for example because stop-now is latched. The bridge begins it now if it had not before, so
    that it needs heartbeats."""
    began_s, within_s = time.monotonic(), settings.away_s + settings.action_timeout_s
    again = pb.ActionRequest()
    again.CopyFrom(request)
    again.time_remaining_s, again.beats = settings.action_timeout_s, heart is not None
    while True:
        try:
            lease = line.call(LEASE, pb.LeaseRequest(holder=HOLDER), refusals=(Conflict,))
            again.lease_token = lease.token
            with heart.beating(request.action_id) if heart else nullcontext():
                result = line.bus.call(ACT, again, settings.action_timeout_s + 5.0)
            log.info("action %s was settled", request.action_id)
            return result
        except (Conflict, Unavailable, DeadlineExceeded) as error:
            if isinstance(error, Conflict) and _state(line).stopped:
                return None
            if time.monotonic() - began_s - held_s() > within_s:
                raise TaskFailed(Cause.SYSTEM_ERROR, error.message) from error
            line.rest(RETRY_S)
