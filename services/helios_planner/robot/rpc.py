"""Requests that are retried while a service is away, and the robot's actions under the lease."""

from __future__ import annotations

import logging
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import nullcontext
from typing import Protocol

from helios_core import proto as pb
from helios_core.codec import action_to_proto, state_from_proto
from helios_core.errors import Conflict, DeadlineExceeded, HeliosError, Unavailable
from helios_core.heartbeat import HeartbeatSender
from helios_core.robot import Action
from helios_core.topics import ACT, GET_STATE, LEASE, Method, Rep, Req
from helios_core.types import RobotState

from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskCancelled, TaskFailed

RETRY_S = 0.3
log = logging.getLogger(__name__)
HOLDER = "planner"
_ACTION = re.compile(r"[^.]*?(?:\.(\d+))?-(\d+)")
RELEASE_S = 1.0  # longest wait for the release of the lease
RECENT = 20  # actions, of which at most MOST_IN_VAIN may need a retry
MOST_IN_VAIN = 8


def system_error(error: HeliosError) -> TaskFailed:
    """Failure of a task because of an error of a service."""
    return TaskFailed(Cause.SYSTEM_ERROR, error.message)


def number_of(action_id: str) -> tuple[int, int]:
    """Life and number of a task's action (`TASK.LIFE-NUMBER`), which rise as the task goes on;
    zeros for another id."""
    parts = _ACTION.fullmatch(action_id)
    return (int(parts[1] or 0), int(parts[2])) if parts else (0, 0)


class RequestChannel(Protocol):
    """Sends requests: a bus, or a task's filter in front of it."""

    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep: ...


class RobotConnection:
    """Requests of one task: retried while a service is away, ended by a cancel. `on_wait` receives
    what the task waits for, and None when that has come. `bus.call` sends without a retry."""

    def __init__(
        self,
        bus: RequestChannel,
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
        """Send a request, and retry up to `away_s` while the service is away. Refusals are raised;
        any other error ends the task as a system error."""
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
        """Report once what the task waits for; empty when it has come."""
        if what != self._waited_for:
            self._waited_for = what
            self._on_wait(what or None)

    def rest(self, seconds: float) -> None:
        """Sleep; raises TaskCancelled on a cancel."""
        self.cancelled.wait(seconds)
        self.check()

    def check(self) -> None:
        if self.cancelled.is_set():
            raise TaskCancelled


class ActionSender:
    """Actions of one task on the robot. `on_pause` receives the reason of a stop, and None when the
    task goes on."""

    def __init__(
        self,
        line: RobotConnection,
        settings: Settings,
        task_id: str,
        on_pause: Callable[[str | None], None],
        heart: HeartbeatSender | None = None,
    ) -> None:
        """heart: sends heartbeats while an action runs; None sends none."""
        self._line, self._settings, self._task_id = line, settings, task_id
        self._heart = heart
        self._on_pause = on_pause
        self._number = 0
        self._token: int | None = None
        self._lease_s, self._renewed_s = 0.0, 0.0  # its duration, and time of its renewal
        self._granted = 0  # token of the newest lease, also while another one is requested
        self._in_vain: deque[bool] = deque(maxlen=RECENT)

    def do(self, action: Action) -> pb.ActionResult:
        """Send one action until it is done once: under the same id while there is no response or
        the lease was lost, under a new one after a stop. A lease that expired while nothing was
        done (the task was paused) is renewed silently.

        Raises TaskFailed if that takes longer than `away_s`, or happens too often: a task with a
        robot too slow to drive would otherwise never end.
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
                beats=self._heart is not None,
            )
            try:
                with self._heart.beating(action_id) if self._heart else nullcontext():
                    result = self._line.bus.call(
                        ACT, request, self._settings.action_timeout_s + 5.0
                    )
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
        """Record a completed action. problem: why it needed a retry, None if it did not. Raises
        TaskFailed if too many recent ones did."""
        self._in_vain.append(problem is not None)
        if problem is not None and sum(self._in_vain) > MOST_IN_VAIN:
            raise TaskFailed(
                Cause.SYSTEM_ERROR,
                f"the bridge did not act at once in {sum(self._in_vain)} of the last "
                f"{len(self._in_vain)} actions, the last time because {problem.message}; see what "
                "makes the robot, its link or this computer so slow",
            ) from problem

    def state(self) -> RobotState:
        """Present state of the robot, by a request."""
        return state_from_proto(self._line.call(GET_STATE, pb.Empty()))

    def wait_while_stopped(self) -> bool:
        """Wait while stop-now is latched; True if it was."""
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
        """Release the lease, so that another client need not wait until it expires."""
        token, self._granted, self._token = self._granted, 0, None
        if not token:
            return
        try:
            self._line.bus.call(LEASE, pb.LeaseRequest(release_token=token), RELEASE_S)
        except HeliosError as error:
            log.info("the lease runs out by itself: %s", error.message)

    def _lease(self) -> int:
        """Request the lease until it is granted; returns its token. The task waits while another
        client holds it."""
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
