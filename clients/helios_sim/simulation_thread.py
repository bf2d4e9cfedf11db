"""A world on a thread of its own, usable from any thread: a driver without a bus."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from helios_core.errors import Unavailable
from helios_core.robot import Action, ActionResult, Capture, RobotDriver
from helios_core.types import RobotDescription, RobotState

from helios_sim.world import World

T = TypeVar("T")


class WorldThread(RobotDriver):
    """Makes a world on a new thread and does everything there, one call after the other."""

    def __init__(self, make: Callable[[], World]) -> None:
        """Returns when the world is made, and raises what `make` raised."""
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._closed = threading.Event()
        self._ending = threading.Lock()  # so that nothing is put after the end
        made: Future[World] = Future()
        self._thread = threading.Thread(
            target=self._serve, args=(make, made), name="world", daemon=True
        )
        self._thread.start()
        self._world = made.result()

    def run(self, call: Callable[[World], T]) -> T:
        """Do something with the world on its thread and wait for it."""
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

    def stop(self, reason: str) -> None:
        self._world.stop(reason)  # at once: an action may be running on the thread

    def clear_stop(self) -> None:
        self._world.clear_stop()

    def close(self) -> None:
        """End the thread after what it does now. What still waited is told Unavailable."""
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
