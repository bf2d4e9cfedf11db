"""The right to move: e-stop, lease, motors, standing. Taken before the first action, kept, given
back at the end.

The lease is renewed by a thread of the SDK. When somebody takes it, presses an e-stop or switches
the motors off while we move, what runs is cut short and the stop is latched: a person stepped in,
and a person clears it. Clearing gets back what was lost, or says who still has it. Each lease is
lost once: what is heard late of an earlier one is of no account.
"""

from __future__ import annotations

import functools
import logging
import threading
import time
from dataclasses import dataclass
from typing import Any

from helios_core.errors import Conflict, HeliosError

from helios_spot import bosdyn_api
from helios_spot.errors import doing, translate
from helios_spot.halt_conditions import Halt
from helios_spot.motion import POLL_S, Motion
from helios_spot.robot_connection import Link
from helios_spot.robot_state import Reading

log = logging.getLogger(__name__)

RENEW_LEASE_S = 0.5


@dataclass(eq=False)
class LeaseTerm:
    """One time that the robot is ours: from the grant of its lease until it is given back."""

    keep_alive: Any = None
    lost: HeliosError | None = None  # to whom; the stop was latched for it, and is not again


class Control:
    """`take`, `stand` and `lost` are for the thread that acts, `clear` and `release` for any."""

    def __init__(self, link: Link, motion: Motion, halt: Halt) -> None:
        self._link, self._motion, self._halt, self._s = link, motion, halt, link.settings
        self._tenure: LeaseTerm | None = None
        self._acting = LeaseTerm()  # under which the present action was begun
        self._estop: Any = None
        self._epoch = ""  # of the first lease; the robot has another one after every boot
        self._powered = False  # the motors have been on in this tenure
        self._standing = False
        self._lock = threading.Lock()  # what is lost and the latched stop change together
        # Held while the lease is got or given back, which waits for the SDK's thread: that one
        # must never want this lock.
        self._changing = threading.Lock()

    @property
    def held(self) -> bool:
        """Whether the robot is under our control, as far as we know."""
        tenure = self._tenure
        return tenure is not None and tenure.lost is None

    def take(self, reading: Reading) -> None:
        """Be allowed to move, with the motors on. Raises Conflict and others, each with what to
        do, and then nothing has moved."""
        if self._s.estop == "endpoint":
            if self._estop is None:
                self._estop = self._endpoint()
                reading = self._once_released()
            _check_alive(self._estop)
        _check_estops(reading, "move")
        with self._changing:
            self._halt.check()  # it may have been lost since the action began
            if self._tenure is None:
                self._acquire("get the robot's lease")
            assert self._tenure is not None
            self._acting = self._tenure
        if reading.motors_on:
            self._powered = True
        elif self._powered:  # somebody switched them off; they do not come back by themselves
            gone = Conflict(
                "cannot move: the motors were switched off, or an e-stop was pressed; see to "
                "the robot"
            )
            self.lost(gone)
            raise gone
        else:
            self._power_on()

    def stand(self) -> bool:
        """Get up, after `take`; whether it had to. Raises CannotDo and HeliosError."""
        if self._standing:
            return False
        self._motion.stand()
        self._standing = True
        return True

    def lost(self, error: HeliosError) -> None:
        """Somebody took the robot from the action that runs: a person, who alone lets us go on."""
        with self._lock:
            self._lose(self._acting, error)

    def clear(self) -> None:
        """Lift the stop. What was lost is got back first, so that no late news of it can latch the
        stop again; otherwise the stop stays.

        Raises Conflict, which says who or what still holds the robot, and Unavailable.
        """
        with self._changing:
            if self.held:
                self._retain()
            if self._tenure is not None and self._tenure.lost is not None:
                self._regain(self._tenure)
            with self._lock:
                if self._tenure is not None and self._tenure.lost is not None:
                    raise self._tenure.lost  # at this very moment, once more
                self._halt.clear()

    def release(self) -> None:
        """Give the lease back and end our e-stop endpoint. Without an endpoint the robot stands as
        it stands; ours trips about `estop_timeout_s` later, and then it sits down or is cut."""
        with self._changing:
            if self._tenure is not None:
                self._give_back(self._tenure)
            self._tenure = None
            estop, self._estop = self._estop, None
        if estop is not None:
            estop.shutdown()

    # --- the lease ----------------------------------------------------------------------------
    def _acquire(self, what: str) -> None:
        """A new tenure; the one before, if any, stays when this raises. Raises Conflict when the
        robot has rebooted: what was mapped lies elsewhere now."""
        client, tenure = self._link.client("lease"), LeaseTerm()
        with doing(what, self._link.host):
            if self._s.lease == "take":
                client.take(timeout=self._s.rpc_timeout_s)
            tenure.keep_alive = bosdyn_api.lease.LeaseKeepAlive(
                client, rpc_interval_seconds=RENEW_LEASE_S, must_acquire=True,
                return_at_exit=True, warnings=False,
                on_failure_callback=functools.partial(self._on_failure, tenure),
            )  # fmt: skip
        try:
            self._check_epoch(client, what)
        except HeliosError:
            self._give_back(tenure)
            raise
        self._tenure, self._powered, self._standing = tenure, False, False

    def _check_epoch(self, client: Any, what: str) -> None:
        with doing(what, self._link.host):
            epoch = str(client.lease_wallet.get_lease().lease_proto.epoch)
        self._epoch = self._epoch or self._link.epoch or epoch
        if epoch != self._epoch:
            raise Conflict(f"cannot {what}: the robot has rebooted; restart the bridge")

    def _retain(self) -> None:
        """Hear now of a loss that the SDK's thread would tell of later."""
        client, tenure = self._link.client("lease"), self._tenure
        assert tenure is not None
        try:
            client.retain_lease(client.lease_wallet.get_lease(), timeout=self._s.rpc_timeout_s)
        except (bosdyn_api.exceptions.Error, bosdyn_api.lease.Error) as error:
            self._on_failure(tenure, error)

    def _regain(self, lost: LeaseTerm) -> None:
        reading = self._link.read()
        _check_estops(reading, "clear the stop")
        if self._s.power == "expect" and not reading.motors_on:
            raise Conflict(
                "cannot clear the stop: the motors are off; switch them on at the tablet"
            )
        self._give_back(lost)
        self._acquire("clear the stop")

    def _give_back(self, tenure: LeaseTerm) -> None:
        keep_alive, tenure.keep_alive = tenure.keep_alive, None
        if keep_alive is None:
            return
        try:
            keep_alive.shutdown()
        except Exception as error:  # gone with the link; the robot notices by itself
            log.warning("the lease could not be returned: %s", error)

    def _on_failure(self, tenure: LeaseTerm, error: Exception) -> None:
        """From the SDK's thread. A lost lease ends what runs; a lost link shows by itself."""
        if not isinstance(error, (bosdyn_api.exceptions.ResponseError, bosdyn_api.lease.Error)):
            log.warning("the lease was not renewed: %s", error)
            return
        lost = translate(error, self._link.host, "go on")
        with self._lock:
            if tenure.lost is None:
                self._halt.cut(lost.message, lost)
                self._lose(tenure, lost)

    def _lose(self, tenure: LeaseTerm, error: HeliosError) -> None:
        """Under `_lock`."""
        if tenure.lost is None:
            tenure.lost = error
            log.error("%s", error.message)
            self._halt.stop(f"{error.message}; then clear the stop")

    # --- motors and e-stop --------------------------------------------------------------------
    def _power_on(self) -> None:
        self._halt.check()  # a stop may have come while the lease was got
        if self._s.power == "expect":
            raise Conflict(
                "the motors are off; switch them on at the tablet, or set HELIOS_SPOT_POWER=on"
            )
        with doing("switch the motors on", self._link.host):
            self._link.robot.power_on(
                timeout_sec=self._s.power_timeout_s, update_frequency=5.0,
                timeout=self._s.rpc_timeout_s,
            )  # fmt: skip
        self._powered = True
        self._halt.check()

    def _endpoint(self) -> Any:
        client = self._link.client("estop")
        with doing("set up the e-stop", self._link.host):
            endpoint = bosdyn_api.estop.EstopEndpoint(client, "helios", self._s.estop_timeout_s)
            endpoint.force_simple_setup()
            return bosdyn_api.estop.EstopKeepAlive(
                endpoint, rpc_timeout_seconds=self._s.rpc_timeout_s
            )

    def _once_released(self) -> Reading:
        """A new endpoint takes a moment to let the robot go."""
        end = time.monotonic() + self._s.rpc_timeout_s
        while (reading := self._link.read()).estops and time.monotonic() < end:
            self._halt.rest(POLL_S)
        return reading


def _check_alive(estop: Any) -> None:
    """Raises Conflict when our endpoint is gone: the SDK ends it with no more than a log line."""
    if not estop._thread.is_alive():
        raise Conflict(
            "cannot move: our e-stop endpoint is gone, as somebody has replaced the robot's e-stop "
            "configuration; restart the bridge to set up ours again, or set HELIOS_SPOT_ESTOP=none"
        )


def _check_estops(reading: Reading, what: str) -> None:
    """Raises Conflict when one is pressed."""
    if reading.estops:
        raise Conflict(
            f"cannot {what}: {', '.join(reading.estops)} is pressed; release it (tablet, motor "
            "button, or whoever else holds an e-stop), or set HELIOS_SPOT_ESTOP=endpoint"
        )
