"""Whatever goes wrong ends in a typed error that says what to do, with the robot standing still."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import grpc
import pytest
from helios_core.errors import (
    Conflict,
    DeadlineExceeded,
    InvalidInput,
    Unavailable,
)
from helios_core.robot import Forward, Observe, Pick, Place, Turn
from pydantic import SecretStr

from tests.fake_spot import pb
from tests.support import wait_until
from tests.unit.spot.conftest import Staging
from tests.unit.spot.spot_stage import Stage

MUG_M = (2.16, 0.6, 0.76)


def standing(stage: Stage, within_s: float = 5.0) -> None:
    wait_until(stage.standing_still, within_s, "the robot stands still")


# --- before anything moves ------------------------------------------------------------------------
def test_a_wrong_password_is_said_once_and_needs_a_person(stage: Stage) -> None:
    driver = stage.driver(connect=False, password=SecretStr("guess"))
    with pytest.raises(InvalidInput, match="HELIOS_SPOT_PASSWORD") as refused:
        driver.describe()
    assert "guess" not in refused.value.message
    assert not stage.world.motors


def test_a_robot_that_is_away_is_waited_for(stage: Stage) -> None:
    driver = stage.driver(connect=False)
    stage.cut(driver)
    with pytest.raises(Unavailable, match="check that it is on"):
        driver.describe()
    stage.mend(driver)
    assert driver.describe().name == "Spot"


def test_every_line_to_a_robot_that_was_away_is_opened_again_within_a_second(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """gRPC alone would wait longer after each failure, up to two minutes."""
    opened: list[dict[str, int]] = []
    secure_channel = grpc.secure_channel

    def spy(target: str, creds: Any, options: Any) -> Any:
        opened.append(dict(options))
        return secure_channel(target, creds, options)

    monkeypatch.setattr(grpc, "secure_channel", spy)
    driver = stage.driver()
    assert stage.act(driver, Observe()).succeeded
    assert len(opened) > 3
    for options in opened:
        assert options["grpc.max_reconnect_backoff_ms"] == 1000
        assert options["grpc.max_receive_message_length"] > 10_000_000  # an image fits


def test_clocks_that_cannot_be_compared_are_said(stage: Stage) -> None:
    stage.fake.clock.ready = False
    driver = stage.driver(connect=False, time_sync_s=0.5)
    with pytest.raises(Unavailable, match="time-sync"):
        driver.describe()


def test_a_camera_that_the_robot_lacks_is_named_with_those_it_has(stage: Stage) -> None:
    driver = stage.driver(connect=False, camera="back")
    with pytest.raises(InvalidInput, match=r"back_fisheye_image.*hand_color_image"):
        driver.describe()


def test_a_camera_that_breaks_is_said(stage: Stage) -> None:
    driver = stage.driver()
    driver.capture()
    del stage.fake.images.sources["hand_color_image"]
    with pytest.raises(Unavailable, match="camera"):
        driver.capture()


@pytest.mark.parametrize(
    ("refusal", "mend"),
    [
        ("STATUS_BATTERY_MISSING", "put one in"),
        ("STATUS_SHORE_POWER_CONNECTED", "unplug"),
        ("STATUS_FAULTED", "clear it"),
        ("STATUS_ESTOPPED", "release it"),
        ("STATUS_KEEPALIVE_MOTORS_OFF", "keep-alive"),
        ("STATUS_OVERRIDDEN", "power menu"),
    ],
)
def test_without_power_nothing_moves_and_the_cause_is_reported(
    stage: Stage, refusal: str, mend: str
) -> None:
    stage.world.power_refusal = refusal
    driver = stage.driver()
    with pytest.raises(Conflict, match=mend):
        stage.act(driver, Forward(0.5))
    assert not stage.world.standing
    stage.world.power_refusal = ""
    assert stage.act(driver, Forward(0.5)).succeeded  # mended: it goes on


def test_motors_that_must_be_on_already_are_not_switched_on(stage: Stage) -> None:
    driver = stage.driver(power="expect")
    with pytest.raises(Conflict, match="switch them on"):
        stage.act(driver, Forward(0.5))
    assert not stage.world.motors


def test_a_pressed_e_stop_is_named(stage: Stage) -> None:
    stage.world.estops.add("hardware button")
    driver = stage.driver()
    with pytest.raises(Conflict, match="hardware button is pressed; release it"):
        stage.act(driver, Turn(0.4))
    assert not stage.world.motors


def test_our_own_e_stop_endpoint_lets_the_robot_go(stage: Stage) -> None:
    driver = stage.driver(estop="endpoint")
    assert stage.act(driver, Turn(0.4)).succeeded
    assert not stage.world.estops


def test_an_e_stop_endpoint_that_somebody_replaced_is_said_before_anything_moves(
    stage: Stage,
) -> None:
    driver = stage.driver(estop="endpoint", estop_timeout_s=3.0)
    stage.act(driver, Observe())
    stage.fake.estop.replace("the tablet")
    wait_until(lambda: not driver._control._estop._thread.is_alive(), 20, "ours is refused")
    with pytest.raises(Conflict, match=r"endpoint is gone.*restart the bridge"):
        stage.act(driver, Forward(0.5))
    assert stage.world.x == 0.0


def test_our_e_stop_endpoint_trips_some_seconds_after_the_driver_has_ended(stage: Stage) -> None:
    driver = stage.driver(estop="endpoint", estop_timeout_s=3.0)
    stage.act(driver, Observe())
    driver.close()
    assert stage.world.motors

    def tripped() -> bool:
        stage.world.step()
        return not stage.world.motors

    wait_until(tripped, 20, "the endpoint trips")
    assert stage.world.estops == {"software"}


def test_a_lease_that_somebody_holds_is_not_taken_unless_asked(stage: Stage) -> None:
    stage.fake.leases.give_to("the tablet")
    with pytest.raises(Conflict, match=r"the tablet holds.*HELIOS_SPOT_LEASE=take"):
        stage.act(stage.driver(), Turn(0.4))
    assert stage.world.lease_owner == "the tablet"
    assert stage.act(stage.driver(lease="take"), Turn(0.4)).succeeded


def test_a_robot_without_an_arm_says_which_service_is_missing(staging: Staging) -> None:
    stage = staging(without=frozenset({"manipulation"}))
    driver = stage.driver()
    stage.act(driver, Forward(0.7))
    with pytest.raises(Unavailable, match="have no arm"):
        stage.act(driver, Pick((1.6, 0.1, 0.4), "mug"))


# --- clocks ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("skew_s", [40.0, -40.0])
def test_a_clock_40_s_off_changes_nothing(staging: Staging, skew_s: float) -> None:
    stage = staging(skew_s=skew_s)
    driver = stage.driver()
    result = stage.act(driver, Forward(0.5))
    assert result.succeeded
    assert result.moved_m == pytest.approx(0.5, abs=0.06)
    off_s = (driver.capture().stamp_ns - time.time_ns()) / 1e9
    assert off_s == pytest.approx(skew_s, abs=5)  # stamps are the robot's


@pytest.mark.parametrize("jump_s", [40.0, -40.0])
def test_a_clock_that_jumps_while_it_runs_is_noticed_before_anything_moves(
    stage: Stage, jump_s: float
) -> None:
    driver = stage.driver()
    stage.act(driver, Observe())
    stage.world.skew_s += jump_s
    with pytest.raises(Unavailable, match=f"jumped by {jump_s:.0f} s"):
        stage.act(driver, Forward(0.5))
    assert stage.world.x == 0.0
    assert stage.act(driver, Forward(0.5)).succeeded


def test_an_answer_that_takes_long_is_no_clock_that_jumps(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = stage.driver()
    stage.act(driver, Observe())
    asked_and_answered = iter((time.time(), time.time() + 5.0))
    clock = SimpleNamespace(time=lambda: next(asked_and_answered))
    monkeypatch.setattr("helios_spot.robot_connection.time", clock)
    assert driver.state().message == ""


@pytest.mark.parametrize("broken", ["empty", "loose", "a ring"])
def test_a_broken_tree_of_frames_is_said_and_the_next_may_be_whole(
    stage: Stage, broken: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = stage.driver()

    def tree(*_: Any) -> Any:
        out = pb.geometry.FrameTreeSnapshot()
        edges = out.child_to_parent_edge_map
        if broken == "loose":
            edges["body"].parent_frame_name = "nowhere"
        if broken == "a ring":
            edges["body"].parent_frame_name, edges["vision"].parent_frame_name = "vision", "body"
        return out

    monkeypatch.setattr("tests.fake_spot.senses.frame_tree", tree)
    for ask in (driver.state, driver.capture):
        with pytest.raises(Unavailable, match="tree of frames"):
            ask()
    monkeypatch.undo()
    assert driver.capture().color.size


def test_a_command_that_comes_after_its_end_is_a_typed_error_and_done_never(stage: Stage) -> None:
    driver = stage.driver()
    stage.act(driver, Observe())
    stage.fake.commands.late_s = 2.0
    with pytest.raises(DeadlineExceeded, match=r"after its end.*send the action again"):
        driver.act(Forward(0.5), "late")
    standing(stage)
    assert "expired" in stage.world.log
    stage.fake.commands.late_s = 0.0
    again = driver.act(Forward(0.5), "late")
    assert not again.succeeded  # it was begun: never twice under one id
    assert "after its end" in again.reason
    assert stage.world.x == 0.0
    assert stage.act(driver, Forward(0.5)).succeeded


# --- the arm --------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("state", "reported"),
    [
        ("MANIP_STATE_GRASP_FAILED", "failed"),
        ("MANIP_STATE_GRASP_PLANNING_NO_SOLUTION", "no way to grasp"),
        ("MANIP_STATE_GRASP_FAILED_TO_RAYCAST_INTO_MAP", "no depth"),
    ],
)
def test_a_grasp_that_fails_is_a_result_and_the_next_one_may_succeed(
    stage: Stage, state: str, reported: str
) -> None:
    driver = stage.driver()
    stage.world.x, stage.world.y = 1.3, 0.6
    stage.world.grasp_outcome = state
    result = stage.act(driver, Pick(MUG_M, "mug"))
    assert not result.succeeded
    assert reported in result.reason
    assert driver.state().held == ""
    stage.world.grasp_outcome = ""
    assert stage.act(driver, Pick(MUG_M, "mug")).succeeded
    assert driver.state().held == "mug"


def test_a_grasp_without_end_is_given_up(stage: Stage) -> None:
    driver = stage.driver(grasp_timeout_s=0.5)
    stage.world.x, stage.world.y = 1.3, 0.6
    stage.world.grasp_outcome = "MANIP_STATE_SEARCHING_FOR_GRASP"
    result = stage.act(driver, Pick(MUG_M, "mug"))
    assert not result.succeeded
    assert "longer than 0.5 s" in result.reason


def test_what_is_out_of_reach_or_not_held_is_a_failed_action(stage: Stage) -> None:
    driver = stage.driver()
    stage.world.x, stage.world.y = -1.0, 0.6
    assert "no way to grasp" in stage.act(driver, Pick(MUG_M, "mug")).reason
    assert "holds nothing" in stage.act(driver, Place((0.0, 0.0, 0.5))).reason
    stage.world.x = 1.3
    assert stage.act(driver, Pick(MUG_M, "mug")).succeeded
    assert "holds something" in stage.act(driver, Pick(MUG_M, "mug")).reason
    assert "could not reach" in stage.act(driver, Place((3.5, 0.6, 0.7))).reason
    assert driver.state().held == "mug"


def test_an_arm_that_stalls_is_a_failed_action_and_the_hand_is_raised_by_the_next(
    stage: Stage,
) -> None:
    driver = stage.driver(hand_height_m=1.9)  # higher than the arm is long
    assert "stalled" in stage.act(driver, Observe()).reason
    assert "stalled" in stage.act(driver, Forward(0.5)).reason
    assert stage.world.x == 0.0  # blind, it does not walk
