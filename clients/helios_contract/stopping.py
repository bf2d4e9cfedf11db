"""How the robot is stopped."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from helios_core.errors import Conflict
from helios_core.geometry import yaw_of
from helios_core.robot import Action, Observe, Turn

from helios_contract.rig import Rig

WITHIN_S = 15.0
REASON = "a child in the way"


class Stopping:
    """Of `stop` and `clear_stop`."""

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
        refusals: list[str] = []
        moving, give_up = threading.Event(), threading.Event()

        def drive() -> None:
            sign = 1
            while not (refusals or give_up.is_set()):
                moving.set()
                refusal = _refusal(rig, Turn(sign * rig.turn_rad))
                sign = -sign
                if refusal:
                    refusals.append(refusal)

        driving = threading.Thread(target=drive, daemon=True)
        driving.start()
        assert moving.wait(WITHIN_S)
        rig.driver.stop(REASON)
        driving.join(WITHIN_S)
        give_up.set()
        assert refusals, f"it drives on, {WITHIN_S:g} s after the stop"
        assert REASON in refusals[0]
        there = yaw_of(rig.pose())
        assert yaw_of(rig.pose()) == pytest.approx(there, abs=0.01), "it turns on by itself"


def _refusal(rig: Rig, action: Action) -> str:
    """Why it was not done, told by a failed result or a Conflict; empty where it was done."""
    try:
        result = rig.act(action)
    except Conflict as error:
        return error.message
    return "" if result.succeeded else result.reason
