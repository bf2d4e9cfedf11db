"""Tests that every fault gives a typed error with advice while the robot stands still."""

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
from helios_spot.settings import SpotSettings
from pydantic import SecretStr

from tests.fake_spot import pb
from tests.support import wait_until
from tests.unit.spot.conftest import Staging
from tests.unit.spot.spot_stage import Stage

MUG_M = (2.16, 0.6, 0.76)


def standing(stage: Stage, within_s: float = 5.0) -> None:
    wait_until(stage.standing_still, within_s, "the robot stands still")


# --- before anything moves ------------------------------------------------------------------------
def test_a_wrong_password_is_invalid_input_and_is_not_shown(stage: Stage) -> None:
    driver = stage.driver(connect=False, password=SecretStr("guess"))
    with pytest.raises(InvalidInput, match="HELIOS_SPOT_PASSWORD") as refused:
        driver.describe()
    assert "guess" not in refused.value.message
    assert not stage.world.motors


def test_an_unreachable_robot_is_unavailable_until_it_answers(stage: Stage) -> None:
    driver = stage.driver(connect=False)
    stage.cut(driver)
    with pytest.raises(Unavailable, match="check that it is on"):
        driver.describe()
    stage.mend(driver)
    assert driver.describe().name == "Spot"


def test_every_grpc_channel_reconnects_within_a_second(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By default gRPC waits longer after each failure, up to two minutes."""
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


def test_failed_time_synchronisation_is_reported(stage: Stage) -> None:
    stage.fake.clock.ready = False
    driver = stage.driver(connect=False, time_sync_s=0.5)
    with pytest.raises(Unavailable, match="time-sync"):
        driver.describe()


def test_a_missing_camera_is_refused_with_the_list_of_available_cameras(stage: Stage) -> None:
    driver = stage.driver(connect=False, camera="back")
    with pytest.raises(InvalidInput, match=r"back_fisheye_image.*hand_color_image"):
        driver.describe()


def test_a_broken_camera_is_reported(stage: Stage) -> None:
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
def test_a_power_refusal_is_reported_with_its_cause_and_nothing_moves(
    stage: Stage, refusal: str, mend: str
) -> None:
    stage.world.power_refusal = refusal
    driver = stage.driver()
    with pytest.raises(Conflict, match=mend):
        stage.act(driver, Forward(0.5))
    assert not stage.world.standing
    stage.world.power_refusal = ""
    assert stage.act(driver, Forward(0.5)).succeeded  # works after the repair


def test_motors_that_must_be_on_already_are_not_switched_on(stage: Stage) -> None:
    driver = stage.driver(power="expect")
    with pytest.raises(Conflict, match="switch them on"):
        stage.act(driver, Forward(0.5))
    assert not stage.world.motors


def test_a_pressed_e_stop_is_reported_by_name(stage: Stage) -> None:
    stage.world.estops.add("hardware button")
    driver = stage.driver()
    with pytest.raises(Conflict, match="hardware button is pressed; release it"):
        stage.act(driver, Turn(0.4))
    assert not stage.world.motors


def test_our_own_e_stop_endpoint_allows_motion(stage: Stage) -> None:
    driver = stage.driver(estop="endpoint")
    assert stage.act(driver, Turn(0.4)).succeeded
    assert not stage.world.estops


def test_a_replaced_e_stop_endpoint_is_reported_before_anything_moves(stage: Stage) -> None:
    driver = stage.driver(estop="endpoint", estop_timeout_s=3.0)
    stage.act(driver, Observe())
    stage.fake.estop.replace("the tablet")
    wait_until(lambda: not driver._control._estop._thread.is_alive(), 60, "ours is refused")
    with pytest.raises(Conflict, match=r"endpoint is gone.*restart the bridge"):
        stage.act(driver, Forward(0.5))
    assert stage.world.x == 0.0


def test_our_e_stop_endpoint_trips_after_the_driver_has_closed(stage: Stage) -> None:
    driver = stage.driver(estop="endpoint", estop_timeout_s=3.0)
    stage.act(driver, Observe())
    driver.close()
    assert stage.world.motors

    def tripped() -> bool:
        stage.world.step()
        return not stage.world.motors

    wait_until(tripped, 60, "the endpoint trips")
    assert stage.world.estops == {"software"}


def test_a_lease_of_another_client_is_taken_only_with_the_setting_take(stage: Stage) -> None:
    stage.fake.leases.give_to("the tablet")
    with pytest.raises(Conflict, match=r"the tablet holds.*HELIOS_SPOT_LEASE=take"):
        stage.act(stage.driver(), Turn(0.4))
    assert stage.world.lease_owner == "the tablet"
    assert stage.act(stage.driver(lease="take"), Turn(0.4)).succeeded


def test_a_pick_without_the_manipulation_service_is_unavailable(staging: Staging) -> None:
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
def test_a_clock_jump_is_detected_before_anything_moves(stage: Stage, jump_s: float) -> None:
    driver = stage.driver()
    stage.act(driver, Observe())
    stage.world.skew_s += jump_s
    with pytest.raises(Unavailable, match=f"jumped by {jump_s:.0f} s"):
        stage.act(driver, Forward(0.5))
    assert stage.world.x == 0.0
    assert stage.act(driver, Forward(0.5)).succeeded


def test_a_slow_answer_does_not_count_as_a_clock_jump(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = stage.driver()
    stage.act(driver, Observe())
    asked_and_answered = iter((time.time(), time.time() + 5.0))
    clock = SimpleNamespace(time=lambda: next(asked_and_answered))
    monkeypatch.setattr("helios_spot.robot_connection.time", clock)
    assert driver.state().message == ""


@pytest.mark.parametrize("broken", ["empty", "loose", "a ring"])
def test_a_broken_frame_tree_is_reported_and_the_next_valid_one_works(
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


def test_a_command_that_arrives_after_its_end_time_is_an_error_and_never_runs(stage: Stage) -> None:
    driver = stage.driver(command_s=1.0)
    stage.act(driver, Observe())
    stage.fake.commands.late_s = 2.0
    with pytest.raises(DeadlineExceeded, match=r"after its end.*send the action again"):
        driver.act(Forward(0.5), "late")
    standing(stage)
    assert "expired" in stage.world.log
    stage.fake.commands.late_s = 0.0
    again = driver.act(Forward(0.5), "late")
    assert not again.succeeded  # the action has begun: an id never runs twice
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


def test_a_grasp_that_does_not_end_times_out(stage: Stage) -> None:
    driver = stage.driver(grasp_timeout_s=0.5)
    stage.world.x, stage.world.y = 1.3, 0.6
    stage.world.grasp_outcome = "MANIP_STATE_SEARCHING_FOR_GRASP"
    result = stage.act(driver, Pick(MUG_M, "mug"))
    assert not result.succeeded
    assert "longer than 0.5 s" in result.reason


def test_a_pick_or_place_that_is_impossible_is_a_failed_action(stage: Stage) -> None:
    driver = stage.driver()
    stage.world.x, stage.world.y = -1.0, 0.6
    assert "no way to grasp" in stage.act(driver, Pick(MUG_M, "mug")).reason
    assert "holds nothing" in stage.act(driver, Place((0.0, 0.0, 0.5))).reason
    stage.world.x = 1.3
    assert stage.act(driver, Pick(MUG_M, "mug")).succeeded
    assert "holds something" in stage.act(driver, Pick(MUG_M, "mug")).reason
    assert "could not reach" in stage.act(driver, Place((3.5, 0.6, 0.7))).reason
    assert driver.state().held == "mug"


def test_a_stalled_arm_fails_every_action_before_the_robot_walks(stage: Stage) -> None:
    driver = stage.driver(hand_height_m=1.9)  # higher than the arm reaches
    assert "stalled" in stage.act(driver, Observe()).reason
    assert "stalled" in stage.act(driver, Forward(0.5)).reason
    assert stage.world.x == 0.0  # the robot does not walk without its camera raised


def test_an_e_stop_endpoint_is_not_set_up_while_the_motors_are_on(stage: Stage) -> None:
    stage.world.motors = True
    driver = stage.driver(estop="endpoint")
    with pytest.raises(Conflict, match="switch its motors off on the tablet"):
        stage.act(driver, Forward(0.3))


def test_settings_that_want_the_motors_both_off_and_on_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("HELIOS_SPOT_ESTOP", "endpoint")
    monkeypatch.setenv("HELIOS_SPOT_POWER", "expect")
    with pytest.raises(InvalidInput, match="HELIOS_SPOT_POWER=on, or HELIOS_SPOT_ESTOP=none"):
        SpotSettings.read("10.0.0.3")
