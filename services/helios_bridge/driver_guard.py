"""Guard around a driver: turns its faults into messages that name driver, method and fault.

A driver is external code. Its typed errors pass. Every other exception, every return value of a
wrong type and every state with an impossible pose becomes a `DriverFault`; the traceback goes to
the log.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import TypeVar

from helios_core.codec import (
    description_to_proto,
    result_to_proto,
    state_from_proto,
    state_to_proto,
)
from helios_core.errors import HeliosError, Internal, InvalidInput
from helios_core.robot import Action, ActionResult, Capture, EndOfRecording, RobotDriver
from helios_core.types import RobotDescription, RobotState

from helios_bridge.bridge_health import BridgeHealth
from helios_bridge.capture_checks import check_capture

log = logging.getLogger(__name__)

R = TypeVar("R")

WHERE = "`helios logs bridge` shows where"


class DriverFault(Internal):
    """Fault in the driver; the message names driver and method."""


class GuardedDriver(RobotDriver):
    """Driver with checks. Each fault is reported to `health` until the same method succeeds.

    As thread-safe as the driver itself.
    """

    def __init__(self, driver: RobotDriver, health: BridgeHealth) -> None:
        kind = type(driver)
        self.name = f"{kind.__module__}:{kind.__qualname__}"
        self._driver, self._health = driver, health
        self._lock = threading.Lock()
        self._logged: dict[str, str] = {}  # method -> kind of its last fault

    def describe(self) -> RobotDescription:
        return self._call(
            "describe", "describe()", self._driver.describe, RobotDescription, description_to_proto
        )

    def state(self) -> RobotState:
        return self._call("state", "state()", self._driver.state, RobotState, _check_state)

    def capture(self) -> Capture:
        return self._call("capture", "capture()", self._driver.capture, Capture)

    def act(self, action: Action, action_id: str) -> ActionResult:
        return self._call(
            "act",
            f"act({type(action).__name__})",
            lambda: self._driver.act(action, action_id),
            ActionResult,
            lambda result: result_to_proto(result, action_id),
        )

    def act_and_watch(
        self, action: Action, action_id: str, hz: float
    ) -> tuple[ActionResult, tuple[Capture, ...]]:
        """As the driver's, without the images that are wrong: the robot has moved, so its result
        must not be lost."""

        def encode(out: tuple[ActionResult, object]) -> None:
            result, _ = out
            result_to_proto(result, action_id)

        shown = f"act_and_watch({type(action).__name__})"
        call = lambda: self._driver.act_and_watch(action, action_id, hz)  # noqa: E731
        result, images = self._call("act_and_watch", shown, call, tuple, encode)
        return result, self._good_images(shown, images)

    def _good_images(self, shown: str, images: object) -> tuple[Capture, ...]:
        """Images that are right; a warning names what is wrong with the others."""
        good: list[Capture] = []
        wrong: list[str] = []
        if not isinstance(images, Sequence):
            wrong.append(f"they are {_a(type(images))}; give a tuple of Capture")
            images = ()
        for image in images:
            try:
                check_capture(image)
                good.append(image)
            except Exception as error:
                wrong.append(error.message if isinstance(error, HeliosError) else repr(error))
        if wrong:
            log.warning(
                "the driver %s returned wrong images from %s: %s (%d left out, %d used)",
                self.name,
                shown,
                wrong[0],
                len(wrong),
                len(good),
            )
        return tuple(good)

    def stop(self, reason: str) -> None:
        self._call("stop", "stop()", lambda: self._driver.stop(reason))

    def clear_stop(self) -> None:
        self._call("clear_stop", "clear_stop()", self._driver.clear_stop)

    def close(self) -> None:
        self._call("close", "close()", self._driver.close)

    def _call(
        self,
        method: str,
        shown: str,
        call: Callable[[], R],
        wanted: type[R] | None = None,
        encode: Callable[[R], object] | None = None,
    ) -> R:
        """Return value of a driver method. `encode` raises if a field has a wrong type, and
        InvalidInput if it has a wrong value.

        Raises DriverFault, and the driver's own HeliosError and EndOfRecording.
        """
        try:
            out = call()
        except (HeliosError, EndOfRecording):
            raise
        except (Exception, SystemExit) as error:
            said = f"the driver {self.name} failed in {shown}: {type(error).__name__}: {error}"
            raise self._fault(method, f"{said}; {WHERE}", error) from error
        if wanted is not None and not isinstance(out, wanted):
            came = "None" if out is None else _a(type(out))
            raise self._fault(
                method,
                f"the driver {self.name} returned {came} from {shown}; return {_a(wanted)}",
            )
        if encode is not None:
            try:
                encode(out)
            except InvalidInput as error:
                said = f"the driver {self.name} returned {_a(type(out))} from {shown}, in which "
                raise self._fault(method, f"{said}{error.message}", kind=said) from error
            except Exception as error:
                said = (
                    f"the driver {self.name} returned {_a(type(out))} from {shown} with a "
                    f"field of a wrong type: {type(error).__name__}: {error}; {WHERE}"
                )
                raise self._fault(method, said, error) from error
        self._works(method)
        return out

    def _fault(
        self, method: str, said: str, error: BaseException | None = None, kind: str = ""
    ) -> DriverFault:
        """Report a fault. kind: what stays the same in `said` while the fault lasts; the default
        is all of it."""
        kind = kind or said
        with self._lock:
            is_new = self._logged.get(method) != kind
            self._logged[method] = kind
        if is_new:  # log once: a camera may fail many times a second
            log.error("%s", said, exc_info=error)
        self._health.driver_fails(method, said)
        return DriverFault(said)

    def _works(self, method: str) -> None:
        with self._lock:
            failed = self._logged.pop(method, None) is not None
        if failed:
            self._health.driver_works(method)


def _check_state(state: RobotState) -> None:
    """Raises for a state that no message holds, and InvalidInput for a pose that is not rigid."""
    state_from_proto(state_to_proto(state))


def _a(kind: type) -> str:
    """Name of a type with its article."""
    name = kind.__name__
    return f"an {name}" if name[0] in "AEIOUaeiou" else f"a {name}"
