"""A robot model without a server: the holder of its lease, and whether its motors are on."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

from helios_core.errors import Conflict
from helios_spot import bosdyn_api
from helios_spot.errors import translate
from helios_spot.halt_conditions import Halt, Halted
from helios_spot.motion import CannotDo
from helios_spot.robot_control import Control
from helios_spot.robot_state import Reading

from tests.fake_spot import pb

TABLET = "the tablet"
US = "helios"


def not_ours(owner: str) -> Exception:
    """The exception for the use of a lease that is not the robot's newest."""
    reply = pb.lease.RetainLeaseResponse()
    reply.lease_use_result.owner.client_name = owner
    return bosdyn_api.exceptions.LeaseUseError(reply, reply.lease_use_result)


def claimed(owner: str) -> Exception:
    """The exception for acquiring a lease that another client holds."""
    reply = pb.lease.AcquireLeaseResponse()
    reply.lease_owner.client_name = owner
    return bosdyn_api.lease.ResourceAlreadyClaimedError(reply)


class Robot:
    """Lease and motors as the SDK's client and our link show them. `number`: the newest lease."""

    host = "spot"

    def __init__(self) -> None:
        self.owner, self.number = "", 0
        self.estops: tuple[str, ...] = ()
        self.motors_on = False
        self.switched_on = 0  # number of power-on calls
        self.epoch = ""  # as reported at connection
        self.settings: Any = SimpleNamespace(
            estop="none", lease="acquire", power="on", power_timeout_s=1.0, rpc_timeout_s=1.0
        )
        self.keep_alives: list[KeepAlive] = []
        self.robot = SimpleNamespace(power_on=self._power_on)
        self.lease_wallet = SimpleNamespace(get_lease=lambda: self.keep_alives[-1])

    def grant(self, owner: str) -> int:
        self.number += 1
        self.owner = owner
        return self.number

    def refused(self, number: int) -> Exception | None:
        """The exception that the use of lease `number` raises, or None."""
        if (self.owner, number) == (US, self.number):
            return None
        return not_ours(self.owner)

    # --- the link and the lease client --------------------------------------------------------
    def client(self, _: str) -> Robot:
        return self

    def retain_lease(self, lease: KeepAlive, timeout: float) -> None:
        if (error := self.refused(lease.number)) is not None:
            raise error

    def read(self) -> Reading:
        state = SimpleNamespace(estops=self.estops, motors_on=self.motors_on)
        return cast("Reading", state)

    def _power_on(self, **_: float) -> None:
        self.motors_on = True
        self.switched_on += 1

    def press_estop(self) -> None:
        self.estops, self.motors_on = ("hardware button",), False


class KeepAlive:
    """The SDK's keep-alive thread and its lease. A test runs each step; shutdown waits for checks
    in progress."""

    lease_proto = SimpleNamespace(epoch="boot-1")

    def __init__(
        self, robot: Robot, on_failure_callback: Callable[[Exception], None], **_: Any
    ) -> None:
        if robot.owner == TABLET:
            raise claimed(TABLET)
        self._robot, self._tell = robot, on_failure_callback
        self.number, self.ended = robot.grant(US), False
        self._under_way: list[Exception | None] = []
        robot.keep_alives.append(self)

    def ask(self) -> None:
        """The robot answers a check of the lease; the answer has not arrived yet."""
        if not self.ended:
            self._under_way.append(self._robot.refused(self.number))

    def hear(self) -> None:
        while self._under_way:
            error = self._under_way.pop(0)
            if error is not None:
                self._tell(error)

    def shutdown(self) -> None:
        self.ended = True
        self.hear()
        if self._robot.refused(self.number) is None:
            self._robot.owner = ""


class Scene:
    """The driver's `Control` with the robot model."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.halt = robot, Halt()
        legs: Any = SimpleNamespace(stand=self._get_up)
        self.control = Control(cast("Any", robot), legs, self.halt)
        self.pressed_while_it_gets_up = False

    def act(self) -> None:
        """Run one action as the driver does. Raises Conflict and CannotDo."""
        self.halt.begin()
        try:
            self.control.take(self.robot.read())
            self.control.stand()
            error = self.robot.refused(self.robot.keep_alives[-1].number)
            if error is not None:
                lost = translate(error, self.robot.host, "walk")
                self.control.lost(lost)
                raise lost
            self.halt.check()
        except Halted as halted:
            raise halted.error or Conflict(halted.reason) from None
        finally:
            self.halt.end()

    def _get_up(self) -> None:
        if self.pressed_while_it_gets_up:
            self.pressed_while_it_gets_up = False
            self.robot.press_estop()
            raise CannotDo("the robot did not stand within 12 s; look at it")

    def take_by_hand(self) -> None:
        self.robot.grant(TABLET)

    def release_by_hand(self) -> None:
        self.robot.owner = ""
