"""Tests faults and interventions while Spot walks: the robot stands still and gives the reason."""

from __future__ import annotations

import threading
from typing import Any

import pytest
from helios_core.errors import Conflict, HeliosError, Unavailable
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Forward, Observe, Pick, Tilt, Turn
from helios_spot.driver import SpotDriver
from helios_spot.halt_conditions import Halt, Halted

from tests.support import wait_until
from tests.unit.spot.conftest import Staging
from tests.unit.spot.spot_stage import Outcome, Stage


def standing(stage: Stage, within_s: float = 5.0) -> None:
    wait_until(stage.standing_still, within_s, "the robot stands still")


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
    with pytest.raises(Conflict, match="clear the stop"):  # after an intervention
        stage.act(driver, Turn(0.3))
    driver.clear_stop()
    assert stage.act(driver, Turn(0.3)).succeeded


def test_an_e_stop_during_a_walk_keeps_the_motors_off_until_the_stop_is_cleared(
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


def test_motors_switched_off_between_actions_stay_off_until_the_stop_is_cleared(
    stage: Stage,
) -> None:
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


def test_a_link_failure_during_a_walk_stops_the_robot_within_the_command_time(
    staging: Staging,
) -> None:
    stage = staging(hurry=1.0)
    driver = stage.driver(speed_m_s=0.5, command_s=1.0)
    stage.act(driver, Observe())
    cut_at: list[float] = []

    def cut() -> None:
        stage.cut(driver)
        cut_at.append(stage.world.x)

    outcome = stage.during(driver, Forward(1.0), cut).wait()
    assert isinstance(outcome.error, Unavailable)
    assert "ends by itself" in outcome.error.message
    standing(stage)
    assert "halt: the command ended" in stage.world.log
    assert stage.world.x - cut_at[0] <= 0.5 * 1.0 + 0.1
    stage.mend(driver)
    stage.world.hurry = 8.0
    wait_until(lambda: connected(stage, driver), 60, "the driver finds the robot again")


def connected(stage: Stage, driver: SpotDriver) -> bool:
    try:
        return stage.act(driver, Turn(0.3)).succeeded
    except HeliosError:
        return False


def test_an_action_interrupted_by_a_link_failure_does_not_run_again(staging: Staging) -> None:
    stage = staging(hurry=0.5)
    driver = stage.driver()
    cut = stage.during(driver, Forward(1.0), lambda: stage.cut(driver)).wait(30)
    assert isinstance(cut.error, Unavailable)
    stage.mend(driver)
    standing(stage)
    before = (stage.world.x, stage.world.y)
    again = driver.act(Forward(1.0), f"action-{stage._number}")
    assert (again.succeeded, again.reason) == (False, cut.error.message)
    assert (stage.world.x, stage.world.y) == before


def test_a_walk_ends_with_a_reason_when_the_planner_disappears(staging: Staging) -> None:
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


@pytest.mark.parametrize("first", ["one", "two"])
def test_a_walk_ends_when_the_last_of_two_planners_disappears(staging: Staging, first: str) -> None:
    stage = staging(hurry=0.5)
    hub = MemoryHub()
    planners = {name: MemoryBus(hub).announce("planner", name) for name in ("one", "two")}
    driver = stage.driver(bus=MemoryBus(hub))
    stage.act(driver, Observe())

    def one_goes() -> None:
        planners.pop(first).close()
        assert not driver._halt._set.is_set()
        planners.popitem()[1].close()

    outcome = stage.during(driver, Forward(1.0), one_goes).wait()
    assert outcome.result is not None
    assert "planner went away" in outcome.result.reason
    standing(stage)


def test_stop_now_from_another_thread_ends_the_walk_and_latches(staging: Staging) -> None:
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


def test_concurrent_stop_now_calls_end_the_walk_and_latch(staging: Staging) -> None:
    stage = staging(hurry=0.5)
    driver = stage.driver()
    stage.act(driver, Observe())

    def stop_from_many() -> None:
        threads = [threading.Thread(target=driver.stop, args=("stop",)) for _ in range(5)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(10)

    result = stage.during(driver, Forward(1.0), stop_from_many).wait().result
    assert result is not None
    assert result.reason == "stop"
    assert result.moved_m < 0.9
    assert driver.state().stopped
    standing(stage)
    with stage.world.lock:
        last_stop = max(i for i, what in enumerate(stage.world.log) if what == "stop")
        assert "walk" not in stage.world.log[last_stop:]


def test_a_stop_cleared_before_the_check_ends_only_the_running_action() -> None:
    halt = Halt()
    halt.begin()
    halt.stop("a child in the way")
    halt.clear()
    with pytest.raises(Halted, match="a child in the way"):
        halt.check()
    halt.end()
    halt.begin()
    halt.check()


def test_a_stop_cleared_at_once_still_ends_the_walk(staging: Staging) -> None:
    stage = staging(hurry=0.5)
    driver = stage.driver()
    stage.act(driver, Observe())

    def stop_and_clear() -> None:
        driver.stop("a child in the way")
        driver.clear_stop()

    outcome = stage.during(driver, Forward(1.0), stop_and_clear).wait()
    assert outcome.result is not None
    assert outcome.result.reason == "a child in the way"
    standing(stage)
    assert stage.world.x < 0.9
    stage.world.hurry = 8.0
    assert stage.act(driver, Turn(0.3)).succeeded


MUG_M = (2.16, 0.6, 0.76)


def test_a_stop_that_overtakes_a_command_stays_in_force(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = stage.driver()
    stage.act(driver, Observe())
    send = driver._link.command

    def overtaken(command: Any, what: str, end_s: float | None = None) -> int:
        if what == "walk":
            driver.stop("a person")  # the stop reaches the robot first
        return send(command, what, end_s)

    monkeypatch.setattr(driver._link, "command", overtaken)
    result = stage.act(driver, Forward(1.0))
    assert (result.succeeded, result.reason) == (False, "a person")
    assert stage.standing_still()
    assert result.moved_m < 0.3


def test_stop_now_without_a_link_raises_unavailable_and_latches(staging: Staging) -> None:
    stage = staging(hurry=1.0)
    driver = stage.driver(command_s=0.6)
    stage.act(driver, Observe())
    refused: list[HeliosError] = []

    def cut_and_stop() -> None:
        stage.cut(driver)
        try:
            driver.stop("stop now")
        except HeliosError as error:
            refused.append(error)

    outcome = stage.during(driver, Forward(1.0), cut_and_stop).wait()
    assert outcome.error is not None or not (outcome.result and outcome.result.succeeded)
    assert isinstance(refused[0], Unavailable)
    standing(stage)
    stage.mend(driver)
    with pytest.raises(Conflict, match="stop now"):
        stage.act(driver, Turn(0.3))


def test_stop_now_before_the_first_action_latches(stage: Stage) -> None:
    driver = stage.driver()
    driver.stop("not yet")
    with pytest.raises(Conflict, match="not yet"):
        stage.act(driver, Observe())
    assert not stage.world.motors


def test_a_blocked_walk_is_aborted_and_reports_the_distance_walked(stage: Stage) -> None:
    driver = stage.driver(blocked_s=0.5, speed_m_s=0.05)  # the walk itself may take a minute
    stage.world.x, stage.world.y = 1.4, 0.6
    result = Outcome(stage, driver, Forward(1.0)).wait(40).result  # the table blocks the path
    assert result is not None
    assert not result.succeeded
    assert "blocked" in result.reason
    assert 0.1 < result.moved_m < 0.4
    standing(stage)


def test_a_clock_jump_during_a_walk_ends_the_walk(staging: Staging) -> None:
    stage = staging(hurry=0.5)
    driver = stage.driver()
    stage.act(driver, Observe())

    def jump() -> None:
        stage.world.skew_s -= 40.0  # now the command would end in 41 s

    outcome = stage.during(driver, Forward(1.0), jump).wait()
    assert isinstance(outcome.error, Unavailable)
    standing(stage)
    assert stage.world.x < 0.9


# --- the end --------------------------------------------------------------------------------------
def test_closing_the_driver_stops_the_robot_and_returns_the_lease(staging: Staging) -> None:
    stage = staging(hurry=0.5)
    driver = stage.driver()
    stage.act(driver, Observe())
    outcome = Outcome(stage, driver, Forward(1.0))
    wait_until(lambda: stage.world.moving, 60, "the robot moves")
    driver.close()
    outcome.wait()
    standing(stage)
    assert stage.world.lease_owner == ""


def test_closing_the_driver_without_a_link_does_not_hang(stage: Stage) -> None:
    driver = stage.driver(estop="endpoint")
    stage.act(driver, Tilt(0.7))
    stage.cut(driver)
    closing = threading.Thread(target=driver.close, daemon=True)
    closing.start()
    closing.join(60)
    assert not closing.is_alive()


def test_a_stop_that_overtakes_a_grasp_is_sent_again_at_once(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = stage.driver()
    stage.world.x, stage.world.y = 1.3, 0.6
    stage.act(driver, Observe())
    client: Any = driver._link.client("manipulation")
    send, read, order = client.manipulation_api_command, driver._link.read, []

    def noted_read() -> Any:
        order.append("read")
        return read()

    def overtaken(request: Any, **options: Any) -> Any:
        driver.stop("a person")  # the stop reaches the robot first
        monkeypatch.setattr(driver._motion, "stop_if_heard", lambda: order.append("stop"))
        monkeypatch.setattr(driver._link, "read", noted_read)
        return send(request, **options)

    monkeypatch.setattr(client, "manipulation_api_command", overtaken)
    result = stage.act(driver, Pick(MUG_M, "mug"))
    assert (result.succeeded, result.reason) == (False, "a person")
    assert order[0] == "stop"
