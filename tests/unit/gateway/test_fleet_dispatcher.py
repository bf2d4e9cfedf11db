"""The dispatcher over robots that drop out, and over links that lose requests and answers."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import pytest
from helios_core import proto as pb
from helios_core.errors import Conflict, InvalidInput
from helios_core.topics import SUBMIT, Method
from helios_gateway.error_responses import NotFound
from helios_gateway.fleet import dispatcher as dispatching
from helios_gateway.fleet import fleet_robot
from helios_gateway.fleet.records import Stage
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.unit.gateway.gateway_clock import Clock
from tests.unit.gateway.made_up_fleet import MadeUpFleet, MadeUpRobot


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """No waiting between attempts."""
    for name in ("DROPPED_S", "RETRY_S", "ASK_S"):
        monkeypatch.setattr(dispatching, name, 0.0)
    monkeypatch.setattr(fleet_robot, "LIST_AGAIN_S", 0.0)


def fleet_of(count: int, file: Path | None = None) -> MadeUpFleet:
    return MadeUpFleet([MadeUpRobot(f"robot-{k + 1}") for k in range(count)], file)


def state(fleet: MadeUpFleet, id: str) -> tuple[str, str]:
    task = fleet.dispatcher.queue.get(id)
    return task.state, task.robot


def test_a_task_beyond_the_most_that_the_fleet_takes_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("helios_gateway.fleet.queue.MOST_OPEN", 2)
    fleet = fleet_of(1)
    first = fleet.add("find the mug")
    fleet.add("find the cup")
    with pytest.raises(Conflict, match="2 tasks of the fleet wait or run"):
        fleet.add("find the book")
    fleet.dispatcher.cancel(first)
    fleet.add("find the book")


def test_a_task_goes_to_the_nearest_idle_robot_whose_map_knows_the_thing() -> None:
    fleet = fleet_of(4)
    fleet.robots["robot-2"].objects = [("mug", 5.0, 0.0, 0.6)]
    fleet.robots["robot-3"].objects = [("mug", 1.0, 1.0, 0.4), ("mug", 0.1, 0.0, 0.05)]
    fleet.robots["robot-4"].objects = [("mug", 0.1, 0.0, 0.9)]
    fleet.robots["robot-4"].stopped = True
    id = fleet.add("find the mug")
    fleet.cycle(2)
    assert state(fleet, id) == ("running", "robot-3")
    assert fleet.dispatcher.queue.get(id).why == (
        "robot-3's map had the mug 1.4 m away (score 0.40): the nearest of 2 idle robots with one "
        "in its map"
    )
    fleet.robots["robot-3"].finish()
    fleet.cycle()
    assert state(fleet, id) == ("succeeded", "robot-3")
    assert fleet.dispatcher.message(fleet.dispatcher.queue.get(id)) == "succeeded here"


def test_each_robot_has_one_task_and_the_rest_wait_in_the_order_of_priority() -> None:
    fleet = fleet_of(2)
    low, high, middle = (fleet.add("find the mug", priority=p) for p in (-5, 7, 0))
    fleet.cycle(2)
    assert state(fleet, high)[0] == state(fleet, middle)[0] == "running"
    assert state(fleet, low) == ("queued", "")
    assert fleet.dispatcher.message(fleet.dispatcher.queue.get(low)) == (
        "waits for an idle robot: 2 busy"
    )
    fleet.robots["robot-2"].finish()
    fleet.cycle(2)
    assert state(fleet, low) == ("running", "robot-2")


def test_a_robot_that_drops_out_gives_back_the_task_that_it_has_not_begun() -> None:
    fleet = fleet_of(2)
    first = fleet.robots["robot-1"]
    id = fleet.add("find the mug")
    fleet.dispatcher.cycle()  # the robot has the task, and does not begin it
    assert state(fleet, id) == ("queued", "robot-1")
    first.bridge = False
    fleet.dispatcher.cycle()
    assert state(fleet, id) == ("queued", "robot-2")
    assert fleet.dispatcher.queue.get(id).returned == 1
    first.bridge = True
    fleet.cycle(3)
    assert [t.state for t in first.tasks.values()] == ["cancelled"]
    assert fleet.begun("find the mug") == ["robot-2"]


def test_a_begun_task_stays_with_a_robot_that_is_away_and_says_so() -> None:
    fleet = fleet_of(2)
    id = fleet.add("find the mug")
    fleet.cycle(2)
    robot = fleet.robots["robot-1"]
    robot.here = robot.bridge = False
    fleet.cycle(3)
    assert state(fleet, id) == ("running", "robot-1")
    task = fleet.dispatcher.queue.get(id)
    assert fleet.dispatcher.message(task) == (
        "robot-1 is away; the task stays with it, as it may have begun"
    )
    fleet.dispatcher.cancel(id)
    assert "cancelled when the robot is back" in fleet.dispatcher.message(
        task.with_(cancelling=True)
    )
    robot.here = robot.bridge = True
    fleet.cycle(2)
    assert state(fleet, id) == ("cancelled", "robot-1")
    assert fleet.begun("find the mug") == ["robot-1"]


def test_an_offer_without_answer_goes_to_another_robot_and_is_dropped_at_the_first() -> None:
    fleet = fleet_of(2)
    first = fleet.robots["robot-1"]
    id = fleet.add("find the mug")
    first.reach = "answer lost"
    fleet.cycle()
    assert [t.on_hold for t in first.tasks.values()] == [True]
    first.bridge = False
    fleet.cycle(2)
    assert state(fleet, id) == ("running", "robot-2")
    assert len(fleet.dispatcher.queue.withdrawn()) == 1
    first.reach, first.bridge = "ok", True
    fleet.cycle()
    assert [t.state for t in first.tasks.values()] == ["cancelled"]
    assert fleet.dispatcher.queue.withdrawn() == []


def test_a_start_without_answer_stays_with_the_robot_until_it_answers(tmp_path: Path) -> None:
    fleet = fleet_of(2, tmp_path / "queue.sqlite")
    id = fleet.add("find the mug")
    queue, first = fleet.dispatcher.queue, fleet.robots["robot-1"]
    first.calls.clear()
    original = first.call

    def cut_at_start(method, request, timeout_s):
        if method.name == "planner/resume":
            first.reach = "answer lost"
        return original(method, request, timeout_s)

    first.call = cut_at_start  # type: ignore[method-assign]
    fleet.dispatcher.cycle()
    assert queue.get(id).stage is Stage.STARTING
    first.call = original  # type: ignore[method-assign]
    first.here = first.bridge = False
    fleet.restart()
    fleet.cycle(3)
    assert state(fleet, id) == ("queued", "robot-1")
    first.here, first.bridge, first.reach = True, True, "ok"
    fleet.cycle(3)
    assert fleet.begun("find the mug") == ["robot-1"]


def test_a_task_that_is_heard_while_the_robot_lists_its_tasks_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fleet = fleet_of(1)
    made_up, robot = fleet.robots["robot-1"], fleet.dispatcher.robots["robot-1"]
    made_up.tasks["a1"] = pb.Task(id="a1", state="running")
    robot.refresh()
    original = made_up.call

    def submitted_meanwhile(method, request, timeout_s):
        listed = original(method, request, timeout_s)
        assert made_up.hear is not None
        made_up.hear(pb.Task(id="b2", state="running"))
        return listed

    monkeypatch.setattr(made_up, "call", submitted_meanwhile)
    monkeypatch.setattr(fleet_robot, "REFRESH_S", -1.0)
    del made_up.tasks["a1"]  # it ended, and the gateway did not hear it
    robot.refresh()
    assert robot.newest("a1") is None
    assert robot.newest("b2") is not None
    assert robot.state() == "busy"


def test_an_unexpected_error_of_one_task_or_robot_does_not_hold_up_the_others(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    fleet = fleet_of(3)
    original = fleet.robots["robot-1"].call

    def broken(method: Method, request: Any, timeout_s: float) -> Any:
        raise TypeError(f"no answer can be read from {method.name}")

    first = fleet.add("find the mug", wanted="robot-1")
    second = fleet.add("find the can", wanted="robot-2")
    monkeypatch.setattr(fleet.robots["robot-1"], "call", broken)
    fleet.cycle(3)
    assert state(fleet, second) == ("running", "robot-2")
    assert caplog.text.count("robot robot-1 of the fleet: TypeError") == 1
    assert f"task {first} of the fleet: TypeError" in caplog.text
    assert "in broken" in caplog.text  # the traceback
    monkeypatch.setattr(fleet.robots["robot-1"], "call", original)
    fleet.cycle(3)
    assert state(fleet, first) == ("running", "robot-1")


def test_a_planner_that_does_not_list_its_tasks_is_asked_ever_more_rarely(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(fleet_robot, "LIST_AGAIN_S", 5.0)
    made_up, clock = MadeUpRobot("robot-1", reach="lost"), Clock()
    robot = fleet_robot.FleetRobot("robot-1", made_up.served(), 1.0, lambda: None, clock)

    def asked_s(seconds: int) -> list[float]:
        """Times after now at which the robot is asked, in cycles of half a second."""
        made_up.calls.clear()
        began_s, times_s = clock.now, list[float]()
        for _ in range(2 * seconds):
            robot.refresh()
            times_s += [clock.now - began_s] * len(made_up.calls)
            made_up.calls.clear()
            clock.now += 0.5
        return times_s

    assert asked_s(120) == [0, 5, 15, 35, 65, 95]
    made_up.here = False  # its planner starts anew
    robot.refresh()
    made_up.here = True
    assert asked_s(4) == [0]
    made_up.reach = "ok"
    made_up.tasks["a1"] = pb.Task(id="a1", state="running")
    assert asked_s(25) == [1]
    assert robot.state() == "busy"


def test_a_waiting_task_outlives_the_gateway(tmp_path: Path) -> None:
    fleet = fleet_of(1, tmp_path / "queue.sqlite")
    running, waiting = fleet.add("find the mug"), fleet.add("find the can", priority=3)
    ended = fleet.add("find the book", priority=9)
    fleet.cycle(2)
    fleet.robots["robot-1"].finish("failed")
    fleet.cycle(2)
    fleet.restart()
    assert state(fleet, ended) == ("failed", "robot-1")
    assert state(fleet, running) == ("queued", "")
    assert fleet.dispatcher.queue.get(waiting).request.priority == 3
    fleet.cycle(2)
    assert state(fleet, waiting) == ("running", "robot-1")
    assert fleet.begun("find the can") == ["robot-1"]


def test_a_refusal_passes_the_task_on_and_ends_it_when_no_robot_is_left() -> None:
    fleet = fleet_of(2)
    one, two = fleet.robots.values()
    id = fleet.add("find the mug")
    one.refuses = "the robot has no camera"
    fleet.cycle(3)
    assert state(fleet, id) == ("running", "robot-2")
    assert fleet.dispatcher.queue.get(id).refused == {"robot-1": "the robot has no camera"}
    last = fleet.add("find the can")
    two.refuses = "its detector does not know a can"
    two.finish()
    fleet.cycle(3)
    assert state(fleet, last)[0] == "failed"
    assert fleet.dispatcher.queue.get(last).message == (
        "no robot can do it; robot-2: its detector does not know a can"
    )


def test_a_robot_whose_queue_is_full_gets_the_task_once_there_is_room() -> None:
    fleet = fleet_of(1)
    robot = fleet.robots["robot-1"]
    robot.full = True
    id = fleet.add("find the mug")
    fleet.cycle(3)
    task = fleet.dispatcher.queue.get(id)
    assert (task.state, task.robot, task.refused) == ("queued", "", {})
    assert fleet.dispatcher.message(task) == "robot-1 could not take it: 64 tasks wait already"
    assert fleet.dispatcher.queue.withdrawn() == []
    robot.full = False
    fleet.cycle(2)
    assert state(fleet, id) == ("running", "robot-1")


@pytest.mark.parametrize("fault", [Conflict("it is full"), TypeError("no answer can be read")])
def test_a_robot_that_fails_on_an_offer_rests_while_another_one_gets_the_task(
    monkeypatch: pytest.MonkeyPatch, fault: Exception
) -> None:
    monkeypatch.setattr(dispatching, "RETRY_S", 3600.0)
    fleet = fleet_of(2)
    failing_at_submit(monkeypatch, fleet.robots["robot-1"], fault)
    id = fleet.add("find the mug")
    fleet.cycle(5)
    assert fleet.robots["robot-1"].calls.count("planner/submit") == 1
    assert state(fleet, id) == ("running", "robot-2")


def test_an_offer_that_fails_again_and_again_is_logged_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    fleet = fleet_of(1)
    failing_at_submit(monkeypatch, fleet.robots["robot-1"], TypeError("no answer can be read"))
    id = fleet.add("find the mug")
    fleet.cycle(5)
    assert fleet.robots["robot-1"].calls.count("planner/submit") > 1
    assert caplog.text.count(f"task {id} of the fleet: TypeError") == 1


def failing_at_submit(
    monkeypatch: pytest.MonkeyPatch, robot: MadeUpRobot, fault: Exception
) -> None:
    original = robot.call

    def call(method: Method, request: Any, timeout_s: float) -> Any:
        answer = original(method, request, timeout_s)
        if method is SUBMIT:
            raise fault
        return answer

    monkeypatch.setattr(robot, "call", call)


def test_an_instruction_that_no_robot_understands_is_refused_at_once() -> None:
    fleet = fleet_of(2)
    for robot in fleet.robots.values():
        robot.refuses = "no verb was understood"
    with pytest.raises(InvalidInput, match="no verb was understood"):
        fleet.add("dance")
    with pytest.raises(NotFound, match="there is no robot 'robot-9' here; there are: robot-1"):
        fleet.add("find the mug", wanted="robot-9")
    assert fleet.dispatcher.queue.tasks() == []


def test_a_task_for_one_robot_waits_for_it() -> None:
    fleet = fleet_of(2)
    second = fleet.robots["robot-2"]
    second.bridge = False
    id = fleet.add("find the mug", wanted="robot-2")
    fleet.cycle(3)
    assert state(fleet, id) == ("queued", "")
    task = fleet.dispatcher.queue.get(id)
    assert fleet.dispatcher.message(task) == "waits for robot-2, which is away"
    second.bridge = True
    fleet.cycle(2)
    assert state(fleet, id) == ("running", "robot-2")


def test_a_cancelled_task_begins_nowhere() -> None:
    fleet = fleet_of(1)
    waiting = fleet.add("find the mug")
    assert fleet.dispatcher.cancel(waiting).state == "cancelled"
    fleet.cycle(2)
    assert fleet.begun("find the mug") == []
    running = fleet.add("find the can")
    fleet.cycle(2)
    fleet.dispatcher.cancel(running)
    fleet.cycle()
    assert state(fleet, running) == ("cancelled", "robot-1")
    assert fleet.dispatcher.cancel(running).state == "cancelled"
    with pytest.raises(NotFound):
        fleet.dispatcher.cancel("0" * 12)


def test_a_cancel_that_its_robot_does_not_hear_is_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    fleet = fleet_of(1)
    id = fleet.add("find the mug")
    fleet.cycle(2)
    fleet.robots["robot-1"].here = False
    fleet.dispatcher.cancel(id)
    fleet.cycle(5)
    assert caplog.text.count("the planner of robot-1 is away") == 1


def test_a_robot_is_asked_nothing_of_a_task_whose_cancel_it_has_heard() -> None:
    fleet = fleet_of(1)
    robot = fleet.robots["robot-1"]
    id = fleet.add("find the mug")
    fleet.cycle(2)
    robot.reach = "lost"
    fleet.dispatcher.cancel(id)
    robot.reach = "ok"
    robot.calls.clear()
    fleet.cycle(2)
    assert state(fleet, id) == ("cancelled", "robot-1")
    assert robot.calls == ["planner/cancel"]


def test_a_task_that_ended_before_its_robot_heard_the_cancel_has_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dispatching, "ASK_S", float("inf"))
    fleet = fleet_of(1)
    robot = fleet.robots["robot-1"]
    id = fleet.add("find the mug")
    fleet.cycle(2)
    robot.finish()
    robot.here = False
    fleet.dispatcher.cancel(id)
    fleet.cycle()
    assert state(fleet, id) == ("succeeded", "robot-1")


def test_nothing_is_kept_of_tasks_that_have_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    fleet = fleet_of(3)
    failing_at_submit(monkeypatch, fleet.robots["robot-1"], Conflict("it is full"))
    refused = fleet.add("find the mug", wanted="robot-1")
    lost = fleet.add("find the can", wanted="robot-2")
    silent = fleet.add("find the cup", wanted="robot-3")
    fleet.cycle(3)
    fleet.robots["robot-3"].reach = "lost"
    fleet.cycle(2)
    assert len(fleet.dispatcher._said) == 2  # of the offer, and of the task without an answer
    fleet.dispatcher.cancel(refused)
    fleet.robots["robot-2"].tasks.clear()
    fleet.robots["robot-3"].reach = "ok"
    fleet.dispatcher.cancel(silent)
    fleet.cycle(2)
    assert [state(fleet, id)[0] for id in (refused, lost, silent)] == [
        "cancelled", "failed", "cancelled"
    ]  # fmt: skip
    assert fleet.dispatcher._said == fleet.dispatcher._asked_s == {}


def test_a_task_of_a_robot_that_is_no_longer_served_says_so_and_can_be_cancelled(
    tmp_path: Path,
) -> None:
    fleet = fleet_of(2, tmp_path / "queue.sqlite")
    id = fleet.add("find the mug", wanted="robot-2")
    fleet.cycle(2)
    del fleet.robots["robot-2"]
    fleet.restart()
    fleet.cycle(2)
    task = fleet.dispatcher.queue.get(id)
    assert fleet.dispatcher.message(task).startswith(
        "this gateway serves no robot robot-2 (--robots); the task stays with it"
    )
    cancelled = fleet.dispatcher.cancel(id)
    assert (cancelled.state, cancelled.robot) == ("cancelled", "robot-2")
    assert "its outcome is unknown" in fleet.dispatcher.message(cancelled)


# What happens to one robot, and whether the dispatcher and the robots then make a step.
CHANGES = ("ok", "lost", "answer lost", "late", "deliver", "finish", "away", "bridge away", "back",
           "restart", "nothing")  # fmt: skip
EVENTS = st.tuples(
    st.sampled_from(CHANGES), st.sampled_from(["robot-1", "robot-2"]), st.booleans(), st.booleans()
)


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(events=st.lists(EVENTS, min_size=10, max_size=30), cancelled=st.sets(st.integers(0, 2)))
def test_no_task_is_ever_begun_twice_and_each_one_ends(
    events: list[tuple[str, str, bool, bool]], cancelled: set[int]
) -> None:
    fleet = fleet_of(2)
    ids = [fleet.add(f"find the thing{k}") for k in range(3)]
    for number, (change, name, cycles, works) in enumerate(events):
        happen(fleet, change, fleet.robots[name])
        if cycles:
            fleet.dispatcher.cycle()
        for robot in fleet.robots.values() if works else ():
            robot.step()
        for k in cancelled if number == 8 else ():
            fleet.dispatcher.cancel(ids[k])
        assert all(len(fleet.begun(f"find the thing{k}")) <= 1 for k in range(3))
    for robot in fleet.robots.values():  # at last everything is well again
        robot.reach, robot.here, robot.bridge = "ok", True, True
        robot.deliver()
    for _ in range(12):
        fleet.cycle()
        for robot in fleet.robots.values():
            robot.finish()
    for k, id in enumerate(ids):
        task, begun = fleet.dispatcher.queue.get(id), fleet.begun(f"find the thing{k}")
        assert task.state in ("succeeded", "cancelled")
        assert begun == [task.robot] or (task.state == "cancelled" and len(begun) <= 1)


def happen(fleet: MadeUpFleet, change: str, robot: MadeUpRobot) -> None:
    """Change the link or the state of a robot, or restart the gateway."""
    if change == "restart":
        fleet.restart()
    elif change == "finish":
        robot.finish()
    elif change == "deliver":
        robot.deliver()
    elif change in ("away", "bridge away", "back"):
        robot.here = change != "away"
        robot.bridge = change == "back"
    elif change != "nothing":
        robot.reach = change
