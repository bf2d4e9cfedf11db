"""Contract tests of stopping the robot."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from helios_core.errors import Conflict
from helios_core.geometry import wrap_angle, yaw_of
from helios_core.robot import Action, Observe, Turn

from helios_contract.rig import Rig

WITHIN_S = 30.0
TRIES_S = 30.0  # of stops in the middle of a turn
REASON = "a child in the way"
PARTS = 8  # fractions of a turn's duration at which a stop is tried
MOVED_RAD = 0.02  # smallest turn that counts as motion
STILL_S = 0.5  # duration of the observation after a stop
POLL_S = 0.01


class StopClaims:
    """Contract tests of `stop` and `clear_stop`."""

    def test_a_stop_latches_refuses_every_action_and_says_why(self, rig: Rig) -> None:
        before = rig.pose()
        rig.driver.stop(REASON)
        assert rig.driver.state().stopped
        for action in (Turn(rig.turn_rad), Observe()):
            assert REASON in _refusal(rig, action)
        assert rig.driver.state().stopped
        np.testing.assert_allclose(rig.pose(), before, atol=rig.tolerance_m / 5)

    def test_a_cleared_stop_is_over(self, rig: Rig) -> None:
        rig.driver.stop(REASON)
        rig.driver.clear_stop()
        assert not rig.driver.state().stopped
        result = rig.act(Observe())
        assert result.succeeded, result.reason

    def test_stopping_and_clearing_twice_is_as_once(self, rig: Rig) -> None:
        rig.driver.clear_stop()
        rig.driver.stop(REASON)
        rig.driver.stop("another reason")
        assert rig.driver.state().stopped
        rig.driver.clear_stop()
        rig.driver.clear_stop()
        assert rig.act(Observe()).succeeded

    def test_a_stopped_robot_still_sees_and_tells_its_state(self, rig: Rig) -> None:
        rig.driver.stop(REASON)
        assert rig.driver.capture().color.size
        assert rig.driver.state().stopped

    def test_a_stop_from_another_thread_ends_the_action_that_runs(self, rig: Rig) -> None:
        rig.need_motion()
        turning = _interrupted_turn(rig)
        assert REASON in turning.refusal, "the turn was ended, and yet told as done"
        there = rig.pose()
        until_s = time.monotonic() + STILL_S
        while time.monotonic() < until_s:
            now = rig.pose()
            off_rad = wrap_angle(yaw_of(now) - yaw_of(there))
            assert off_rad == pytest.approx(0.0, abs=rig.tolerance_rad), "it turns on by itself"
            np.testing.assert_allclose(now[:3, 3], there[:3, 3], atol=rig.tolerance_m)
            time.sleep(POLL_S)


def _interrupted_turn(rig: Rig) -> _Turning:
    """A turn that a stop ended in the middle.

    A simulated robot turns within a few milliseconds, so most stops come too early or too late.
    Each retry stops another fraction of a turn later.
    """
    until_s, whole_s, n = time.monotonic() + TRIES_S, 0.0, 0
    while True:
        turning = _Turning(rig, -rig.turn_rad if n % 2 else rig.turn_rad)
        if n == 0:
            turning.wait_until_it_moves()
        else:
            turning.wait(whole_s * (n % PARTS) / PARTS)
        rig.driver.stop(REASON)
        turned_rad = turning.end()
        if MOVED_RAD <= turned_rad < rig.turn_rad - rig.tolerance_rad:
            return turning
        tired = n >= PARTS and time.monotonic() > until_s
        assert not tired, f"in {TRIES_S:g} s no stop has ended a turn that ran"
        if not turning.refusal or n == 0:
            whole_s = turning.took_s
        rig.driver.clear_stop()
        n += 1


class _Turning:
    """Turn that runs in its own thread."""

    def __init__(self, rig: Rig, angle_rad: float) -> None:
        self._rig, self._before = rig, rig.pose()
        self.refusal, self.took_s = "", 0.0
        self._thread = threading.Thread(target=self._run, args=(angle_rad,), daemon=True)
        self._thread.start()

    def wait(self, seconds: float) -> None:
        self._thread.join(seconds)

    def wait_until_it_moves(self) -> None:
        """Wait until it moves or ends: not every robot reports its pose during a turn."""
        while self._thread.is_alive() and self._turned_rad() < MOVED_RAD:
            time.sleep(POLL_S)

    def end(self) -> float:
        """Wait for the end. Returns the absolute angle turned."""
        self._thread.join(WITHIN_S)
        assert not self._thread.is_alive(), f"it turns on, {WITHIN_S:g} s after the stop"
        assert REASON in self.refusal or not self.refusal
        return self._turned_rad()

    def _turned_rad(self) -> float:
        return abs(wrap_angle(yaw_of(self._rig.pose()) - yaw_of(self._before)))

    def _run(self, angle_rad: float) -> None:
        began_s = time.monotonic()
        self.refusal = _refusal(self._rig, Turn(angle_rad))
        self.took_s = time.monotonic() - began_s


def _refusal(rig: Rig, action: Action) -> str:
    """Reason from a failed result or a Conflict; "" if the action was executed."""
    try:
        result = rig.act(action)
    except Conflict as error:
        return error.message
    return "" if result.succeeded else result.reason
