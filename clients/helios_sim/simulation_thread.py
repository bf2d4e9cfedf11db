"""Robot driver without a bus: a world on its own thread, callable from any thread."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from helios_core.errors import Unavailable
from helios_core.robot import Action, ActionResult, Capture, RobotDriver
from helios_core.types import RobotDescription, RobotState

from helios_sim.drive_trace import DriveTrace
from helios_sim.world import World

T = TypeVar("T")


class WorldThread(RobotDriver):
    """World on a new thread, which executes all calls one after the other."""

    def __init__(self, make: Callable[[], World]) -> None:
        """Wait until the world is created. Raises any exception of `make`."""
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._closed = threading.Event()
        self._ending = threading.Lock()  # no call enters the queue after the end
        made: Future[World] = Future()
        self._thread = threading.Thread(
            target=self._serve, args=(make, made), name="world", daemon=True
        )
        self._thread.start()
        self._world = made.result()

    def run(self, call: Callable[[World], T]) -> T:
        """Run `call` on the world's thread and return its result. Raises Unavailable if closed."""
        done: Future[T] = Future()

        def carry_out() -> None:
            try:
                if self._closed.is_set():
                    raise Unavailable("the world is closed")
                done.set_result(call(self._world))
            except BaseException as error:
                done.set_exception(error)

        with self._ending:
            if self._closed.is_set():
                raise Unavailable("the world is closed")
            self._calls.put(carry_out)
        return done.result()

    def describe(self) -> RobotDescription:
        return self._world.describe()

    def state(self) -> RobotState:
        return self.run(lambda world: world.state())

    def capture(self) -> Capture:
        return self.run(lambda world: world.capture())

    def act(self, action: Action, action_id: str) -> ActionResult:
        return self.run(lambda world: world.act(action, action_id))

    def act_and_watch(
        self, action: Action, action_id: str, hz: float
    ) -> tuple[ActionResult, tuple[Capture, ...]]:
        return self.run(lambda world: world.act_and_watch(action, action_id, hz))

    def stop(self, reason: str) -> None:
        self._world.stop(reason)  # not through the queue: an action may be running on the thread

    def halt(self, reason: str) -> None:
        """End the running drive, without a latch."""
        self._world.halt(reason)

    def clear_stop(self) -> None:
        self._world.clear_stop()

    @property
    def trace(self) -> DriveTrace:
        """True positions of the base; readable during an action."""
        return self._world.trace

    def close(self) -> None:
        """End the thread after its current call. Waiting calls raise Unavailable."""
        with self._ending:
            if self._closed.is_set():
                return
            self._world.stop("the world ends")
            self._closed.set()
            self._calls.put(None)
        self._thread.join(1.0)

    def _serve(self, make: Callable[[], World], made: Future[World]) -> None:
        try:
            world = make()
        except BaseException as error:
            made.set_exception(error)
            return
        made.set_result(world)
        while (call := self._calls.get()) is not None:
            call()
        world.close()
