"""Stop of the robot: a latched stop by a person, and the halt of an action whose sender is silent.

Both call the driver's stop without the lock on the driver, because an action may be running. A stop
holds until `clear`, which waits for the end of the action that it interrupted: a driver that looks
for a stop now and then must not miss it. A stop is repeated until the robot confirms it. A halt
ends with the action. The driver's stop comes before the log and the disk, which may be slow.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from concurrent import futures
from concurrent.futures import Future
from contextlib import contextmanager

from helios_core.errors import Conflict, DeadlineExceeded, HeliosError, Unavailable
from helios_core.heartbeat import HALTED

from helios_bridge.bridge_health import BridgeHealth
from helios_bridge.driver_executor import DriverExecutor
from helios_bridge.driver_guard import GuardedDriver
from helios_bridge.stop_latch import StopLatch

log = logging.getLogger(__name__)

MOST_REASONS = 200  # length of all stop reasons together, characters
RETRY_S = 0.5  # between two questions to a robot that does not answer
ACTION_ENDS_WITHIN_S = 2.0  # after a stop, before it may be cleared
UNCONFIRMED = "the robot has not confirmed the stop and may still move"


class RobotStop:
    """Stop and halt of one driver. Thread-safe."""

    def __init__(
        self,
        driver: GuardedDriver,
        latch: StopLatch,
        executor: DriverExecutor,
        health: BridgeHealth,
        timeout_s: float,
    ) -> None:
        """timeout_s: longest wait for the driver's stop."""
        self._driver, self._latch, self._executor = driver, latch, executor
        self._health, self._timeout_s = health, timeout_s
        self.on_change: Callable[[], None] = lambda: None  # called after a change; it may be slow
        self._lock = threading.Lock()
        self._no_action = threading.Event()
        self._no_action.set()
        self.why = latch.read()  # all stop reasons, oldest first; "" if not stopped
        self.confirmed = False  # by the driver
        self._last_why = ""
        self._late = False  # the driver's stop exceeded its time limit
        self._stops, self._clearing = 0, False
        self._calls = 0  # number of the last call of the driver's stop
        self._stop_call: Future[None] | None = None
        self._halt_call: Future[None] | None = None  # the driver's stop for a silent sender

    @property
    def halting(self) -> bool:
        """True from the halt of an action until the driver's stop is cleared again."""
        return self._halt_call is not None

    def check(self) -> None:
        """Raise Conflict while the robot is stopped, and Unavailable while a halt is not over."""
        if self.why:
            raise Conflict(f"the robot is stopped ({self.why}); clear the stop first")
        if self.halting:
            raise Unavailable("the driver has not come back from ending an action; try again soon")

    @property
    def stops(self) -> int:
        """Number of stops so far."""
        return self._stops

    @contextmanager
    def acting(self, stops: int) -> Iterator[None]:
        """Context in which the driver executes an action. Its end also ends a halt.

        stops: number of stops when the action came. Raises as `check`, and Conflict if the robot
        was stopped since then.
        """
        self._no_action.clear()
        try:
            self.check()
            if self._stops != stops:
                raise Conflict("the robot was stopped before the action began; send it again")
            try:
                yield
            finally:
                self.end_halt()
        finally:
            self._no_action.set()

    # --- stop ---------------------------------------------------------------------------------
    def stop(self, reason: str) -> None:
        """Stop the robot. Raises DeadlineExceeded if the driver's stop does not return in time.

        In that case no further action starts, but the robot may still move. When it returns, the
        stop is on the disk, unless the disk refused it or took longer than the time limit.
        """
        end_s = time.monotonic() + self._timeout_s
        with self._lock:
            self._last_why = reason
            self.why = why = _with_reason(self.why, reason)
            self._stops += 1
            if not self._stop_hangs():
                self._begin_stop()
            call = self._stop_call
            self._latch.keep(why)
        self._health.count("stops")
        log.warning("stopped: %s", why)
        assert call is not None
        futures.wait((call,), end_s - time.monotonic())
        self._latch.wait(end_s - time.monotonic())
        if not call.done():
            late = (
                f"the driver's stop has not come back within {self._timeout_s:g} s; "
                "the robot may still move: use its own emergency stop"
            )
            self._late = True
            self._health.stop_fails(late)
            log.error("%s", late)
            raise DeadlineExceeded(late)
        call.result()  # raises the driver's error

    def clear(self) -> None:
        """Clear the stop, once the action that it interrupted has ended.

        Raises Conflict while a stop or that action hangs, while another thread clears the stop, or
        if another stop came meanwhile.
        """
        if not self._no_action.wait(ACTION_ENDS_WITHIN_S):
            raise Conflict(
                f"an action still runs {ACTION_ENDS_WITHIN_S:g} s after the stop; clear the stop "
                "again once it has ended, or see to the robot first"
            )
        stops = self._begin_clear()
        try:
            self._driver.clear_stop()  # may take long: the robot may be remote
        except BaseException:
            with self._lock:
                self._clearing = False
            raise
        with self._lock:
            self._clearing = False
            anew = self._last_why if self._stops != stops else ""
            self.why, self.confirmed = anew, False
            if anew:  # the driver may have cleared it too; no action can have begun
                self._begin_stop()
            else:
                self._latch.keep("")
            call = self._stop_call
        if anew:
            assert call is not None
            futures.wait((call,), self._timeout_s)
            raise Conflict(f"the robot was stopped again meanwhile ({anew}); clear that stop, too")
        self._latch.wait(self._timeout_s)
        self._health.stop_works()
        self.on_change()

    def _begin_clear(self) -> int:
        """Wait for the driver's stop, which `repeat` may call again meanwhile; then a clear runs.

        Returns the number of stops so far. Raises Conflict as `clear`.
        """
        end_s = time.monotonic() + self._timeout_s
        while True:
            with self._lock:
                if not self._stop_hangs():
                    if self._clearing:
                        raise Conflict(
                            "somebody else clears the stop right now; look at the robot's state"
                        )
                    self._clearing = True
                    return self._stops
                call = self._stop_call
            left_s = end_s - time.monotonic()
            if left_s <= 0:
                raise Conflict("the driver has not come back from its stop; see to the robot first")
            assert call is not None
            futures.wait((call,), left_s)

    def repeat(self) -> None:
        """Call the driver's stop again if the robot has not confirmed its stop."""
        with self._lock:
            unconfirmed = bool(self.why) and not self.confirmed
            if unconfirmed and not self._clearing and not self._stop_hangs():
                self._begin_stop()

    def _begin_stop(self) -> None:
        """Call the driver's stop in a thread; the caller holds the lock. The change is reported in
        another thread: that may be slow, and somebody waits for the stop."""
        self._calls += 1
        number = self._calls
        self._stop_call = self._executor.begin("stop", lambda: self._stop_driver(number))
        self._stop_call.add_done_callback(self._on_stop_ended)

    def _on_stop_ended(self, call: Future[None]) -> None:
        if call.exception() is None:
            self._executor.start("state after a stop", lambda: self.on_change())

    def _stop_driver(self, number: int) -> None:
        """Call the driver's stop. Only the last of several calls confirms the stop: a clear may
        have undone an earlier one."""
        try:
            self._driver.stop(self.why)
            with self._lock:
                self.confirmed = bool(self.why) and number == self._calls
        except Exception as error:
            if self._late:  # the caller of stop no longer waits
                log.error("the stop failed: %s", error)
                self._health.stop_fails(f"the stop failed: {error}")
            raise
        if self._late:
            self._late = False
            log.warning("the driver has come back from its stop after all")
        self._health.stop_works()

    def _stop_hangs(self) -> bool:
        return self._stop_call is not None and not self._stop_call.done()

    # --- halt ---------------------------------------------------------------------------------
    def halt(self, why: str) -> None:
        """End the running action, because its sender is away. It is no latched stop. A halt that
        failed is tried again at the next call, which comes while the action runs."""
        with self._lock:
            call = self._halt_call
            if self.why or (call is not None and not _failed(call)):
                return
            self._halt_call = self._executor.begin("halt", lambda: self._halt_driver(why))
        if call is None:
            self._health.count("halts")
            log.warning("the running action is ended: %s", why)

    def end_halt(self) -> None:
        """Allow actions again after a halt, at the latest once the driver has come back from it."""
        if (call := self._halt_call) is None:
            return
        futures.wait((call,), self._timeout_s)
        if not call.done():
            log.warning("the driver has not come back from ending an action yet")
        call.add_done_callback(self._clear_halt)  # at once if it has come back

    def clear_old_halt(self, ending: threading.Event) -> None:
        """Clear the halt of a bridge that died before it could do so itself. Waits for a robot that
        does not answer, until `ending` is set."""
        while True:
            try:
                state = self._driver.state()
                break
            except HeliosError:
                if ending.wait(RETRY_S):
                    return
        with self._lock:
            ours = bool(self.why) or self.halting
            if ours or not (state.stopped and state.message.startswith(HALTED)):
                return
            stops = self._stops
        try:
            self._clear_drivers_stop(stops)
            log.warning("an earlier bridge ended a drive; that is cleared: %s", state.message)
        except HeliosError as error:
            log.error("the robot stays stopped: %s", error.message)
        self.on_change()

    def _halt_driver(self, why: str) -> None:
        try:
            self._driver.stop(why)
        except Exception as error:
            log.error("the running action could not be ended: %s", error)
            self._health.stop_fails(f"the running action could not be ended: {error}")
            raise
        self._health.stop_works()

    def _clear_halt(self, call: Future[None]) -> None:
        """Clear the driver's stop, unless a stop has come meanwhile or ending the action failed."""
        with self._lock:
            again = self._halt_call
            if again is not None and again is not call:
                again.add_done_callback(self._clear_halt)
                return
            self._halt_call = None
            stops, is_stopped = self._stops, bool(self.why)
        try:
            call.result()
            if not is_stopped:
                self._clear_drivers_stop(stops)
        except HeliosError as error:
            log.error("the stop that ended an action is not cleared: %s", error.message)
        if not is_stopped:
            self._health.stop_works()  # the action that could not be ended is over
        self.on_change()

    def _clear_drivers_stop(self, stops: int) -> None:
        """Clear the driver's stop; stop again if there are more stops than `stops` by then. Without
        the lock, as it may take long: the robot may be remote."""
        self._driver.clear_stop()
        with self._lock:
            if self._stops != stops:  # even if a call of it still runs: it may have come before
                self.confirmed = False
                self._begin_stop()


def _failed(call: Future[None]) -> bool:
    return call.done() and call.exception() is not None


def _with_reason(before: str, new: str) -> str:
    """Stop reasons after one more stop; the first reason stays."""
    if not before or new in before:
        return before or new
    both = f"{before}; {new}"
    return both if len(both) <= MOST_REASONS else before
