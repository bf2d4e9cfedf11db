"""Objects in the gripper when a task begins or ends: they are neither lost nor confused."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import state_to_proto
from helios_core.robot import Action, ActionResult, Pick, Place
from helios_core.topics import CANCEL, GET_STATE
from helios_core.types import RobotState
from helios_planner.instruction.parser import parse
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed
from helios_planner.tasks.mission import Mission
from helios_planner.tasks.run_control import LastAction
from planner_bus import ended, submit, task
from planner_flat import MOVE, flat_with_mug
from planner_group import PlannerGroup
from planner_things import Thing
from planner_world import FakeWorld

from tests.support import wait_until


def holding_a_mug() -> FakeWorld:
    world = flat_with_mug()
    world._held = world.things[3]
    return world


def mission(world: FakeWorld, text: str) -> Mission:
    return Mission(world, parse(text), Settings(rounds=1))


def test_an_object_that_is_already_held_is_only_placed() -> None:
    world = holding_a_mug()
    assert mission(world, MOVE).run().startswith("put the mug on the counter")
    assert not any(isinstance(action, Pick) for action in world.log)
    assert world.released is world.things[3]


def test_another_object_in_the_gripper_fails_the_task_before_its_first_step() -> None:
    world = holding_a_mug()
    with pytest.raises(TaskFailed, match="not free for the can: a mug is in it") as failure:
        mission(world, "Move the can to the counter").run()
    assert failure.value.cause is Cause.PICK_FAILED
    assert world.steps == 0


@pytest.mark.parametrize("text", ["find the can", "go to the counter"])
def test_find_and_go_to_tasks_run_while_the_robot_holds_an_object(text: str) -> None:
    world = holding_a_mug()
    near = world.things[3]
    world.things[4] = Thing(4, "can", near.center_m + np.array([0.2, 0, 0]), near.size_m)
    mission(world, text).run()
    assert world.held() == "mug"


def test_a_failed_last_pick_is_restored_as_failed_whatever_the_gripper_holds() -> None:
    again = mission(holding_a_mug(), "Move the can to the counter")
    checkpoint = again.checkpoint() | {"target_m": [1.0, 1.0, 0.5]}
    again.restore(checkpoint, LastAction(Pick((1.0, 1.0, 0.5), "can"), False, "it is full", "mug"))
    assert again.picked_at_m is None
    assert again.skills.last_reason == "it is full"


def test_a_task_whose_time_is_up_reports_the_held_object(group: PlannerGroup) -> None:
    world = flat_with_mug()
    group.peers(world)
    bus = group.planner()
    act = world.act

    def slow_when_carrying(action: Action) -> ActionResult:
        result = act(action)
        if world.held():
            wait_until(lambda: time.time() > ends_s[0], 60, "its time is up")
        return result

    ends_s = [float("inf")]
    world.act = slow_when_carrying
    world._held = world.things[3]
    limit_s = 0.5
    id = submit(bus, MOVE, time_limit_s=limit_s).id
    wait_until(lambda: task(bus, id).started_s > 0, 60, "it runs")
    ends_s[0] = task(bus, id).started_s + limit_s
    done = ended(bus, id)
    assert (done.state, done.cause) == ("failed", "step budget")
    assert "0.5 s are used up" in done.message
    assert "it holds a mug (“put the mug on the …” sets it down)" in done.message


def test_a_cancelled_task_reports_the_held_object_and_the_next_task_places_it(
    group: PlannerGroup,
) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner()
    gate = threading.Event()
    act = peers.world.act

    def slow_when_carrying(action: Action) -> ActionResult:
        if peers.world.held():
            gate.wait(60)
        return act(action)

    peers.world.act = slow_when_carrying
    id = submit(bus).id
    wait_until(lambda: bool(peers.world.held()), 60, "it carries the mug")
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    gate.set()
    done = ended(bus, id)
    assert done.state == "cancelled"
    assert "it holds a mug (“put the mug on the …” sets it down)" in done.message
    second = submit(bus, "put the mug on the counter").id
    assert ended(bus, second).state == "succeeded", task(bus, second).message
    kinds = [type(action) for action in peers.world.log]
    assert (kinds.count(Pick), kinds.count(Place)) == (1, 1)


def test_a_cancelled_task_ends_as_cancelled_although_the_robots_state_is_unusable(
    group: PlannerGroup,
) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner()
    peers.gate = threading.Event()
    id = submit(bus, "find the mug").id
    wait_until(peers.acting.is_set, 60, "it acts")
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    lost = RobotState(np.full((4, 4), np.nan))
    peers.bus.serve(GET_STATE, lambda _: state_to_proto(lost))
    peers.gate.set()
    done = ended(bus, id)
    assert (done.state, done.message) == ("cancelled", "cancelled; the robot stands")
