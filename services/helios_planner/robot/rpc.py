"""Calls to services that retry while a service is away, and the robot's actions over the lease."""

from __future__ import annotations

import logging
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Protocol

from helios_core import proto as pb
from helios_core.codec import action_to_proto, state_from_proto
from helios_core.errors import Conflict, DeadlineExceeded, HeliosError, Unavailable
from helios_core.robot import Action
from helios_core.topics import ACT, GET_STATE, LEASE, Method, Rep, Req
from helios_core.types import RobotState

from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskCancelled, TaskFailed

RETRY_S = 0.3
log = logging.getLogger(__name__)
HOLDER = "planner"
_ACTION = re.compile(r"[^.]*?(?:\.(\d+))?-(\d+)")
RELEASE_S = 1.0  # longest wait for giving the lease back
RECENT = 20  # actions, of which so many may be answered only when asked for again:
MOST_IN_VAIN = 8


def system_error(error: HeliosError) -> TaskFailed:
    """The end of a task by an error of a service."""
    return TaskFailed(Cause.SYSTEM_ERROR, error.message)


def number_of(action_id: str) -> tuple[int, int]:
    """Life and number of an action of a task (`TASK.LIFE-NUMBER`), which rise as it goes on; zeros
    for another id."""
    parts = _ACTION.fullmatch(action_id)
    return (int(parts[1] or 0), int(parts[2])) if parts else (0, 0)


class Caller(Protocol):
    """What calls go out by: a bus, or what a task puts before it."""

    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep: ...


class RobotConnection:
    """Calls for one task that wait for services that are away, and end by a cancel. `on_wait` is
    told what is waited for, and None when it came. `bus.call` asks without waiting."""

    def __init__(
        self,
        bus: Caller,
        settings: Settings,
        cancelled: threading.Event,
        on_wait: Callable[[str | None], None],
    ) -> None:
        self.bus, self._settings, self.cancelled = bus, settings, cancelled
        self._on_wait, self._waited_for = on_wait, ""

    def call(
        self,
        method: Method[Req, Rep],
        request: Req,
        refusals: tuple[type[HeliosError], ...] = (),
    ) -> Rep:
        """Ask, and wait for a service that is away, up to `away_s`. Refusals are passed on; any
        other error ends the task as a system error."""
        away_s = self._settings.away_s
        deadline = time.monotonic() + away_s
        away = False
        while True:
            try:
                reply = self.bus.call(method, request, self._settings.call_timeout_s)
                break
            except refusals:
                raise
            except (Unavailable, DeadlineExceeded) as error:
                if time.monotonic() > deadline:
                    raise TaskFailed(
                        Cause.SYSTEM_ERROR, f"{error.message} (waited {away_s:.0f} s)"
                    ) from error
                away = True
                self.waits_for(f"the {method.name.partition('/')[0]}: {error.message}")
                self.rest(RETRY_S)
            except HeliosError as error:
                raise system_error(error) from error
        if away:
            self.waits_for("")
        return reply

    def waits_for(self, what: str) -> None:
        """Tell it, once; empty when it came."""
        if what != self._waited_for:
            self._waited_for = what
            self._on_wait(what or None)

    def rest(self, seconds: float) -> None:
        """Wait; a cancel ends it."""
        self.cancelled.wait(seconds)
        self.check()

    def check(self) -> None:
        if self.cancelled.is_set():
            raise TaskCancelled


