"""Tests driving by hand through real processes: from Chromium, from Python, and during a task."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest
from helios_client.sdk import Helios
from helios_core.errors import Conflict, Unavailable
from playwright.sync_api import Browser, expect

from tests.browser import DEADLINE_MS
from tests.e2e.own_robot_up import OwnUp, own_robot_up
from tests.support import wait_until

ROBOT = "helios_examples.room_robot:RoomRobot"
expect.set_options(timeout=DEADLINE_MS)


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OwnUp]:
    needed = ("bridge", "map2d", "objectmap", "detector", "planner")
    with own_robot_up(tmp_path_factory.mktemp("teleop"), ROBOT, needed, "paint") as up:
        yield up


@pytest.fixture
def helios(up: OwnUp) -> Iterator[Helios]:
    with Helios(up.address) as helios:
        yield helios


def pose(helios: Helios) -> tuple[float, float, float]:
    state = helios.robot()["state"]
    assert state is not None
    assert state["pose"] is not None
    return state["pose"]["x_m"], state["pose"]["y_m"], state["pose"]["yaw_rad"]


def is_mapped(helios: Helios) -> bool:
    """Whether a keyframe has reached the map."""
    try:
        return helios.map_info()["version"] > 0
    except Unavailable:  # no keyframe yet
        return False


def test_a_held_key_on_the_page_moves_the_robot_and_a_release_stops_it(
    browser: Browser, up: OwnUp, helios: Helios
) -> None:
    page = browser.new_page()
    page.set_default_timeout(DEADLINE_MS)
    page.goto(up.address)
    expect(page.get_by_label("Drive ahead")).to_be_enabled()
    before = pose(helios)
    page.focus("#pad")
    page.keyboard.down("w")
    wait_until(lambda: pose(helios)[0] > before[0] + 0.15, 60, "the robot drives")
    page.keyboard.up("w")
    expect(page.locator("#drive-said")).to_be_empty()
    wait_until(lambda: is_mapped(helios), 60, "the map has the last image")
    stood = pose(helios)
    time.sleep(1.0)  # longer than any move
    assert pose(helios) == stood
    page.close()


def test_python_teleop_turns_the_robot_and_stops_when_commands_cease(helios: Helios) -> None:
    before = pose(helios)
    with helios.teleop() as drive:
        state = drive(turn=1.0, for_s=1.0)
        assert state.reason == ""
    assert pose(helios)[2] > before[2] + 0.1
    answer = helios.drive(turn_rad=-0.2)
    assert answer["succeeded"], answer["reason"]


def test_teleop_reports_blocked_at_a_wall(helios: Helios) -> None:
    with helios.teleop() as drive:
        deadline = time.monotonic() + 60
        while (state := drive(forward=1.0)).state != "blocked":
            assert time.monotonic() < deadline
            time.sleep(0.1)
    assert "blocked" in state.reason


def turns(helios: Helios) -> bool:
    """True if the robot turned; False while the gateway still holds the state before."""
    try:
        return helios.drive(turn_rad=0.2)["succeeded"]
    except Conflict:
        return False


def test_driving_is_refused_during_a_task_and_a_task_waits_for_the_driver(helios: Helios) -> None:
    let_go = threading.Event()
    refused: list[Exception] = []

    def hold() -> None:
        try:
            with helios.teleop() as drive:
                while not let_go.is_set():
                    drive(turn=0.5)
                    let_go.wait(0.05)
        except Conflict as error:
            refused.append(error)

    before, holder = pose(helios), threading.Thread(target=hold)
    holder.start()
    try:
        wait_until(lambda: pose(helios) != before, 60, "it is driven")
        task = helios.submit("find the shelf")
        wait_until(
            lambda: "drives the robot" in helios.task(task.id).message,
            60,
            "the task waits for who drives",
        )
        assert helios.task(task.id).steps == 0
    finally:
        let_go.set()
        holder.join()
    assert refused == []
    wait_until(lambda: helios.task(task.id).steps > 0, 60, "the task has the robot")
    with pytest.raises(Conflict, match=f"task {task.id} is running"), helios.teleop():
        pass
    with pytest.raises(Conflict, match="cancel it"):
        helios.drive(turn_rad=0.2)
    helios.stop_robot("child on the floor")
    wait_until(lambda: helios.task(task.id).state == "paused", 60, "the task waits")
    assert "child on the floor" in helios.task(task.id).message
    assert helios.status()["stop_reason"] == "child on the floor"
    helios.cancel(task.id)
    helios.wait(task.id, 60)
    with pytest.raises(Conflict, match="child on the floor"), helios.teleop():
        pass
    helios.clear_stop()
    wait_until(lambda: turns(helios), 60, "it may be driven again")
