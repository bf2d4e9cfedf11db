"""Taking a task up again after its planner died: what came of the action in flight."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

from helios_core import proto as pb
from helios_core.codec import action_from_proto, state_from_proto
from helios_core.errors import Conflict, DeadlineExceeded, Unavailable
from helios_core.robot import Action
from helios_core.topics import ACT, GET_STATE, LEASE
from helios_core.types import RobotState

from helios_planner.robot.calls import RETRY_S
from helios_planner.robot.driving import HOLDER, Line, number_of
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed
from helios_planner.tasks.journal import Journal

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LastAction:
    """The newest action that the robot was asked for; succeeded: None where it was refused, and
    what the robot holds says more."""

    action: Action | None
    succeeded: bool | None
    reason: str
    held: str


def last_action(
    line: Line, settings: Settings, journal: Journal, held_s: Callable[[], float] = lambda: 0.0
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


def _same_world(line: Line, journal: Journal) -> None:
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


def _state(line: Line) -> RobotState:
    return state_from_proto(line.call(GET_STATE, pb.Empty()))


def _again(
    line: Line,
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
            result = line.call_once(ACT, again, settings.action_timeout_s + 5.0)
            log.info("action %s was settled", request.action_id)
            return result
        except (Conflict, Unavailable, DeadlineExceeded) as error:
            if isinstance(error, Conflict) and _state(line).stopped:
                return None
            if time.monotonic() - began_s - held_s() > within_s:
                raise TaskFailed(Cause.SYSTEM_ERROR, error.message) from error
            line.rest(RETRY_S)