class Driver:
    """One task's hold on the robot. `on_pause` is told the reason, and None when it goes on."""

    def __init__(
        self,
        line: RobotConnection,
        settings: Settings,
        task_id: str,
        on_pause: Callable[[str | None], None],
    ) -> None:
        self._line, self._settings, self._task_id = line, settings, task_id
        self._on_pause = on_pause
        self._number = 0
        self._token: int | None = None
        self._lease_s, self._renewed_s = 0.0, 0.0  # for how long it is granted, and since when
        self._granted = 0  # the newest lease, also while another one is to be asked for
        self._in_vain: deque[bool] = deque(maxlen=RECENT)

    def do(self, action: Action) -> pb.ActionResult:
        """Send one action until it is done once: under the same id while nobody answers or the
        lease was lost, under a new one after a stop. A lease that ran out while nothing was done
        (the task was paused) is renewed without a word.

        Raises TaskFailed when that takes longer than `away_s`, or happens again and again: a robot
        that is too slow to be driven would otherwise never be done with its task.
        """
        away_since: float | None = None
        problem: HeliosError | None = None
        action_id = self._next_id()
        renewed = False
        while True:
            self._line.check()
            if self._token is None:
                self._token = self._granted = self._lease()
            request = pb.ActionRequest(
                action_id=action_id,
                lease_token=self._token,
                time_remaining_s=self._settings.action_timeout_s,
                action=action_to_proto(action),
            )
            try:
                result = self._line.bus.call(ACT, request, self._settings.action_timeout_s + 5.0)
                self._renewed_s = time.monotonic()
                self._note(problem)
                if problem is not None:
                    self._line.waits_for("")
                return result
            except Conflict as error:
                self._token = None
                if self.wait_while_stopped():
                    action_id, away_since, problem = self._next_id(), None, None
                    continue
                if not renewed and time.monotonic() - self._renewed_s >= self._lease_s:
                    renewed = True
                    continue
                problem = error
            except (Unavailable, DeadlineExceeded) as error:
                self._token = None
                problem = error
            except HeliosError as error:
                raise system_error(error) from error
            log.warning("the bridge did not act: %s", problem.message)
            self._line.waits_for(f"the bridge: {problem.message}")
            away_since = away_since or time.monotonic()
            if time.monotonic() - away_since > self._settings.away_s:
                raise TaskFailed(
                    Cause.SYSTEM_ERROR,
                    f"{problem.message} (tried for {self._settings.away_s:.0f} s)",
                ) from problem
            self._line.rest(RETRY_S)

    def _note(self, problem: HeliosError | None) -> None:
        """Of an action that was done: why not at once; None where it was."""
        self._in_vain.append(problem is not None)
        if problem is not None and sum(self._in_vain) > MOST_IN_VAIN:
            raise TaskFailed(
                Cause.SYSTEM_ERROR,
                f"the bridge did not act at once in {sum(self._in_vain)} of the last "
                f"{len(self._in_vain)} actions, the last time because {problem.message}; see what "
                "makes the robot, its link or this computer so slow",
            ) from problem

    def state(self) -> RobotState:
        """How the robot is, asked now."""
        return state_from_proto(self._line.call(GET_STATE, pb.Empty()))

    def wait_while_stopped(self) -> bool:
        """While stop-now is latched: pause. Whether it was."""
        paused = False
        while (state := self.state()).stopped:
            if not paused:
                self._on_pause(state.message or "stop-now")
                paused = True
            self._line.rest(RETRY_S)
        if paused:
            self._on_pause(None)
        return paused

    def release(self) -> None:
        """Give the lease back: whoever wants to drive need not wait until it runs out."""
        token, self._granted, self._token = self._granted, 0, None
        if not token:
            return
        try:
            self._line.bus.call(LEASE, pb.LeaseRequest(release_token=token), RELEASE_S)
        except HeliosError as error:
            log.info("the lease runs out by itself: %s", error.message)

    def _lease(self) -> int:
        """Ask until it is granted. While somebody else drives the robot, the task waits: who has it
        in hand keeps it."""
        request = pb.LeaseRequest(holder=HOLDER)
        while True:
            try:
                lease = self._line.call(LEASE, request, refusals=(Conflict,))
            except Conflict as error:
                self._line.waits_for(f"the bridge: {error.message}")
                self._line.rest(RETRY_S)
            else:
                self._line.waits_for("")
                self._lease_s, self._renewed_s = lease.duration_s, time.monotonic()
                return lease.token

    def _next_id(self) -> str:
        self._number += 1
        return f"{self._task_id}-{self._number}"
