"""Whatever goes wrong ends in a typed error that says what to do, with the robot standing still."""

from __future__ import annotations

import threading
import time

import pytest
from helios_core.errors import (
    Conflict,
    DeadlineExceeded,
    HeliosError,
    InvalidInput,
    Unavailable,
)
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Forward, Observe, Pick, Place, Tilt, Turn
from pydantic import SecretStr

from tests.support import wait_until
from tests.unit.spot.conftest import Staging
from tests.unit.spot.spot_stage import Outcome, Stage

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
    stage.fake.wire.cut()
    with pytest.raises(Unavailable, match="check that it is on"):
        driver.describe()
    stage.fake.wire.mend()
    assert driver.describe().name == "Spot"


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
def test_without_power_nothing_moves_and_the_cause_is_told(
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


def test_a_clock_that_jumps_in_the_middle_of_a_walk_ends_it(staging: Staging) -> None:
    stage = staging(hurry=0.5)
    driver = stage.driver()
    stage.act(driver, Observe())

    def jump() -> None:
        stage.world.skew_s -= 40.0  # now the command would end in 41 s

    outcome = stage.during(driver, Forward(1.0), jump).wait()
    assert isinstance(outcome.error, Unavailable)
    standing(stage)
    assert stage.world.x < 0.9


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


# --- in the middle of a walk ----------------------------------------------------------------------
def test_a_hijacked_lease_ends_the_walk_and_names_the_new_owner(staging: Staging) -> None:
    stage = staging(hurry=0.5)
    driver = stage.driver()
    stage.act(driver, Observe())
    outcome = stage.during(
        driver, Forward(1.0), lambda: stage.fake.leases.give_to("the tablet")
    ).wait()
    assert isinstance(outcome.error, Conflict)
    assert "the tablet has taken the robot's lease" in outcome.error.message
    standing(stage)
    state = driver.state()
    assert state.stopped
    assert "the tablet" in state.message
    assert stage.world.lease_owner == "the tablet"
    stage.fake.leases.free()
    stage.world.hurry = 8.0
    with pytest.raises(Conflict, match="clear the stop"):  # a person stepped in
        stage.act(driver, Turn(0.3))
    driver.clear_stop()
    assert stage.act(driver, Turn(0.3)).succeeded


def test_an_e_stop_in_the_middle_of_a_walk_keeps_the_motors_off_until_a_person_clears_it(
    staging: Staging,
) -> None:
    stage = staging(hurry=0.5)
    driver = stage.driver()
    stage.act(driver, Observe())
    outcome = stage.during(
        driver, Forward(1.0), lambda: stage.world.press_estop("hardware button")
    ).wait()
    assert isinstance(outcome.error, Conflict)
    standing(stage)
    stage.world.estops.clear()
    with pytest.raises(Conflict, match="clear the stop"):
        stage.act(driver, Turn(0.3))
    assert not stage.world.motors
    driver.clear_stop()
    stage.world.hurry = 8.0
    assert stage.act(driver, Turn(0.3)).succeeded


def test_motors_switched_off_between_actions_do_not_come_back_by_themselves(stage: Stage) -> None:
    driver = stage.driver()
    stage.act(driver, Observe())
    with stage.world.lock:
        stage.world.motors = stage.world.standing = False
    for _ in range(2):
        with pytest.raises(Conflict, match="switched off"):
            stage.act(driver, Turn(0.3))
    assert not stage.world.motors
    driver.clear_stop()
    assert stage.act(driver, Turn(0.3)).succeeded


def test_the_link_cut_in_the_middle_of_a_walk_stops_the_robot_within_the_leash(
    staging: Staging,
) -> None:
    stage = staging(hurry=1.0)
    driver = stage.driver(speed_m_s=0.5, command_s=0.6)
    stage.act(driver, Observe())
    cut_at: list[float] = []

    def cut() -> None:
        stage.fake.wire.cut()
        cut_at.append(stage.world.x)

    outcome = stage.during(driver, Forward(1.0), cut).wait()
    assert isinstance(outcome.error, Unavailable)
    assert "ends by itself" in outcome.error.message
    standing(stage)
    assert "halt: the command ended" in stage.world.log
    assert stage.world.x - cut_at[0] <= 0.5 * 0.6 + 0.1
    stage.fake.wire.mend()
    stage.world.hurry = 8.0
    wait_until(lambda: connected(stage, driver), 15, "the driver finds the robot again")


def connected(stage: Stage, driver: object) -> bool:
    try:
        return stage.act(driver, Turn(0.3)).succeeded  # pyright: ignore[reportArgumentType]
    except HeliosError:
        return False


def test_the_planner_going_away_ends_the_walk_and_says_so(staging: Staging) -> None:
    stage = staging(hurry=0.5)
    hub = MemoryHub()
    planner = MemoryBus(hub).announce("planner", "one")
    driver = stage.driver(bus=MemoryBus(hub))
    stage.act(driver, Observe())
    outcome = stage.during(driver, Forward(1.0), planner.close).wait()
    assert outcome.result is not None
    assert not outcome.result.succeeded
    assert "planner went away" in outcome.result.reason
    assert outcome.result.moved_m < 0.9
    standing(stage)


def test_stop_now_from_another_thread_ends_the_walk_at_once_and_stays(staging: Staging) -> None:
    stage = staging(hurry=0.5)
    driver = stage.driver()
    stage.act(driver, Observe())
    outcome = stage.during(driver, Forward(1.0), lambda: driver.stop("a child in the way")).wait()
    assert outcome.result is not None
    assert outcome.result.reason == "a child in the way"
    assert outcome.result.moved_m < 0.9
    standing(stage)
    assert driver.state().stopped
    with pytest.raises(Conflict, match="a child in the way"):
        stage.act(driver, Turn(0.3))
    driver.clear_stop()
    stage.world.hurry = 8.0
    assert stage.act(driver, Turn(0.3)).succeeded


def test_stop_now_holds_however_often_it_comes_and_from_wherever(staging: Staging) -> None:
    stage = staging(hurry=0.5)
    driver = stage.driver()
    stage.act(driver, Observe())

    def stop_from_many() -> None:
        threads = [threading.Thread(target=driver.stop, args=("stop",)) for _ in range(5)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(10)

    stage.during(driver, Forward(1.0), stop_from_many).wait()
    standing(stage)
    with stage.world.lock:
        last_walk_end = max(i for i, what in enumerate(stage.world.log) if "halt" in what)
    assert last_walk_end >= 0


def test_stop_now_without_a_link_says_so_and_holds(staging: Staging) -> None:
    stage = staging(hurry=1.0)
    driver = stage.driver(command_s=0.6)
    stage.act(driver, Observe())
    refused: list[HeliosError] = []

    def cut_and_stop() -> None:
        stage.fake.wire.cut()
        try:
            driver.stop("stop now")
        except HeliosError as error:
            refused.append(error)

    outcome = stage.during(driver, Forward(1.0), cut_and_stop).wait()
    assert outcome.error is not None or not (outcome.result and outcome.result.succeeded)
    assert isinstance(refused[0], Unavailable)
    standing(stage)
    stage.fake.wire.mend()
    with pytest.raises(Conflict, match="stop now"):
        stage.act(driver, Turn(0.3))


def test_stop_now_before_the_robot_was_ever_asked_to_move_is_kept(stage: Stage) -> None:
    driver = stage.driver()
    driver.stop("not yet")
    with pytest.raises(Conflict, match="not yet"):
        stage.act(driver, Observe())
    assert not stage.world.motors


def test_a_walk_into_something_is_given_up_with_what_was_walked(stage: Stage) -> None:
    driver = stage.driver(blocked_s=0.5)
    stage.world.x, stage.world.y = 1.4, 0.6
    result = stage.act(driver, Forward(1.0))  # the table stands in the way
    assert not result.succeeded
    assert "blocked" in result.reason
    assert 0.1 < result.moved_m < 0.4
    standing(stage)


# --- the arm --------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("state", "told"),
    [
        ("MANIP_STATE_GRASP_FAILED", "failed"),
        ("MANIP_STATE_GRASP_PLANNING_NO_SOLUTION", "no way to grasp"),
        ("MANIP_STATE_GRASP_FAILED_TO_RAYCAST_INTO_MAP", "no depth"),
    ],
)
def test_a_grasp_that_fails_is_a_result_and_the_next_one_may_succeed(
    stage: Stage, state: str, told: str
) -> None:
    driver = stage.driver()
    stage.world.x, stage.world.y = 1.3, 0.6
    stage.world.grasp_outcome = state
    result = stage.act(driver, Pick(MUG_M, "mug"))
    assert not result.succeeded
    assert told in result.reason
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


# --- the end --------------------------------------------------------------------------------------
def test_closing_stops_the_robot_and_gives_the_lease_back(staging: Staging) -> None:
    stage = staging(hurry=0.5)
    driver = stage.driver()
    stage.act(driver, Observe())
    outcome = Outcome(stage, driver, Forward(1.0))
    wait_until(lambda: stage.world.moving, 10, "the robot moves")
    driver.close()
    outcome.wait()
    standing(stage)
    assert stage.world.lease_owner == ""


def test_closing_without_a_link_does_not_hang(stage: Stage) -> None:
    driver = stage.driver(estop="endpoint", rpc_timeout_s=0.5)
    stage.act(driver, Tilt(0.7))
    stage.fake.wire.cut()
    closing = threading.Thread(target=driver.close, daemon=True)
    closing.start()
    closing.join(15)
    assert not closing.is_alive()
