"""Tests faults while Spot gets ready to move: the robot is stopped, or does not begin."""

from __future__ import annotations

from typing import Any

import pytest
from helios_core.errors import Conflict, Unavailable
from helios_core.robot import Forward, Observe

from tests.support import wait_until
from tests.unit.spot.spot_stage import Outcome, Stage


def test_an_e_stop_during_standing_up_keeps_the_motors_off_until_the_stop_is_cleared(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_spot.motion.STAND_S", 3.0)
    driver = stage.driver()
    stage.world.endless.add("stand_request")
    outcome = Outcome(stage, driver, Observe())
    wait_until(lambda: stage.world.standing, 60, "it gets up")
    stage.world.press_estop("hardware button")
    assert isinstance(outcome.wait().error, Conflict)
    assert driver.state().stopped
    stage.world.estops.clear()
    stage.world.endless.clear()
    with pytest.raises(Conflict, match="clear the stop"):
        stage.act(driver, Observe())
    assert not stage.world.motors
    driver.clear_stop()
    assert stage.act(driver, Observe()).succeeded


@pytest.mark.parametrize("kind", ["stand_request", "arm_cartesian_command"])
def test_a_preparation_command_that_does_not_end_is_stopped(
    stage: Stage, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_spot.motion.STAND_S", 0.2)
    monkeypatch.setattr("helios_spot.motion.MOST_ARM_S", 0.2)
    driver = stage.driver()
    stage.world.endless.add(kind)
    result = stage.act(driver, Forward(0.5))
    assert not result.succeeded
    assert "within 0.2 s" in result.reason
    assert stage.world.log[-1] == "stop"
    stage.world.endless.clear()
    assert stage.act(driver, Forward(0.5)).succeeded


def test_a_lease_lost_while_the_hand_is_raised_is_latched_and_ends_the_action(stage: Stage) -> None:
    driver = stage.driver()
    stage.world.endless.add("arm_cartesian_command")
    outcome = Outcome(stage, driver, Forward(0.5))
    wait_until(lambda: not stage.world.stowed, 60, "the hand is raised")
    stage.fake.leases.give_to("the tablet")
    error = outcome.wait().error
    assert isinstance(error, Conflict)
    assert "the tablet has taken the robot's lease" in driver.state().message
    stage.fake.leases.free()
    stage.world.endless.clear()
    driver.clear_stop()
    again = driver.act(Forward(0.5), f"action-{stage._number}")
    assert (again.succeeded, again.reason) == (False, error.message)
    assert stage.world.x == 0.0


def test_a_link_failure_while_the_hand_is_raised_stops_the_robot(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = stage.driver()

    def fail(id: int, what: str) -> Any:
        if "hand" in what:
            raise Unavailable("no answer from the robot")
        return feedback(id, what)

    feedback = driver._link.feedback
    monkeypatch.setattr(driver._link, "feedback", fail)
    with pytest.raises(Unavailable):
        driver.act(Forward(0.5), "raised")
    assert stage.world.log[-1] == "stop"
    monkeypatch.undo()
    assert driver.act(Forward(0.5), "raised").reason == "no answer from the robot"


def test_a_rebooted_robot_does_not_move_until_the_bridge_restarts(stage: Stage) -> None:
    driver = stage.driver()
    stage.act(driver, Observe())
    stage.fake.leases.reboot()
    with pytest.raises(Conflict):
        stage.act(driver, Forward(0.5))
    for _ in range(2):
        with pytest.raises(Conflict, match="the robot has rebooted; restart the bridge"):
            driver.clear_stop()
        with pytest.raises(Conflict, match="clear the stop"):
            stage.act(driver, Forward(0.5))
    assert not stage.world.motors
    assert stage.world.lease_owner == ""
    driver.close()
    anew = stage.driver()
    assert anew.state().robot_boot_id == "fake-BD-00000001-fake-boot-2"
    assert stage.act(anew, Observe()).succeeded
