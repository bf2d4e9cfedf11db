"""The right to move: e-stop, lease, motors, standing. Taken before the first action, kept, given
back at the end.

The lease is renewed by a thread of the SDK. When somebody takes it, presses an e-stop or switches
the motors off while we move, what runs is cut short and the stop is latched: a person stepped in,
and a person clears it. Then everything is asked for again before the next action.
"""

from __future__ import annotations

import logging
import threading
import time
from typing import Any

from helios_core.errors import Conflict, HeliosError

from helios_spot import api
from helios_spot.errors import doing, translate
from helios_spot.halt import Halt
from helios_spot.link import Link
from helios_spot.motion import POLL_S, Motion
from helios_spot.reading import Reading

log = logging.getLogger(__name__)

RENEW_LEASE_S = 0.5


class Control:
    """Used by the thread that acts; `release` by whoever ends the driver."""

    def __init__(self, link: Link, motion: Motion, halt: Halt) -> None:
        self._link, self._motion, self._halt, self._s = link, motion, halt, link.settings
        self._lease: Any = None
        self._estop: Any = None
        self._standing = False
        self._lost: HeliosError | None = None
        self._lock = threading.Lock()

    @property
    def held(self) -> bool:
        """Whether the robot is under our control, as far as we know."""
        return self._lease is not None and self._lost is None

    def take(self, reading: Reading) -> bool:
        """Be ready to move; whether the robot had to stand up. Raises Conflict and others, each
        with what to do, and then nothing has moved."""
        if self._lost is not None:
            self._give_back()
        if self._s.estop == "endpoint" and self._estop is None:
            self._estop = self._endpoint()
            reading = self._once_released()
        if reading.estops:
            raise Conflict(
                f"cannot move: {', '.join(reading.estops)} is pressed; release it (tablet, motor "
                "button, or whoever else holds an e-stop), or set HELIOS_SPOT_ESTOP=endpoint"
            )
        if self._lease is None:
            self._acquire()
        if not reading.motors_on:
            if self._standing:  # somebody switched them off; they do not come back by themselves
                gone = Conflict(
                    "cannot move: the motors were switched off, or an e-stop was pressed; see to "
                    "the robot"
                )
                self.lost(gone)
                raise gone
            self._power_on()
        if self._standing:
            return False
        self._motion.stand()
        self._standing = True
        return True

    def release(self) -> None:
        """Give the lease back and end our e-stop endpoint; the robot stands as it stands."""
        with self._lock:
            self._give_back()
            estop, self._estop = self._estop, None
        if estop is not None:
            estop.shutdown()

    def _acquire(self) -> None:
        client = self._link.client("lease")
        with doing("get the robot's lease", self._link.host):
            if self._s.lease == "take":
                client.take(timeout=self._s.rpc_timeout_s)
            self._lost = None
            self._lease = api.lease.LeaseKeepAlive(
                client, rpc_interval_seconds=RENEW_LEASE_S, must_acquire=True,
                return_at_exit=True, warnings=False, on_failure_callback=self._on_failure,
            )  # fmt: skip
        self._standing = False

    def _on_failure(self, error: Exception) -> None:
        """From the SDK's thread. A lost lease ends what runs; a lost link shows by itself."""
        gone = (api.exceptions.ResponseError, api.lease.Error)
        if not isinstance(error, gone):
            log.warning("the lease was not renewed: %s", error)
            return
        if self._lost is None:
            lost = translate(error, self._link.host, "go on")
            self._halt.cut(lost.message, lost)
            self.lost(lost)

    def lost(self, error: HeliosError) -> None:
        """Somebody took the robot from us in the middle of it: a person, who alone lets us go on.

        From any thread.
        """
        if self._lost is None:
            self._lost = error
            log.error("%s", error.message)
            self._halt.stop(f"{error.message}; then clear the stop")

    def _power_on(self) -> None:
        if self._s.power == "expect":
            raise Conflict(
                "the motors are off; switch them on at the tablet, or set HELIOS_SPOT_POWER=on"
            )
        with doing("switch the motors on", self._link.host):
            self._link.robot.power_on(
                timeout_sec=self._s.power_timeout_s, update_frequency=5.0,
                timeout=self._s.rpc_timeout_s,
            )  # fmt: skip
        self._halt.check()

    def _endpoint(self) -> Any:
        client = self._link.client("estop")
        with doing("set up the e-stop", self._link.host):
            endpoint = api.estop.EstopEndpoint(client, "helios", self._s.estop_timeout_s)
            endpoint.force_simple_setup()
            return api.estop.EstopKeepAlive(endpoint, rpc_timeout_seconds=self._s.rpc_timeout_s)

    def _once_released(self) -> Reading:
        """A new endpoint takes a moment to let the robot go."""
        end = time.monotonic() + self._s.rpc_timeout_s
        while (reading := self._link.read()).estops and time.monotonic() < end:
            self._halt.rest(POLL_S)
        return reading

    def _give_back(self) -> None:
        lease, self._lease, self._lost = self._lease, None, None
        self._standing = False
        if lease is None:
            return
        try:
            lease.shutdown()
        except Exception as error:  # gone with the link; the robot notices by itself
            log.warning("the lease could not be returned: %s", error)
