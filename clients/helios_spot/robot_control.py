"""Control of the robot: e-stop, lease, motors, standing. `Control` acquires it before the first
action, keeps it, and returns it at the end.

A thread of the SDK renews the lease. When a person takes the lease, presses an e-stop or switches
the motors off during a motion, the current action ends and the stop is latched until a person
clears it. Clearing acquires the lost control again, or reports its holder. Each lease is lost once;
late reports about an earlier lease are ignored.
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
from helios_spot.robot_connection import RobotConnection
from helios_spot.robot_state import Reading

log = logging.getLogger(__name__)

RENEW_LEASE_S = 0.5


@dataclass(eq=False)
class LeaseTerm:
    """One period of control: from the grant of the lease until its return."""

    keep_alive: Any = None
    lost: HeliosError | None = None  # error of the loss, which latches the stop only once


class Control:
    """Control of one robot. `take`, `stand` and `lost` are for the action thread, `clear` and
    `release` for any thread."""

    def __init__(self, link: RobotConnection, motion: Motion, halt: Halt) -> None:
        self._link, self._motion, self._halt, self._s = link, motion, halt, link.settings
        self._lease_term: LeaseTerm | None = None
        self._acting = LeaseTerm()  # lease term of the current action
        self._estop: Any = None
        self._epoch = ""  # epoch of the first lease; it changes at every boot of the robot
        self._powered = False  # the motors have been on in this lease term
        self._standing = False
        self._lock = threading.Lock()  # makes the loss and the latched stop change together
        # Held while the lease is acquired or returned. Both wait for the SDK's thread, so that
        # thread must never take this lock.
        self._changing = threading.Lock()

    @property
    def held(self) -> bool:
        """True while this driver has the lease and knows of no loss."""
        lease_term = self._lease_term
        return lease_term is not None and lease_term.lost is None

    def take(self, reading: Reading) -> None:
        """Get permission to move, and switch the motors on. Raises HeliosError, such as Conflict,
        with the remedy and before any motion."""
        if self._s.estop == "endpoint":
            if self._estop is None:
                self._estop = self._endpoint()
                reading = self._once_released()
            _check_alive(self._estop)
        _check_estops(reading, "move")
        with self._changing:
            self._halt.check()  # control may have been lost since the action began
            if self._lease_term is None:
                self._acquire("get the robot's lease")
            assert self._lease_term is not None
            self._acting = self._lease_term
        if reading.motors_on:
            self._powered = True
        elif self._powered:  # a person switched the motors off; they must not restart by themselves
            gone = Conflict(
                "cannot move: the motors were switched off, or an e-stop was pressed; see to "
                "the robot"
            )
            self.lost(gone)
            raise gone
        else:
            self._power_on()

    def stand(self) -> bool:
        """Stand up, after `take`; False if already standing. Raises CannotDo and HeliosError."""
        if self._standing:
            return False
        self._motion.stand()
        self._standing = True
        return True

    def lost(self, error: HeliosError) -> None:
        """Record that a person took control during the current action; only a person clears it."""
        with self._lock:
            self._lose(self._acting, error)

    def clear(self) -> None:
        """Clear the stop. First acquire lost control again, so that no late report of the loss can
        latch the stop again; if this fails, the stop stays.

        Raises Conflict, which names the remaining cause or holder, and Unavailable.
        """
        with self._changing:
            if self.held:
                self._retain()
            if self._lease_term is not None and self._lease_term.lost is not None:
                self._regain(self._lease_term)
            with self._lock:
                if self._lease_term is not None and self._lease_term.lost is not None:
                    raise self._lease_term.lost  # lost again in the meantime
                self._halt.clear()

    def release(self) -> None:
        """Return the lease and end our e-stop endpoint. Without an endpoint the robot keeps
        standing. Ours trips about `estop_timeout_s` later; the robot sits down or loses power."""
        with self._changing:
            if self._lease_term is not None:
                self._give_back(self._lease_term)
            self._lease_term = None
            estop, self._estop = self._estop, None
        if estop is not None:
            estop.shutdown()

    # --- the lease ----------------------------------------------------------------------------
    def _acquire(self, what: str) -> None:
        """Begin a new lease term; the previous one stays if this raises. Raises Conflict when the
        robot has rebooted, because the mapped poses are then invalid."""
        client, lease_term = self._link.client("lease"), LeaseTerm()
        with doing(what, self._link.host):
            if self._s.lease == "take":
                client.take(timeout=self._s.rpc_timeout_s)
            lease_term.keep_alive = bosdyn_api.lease.LeaseKeepAlive(
                client,
                rpc_interval_seconds=RENEW_LEASE_S,
                must_acquire=True,
                return_at_exit=True,
                warnings=False,
                on_failure_callback=functools.partial(self._on_failure, lease_term),
            )
        try:
            self._check_epoch(client, what)
        except HeliosError:
            self._give_back(lease_term)
            raise
        self._lease_term, self._powered, self._standing = lease_term, False, False

    def _check_epoch(self, client: Any, what: str) -> None:
        with doing(what, self._link.host):
            epoch = str(client.lease_wallet.get_lease().lease_proto.epoch)
        self._epoch = self._epoch or self._link.epoch or epoch
        if epoch != self._epoch:
            raise Conflict(f"cannot {what}: the robot has rebooted; restart the bridge")

    def _retain(self) -> None:
        """Check the lease now, before the SDK's thread reports a loss."""
        client, lease_term = self._link.client("lease"), self._lease_term
        assert lease_term is not None
        try:
            client.retain_lease(client.lease_wallet.get_lease(), timeout=self._s.rpc_timeout_s)
        except (bosdyn_api.exceptions.Error, bosdyn_api.lease.Error) as error:
            self._on_failure(lease_term, error)

    def _regain(self, lost: LeaseTerm) -> None:
        reading = self._link.read()
        _check_estops(reading, "clear the stop")
        if self._s.power == "expect" and not reading.motors_on:
            raise Conflict(
                "cannot clear the stop: the motors are off; switch them on at the tablet"
            )
        self._give_back(lost)
        self._acquire("clear the stop")

    def _give_back(self, lease_term: LeaseTerm) -> None:
        keep_alive, lease_term.keep_alive = lease_term.keep_alive, None
        if keep_alive is None:
            return
        try:
            keep_alive.shutdown()
        except Exception as error:  # without a link the robot detects the loss by itself
            log.warning("the lease could not be returned: %s", error)

    def _on_failure(self, lease_term: LeaseTerm, error: Exception) -> None:
        """Handle a failed renewal, in the SDK's thread. A lost lease ends the current action; a
        lost link is only logged."""
        if not isinstance(error, (bosdyn_api.exceptions.ResponseError, bosdyn_api.lease.Error)):
            log.warning("the lease was not renewed: %s", error)
            return
        lost = translate(error, self._link.host, "go on")
        with self._lock:
            if lease_term.lost is None:
                self._halt.cut(lost.message, lost)
                self._lose(lease_term, lost)

    def _lose(self, lease_term: LeaseTerm, error: HeliosError) -> None:
        """Record a loss and latch the stop. The caller holds `_lock`."""
        if lease_term.lost is None:
            lease_term.lost = error
            log.error("%s", error.message)
            self._halt.stop(f"{error.message}; then clear the stop")

    # --- motors and e-stop --------------------------------------------------------------------
    def _power_on(self) -> None:
        self._halt.check()  # a stop may have arrived while the lease was acquired
        if self._s.power == "expect":
            raise Conflict(
                "the motors are off; switch them on at the tablet, or set HELIOS_SPOT_POWER=on"
            )
        with doing("switch the motors on", self._link.host):
            self._link.robot.power_on(
                timeout_sec=self._s.power_timeout_s,
                update_frequency=5.0,
                timeout=self._s.rpc_timeout_s,
            )
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
        """Wait until a new endpoint has released its e-stop; return the last reading."""
        end = time.monotonic() + self._s.rpc_timeout_s
        while (reading := self._link.read()).estops and time.monotonic() < end:
            self._halt.rest(POLL_S)
        return reading


def _check_alive(estop: Any) -> None:
    """Raises Conflict when our endpoint has ended, which the SDK only logs."""
    if not estop._thread.is_alive():
        raise Conflict(
            "cannot move: our e-stop endpoint is gone, as somebody has replaced the robot's e-stop "
            "configuration; restart the bridge to set up ours again, or set HELIOS_SPOT_ESTOP=none"
        )


def _check_estops(reading: Reading, what: str) -> None:
    """Raises Conflict when an e-stop is pressed."""
    if reading.estops:
        raise Conflict(
            f"cannot {what}: {', '.join(reading.estops)} is pressed; release it (tablet, motor "
            "button, or whoever else holds an e-stop), or set HELIOS_SPOT_ESTOP=endpoint"
        )
