"""What a task needs to go on after its planner died: written before every action of the robot.

An entry holds the newest action that the robot was asked for, under its id, what came of it, and
what the mission remembered until then. A planner that takes the task up again asks for that action
once more under the same id: the bridge does it once, so that nothing is done twice and nothing is
left out.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from helios_core import proto as pb
from helios_core.bus import Bus, LivelinessHandler, Registration
from helios_core.topics import ACT, M, Method, Rep, Req, Topic

from helios_planner.robot.calls import RETRY_S
from helios_planner.task import Cause, TaskFailed
from helios_planner.tasks.hold import Hold

Memory = dict[str, Any]  # of JSON


@dataclass(frozen=True)
class Entry:
    """One task's journal. `life` counts how often it was taken up; request without result: nobody
    knows whether it was done."""

    life: int = 0
    request: pb.ActionRequest | None = None
    result: pb.ActionResult | None = None
    memory: Memory = field(default_factory=dict)
    epoch: tuple[str, int] | None = None  # the world that its poses live in


class Keeper(Protocol):
    """Where entries are kept; `fault`: why they cannot be, and what to do."""

    def keep(self, task_id: str, entry: Entry) -> bool: ...
    @property
    def fault(self) -> str: ...


class Journal:
    """Of one running task; used by its worker alone. `memory` gives what the mission remembers."""

    def __init__(self, keeper: Keeper, task_id: str, entry: Entry) -> None:
        self._keeper, self.task_id, self.entry = keeper, task_id, entry
        self.memory: Callable[[], Memory] = lambda: self.entry.memory

    @property
    def settled(self) -> bool:
        """Whether it is known what came of the newest action."""
        return self.entry.request is None or self.entry.result is not None

    @property
    def fault(self) -> str:
        """Why nothing can be kept now."""
        return self._keeper.fault

    def before(self, request: pb.ActionRequest) -> bool:
        """Whether an action is written down, so that it may begin."""
        entry = replace(self.entry, request=request, result=None, memory=self.memory())
        if not self._keeper.keep(self.task_id, entry):
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
        self._keeper.keep(self.task_id, entry)


class Waiter(Protocol):
    """Who is told why a task stands."""

    def on_hold(self, paused: bool) -> None: ...
    def on_wait(self, what: str | None) -> None: ...


class TaskBus(Bus):
    """The bus as one task uses it: it ends in time, begins no action while it is paused, and every
    action is in the journal before the robot is asked for it."""

    def __init__(
        self, bus: Bus, journal: Journal, hold: Hold, waiter: Waiter, keep_within_s: float
    ) -> None:
        """keep_within_s: for how long an action may wait until it can be written down."""
        self.robot = bus.robot
        self._bus, self._journal, self._hold, self._waiter = bus, journal, hold, waiter
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
            self._hold.wait(self._waiter.on_hold)
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
                self._waiter.on_wait(f"its journal: {self._journal.fault}")
            began_s = time.monotonic()
            self._hold.rest(RETRY_S)
            faulty_s += time.monotonic() - began_s
        if faulty_s:
            self._waiter.on_wait(None)

    def publish(self, topic: Topic[M], message: M) -> None:
        self._bus.publish(topic, message)

    def subscribe(self, topic: Topic[M], handler: Callable[[M], None]) -> Registration:
        return self._bus.subscribe(topic, handler)

    def serve(self, method: Method[Req, Rep], handler: Callable[[Req], Rep]) -> Registration:
        return self._bus.serve(method, handler)

    def announce(self, service: str, instance: str) -> Registration:
        return self._bus.announce(service, instance)

    def watch(self, handler: LivelinessHandler) -> Registration:
        return self._bus.watch(handler)

    def close(self) -> None:
        """The task's bus has nothing of its own."""
