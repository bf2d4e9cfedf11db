"""Whole missions in a fake world of plain arrays."""

from __future__ import annotations

from typing import Any

import pytest
from helios_planner.decisions.decision import Do
from helios_planner.instruction.parser import parse
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.settings import Settings
from helios_planner.task import Cause, Phase, TaskFailed
from helios_planner.tasks.mission import Mission
from planner_flat import MOVE, coffee_table, counter, flat, mug
from planner_things import Box
from planner_world import FakeWorld


def test_a_mug_in_another_room_is_brought_to_the_counter_without_contact() -> None:
    world = flat([coffee_table(), counter(), mug()])
    Mission(world, parse(MOVE), Settings()).run()
    assert world.contacts == 0
    assert world.released is not None
    x, y, _ = world.released.center_m
    assert 1.2 < x < 3.2
    assert 6.3 < y < 6.95


def run(world: FakeWorld, text: str = MOVE, **settings: Any) -> str:
    return Mission(world, parse(text), Settings(**settings)).run()


def test_phases_come_in_order_and_every_decision_has_a_reason() -> None:
    world = flat([coffee_table(), counter(), mug()])
    run(world)
    order = [Phase.FIND_OBJECT, Phase.PICK, Phase.FIND_RECEPTACLE, Phase.PLACE]
    assert [p for p in order if p in world.phases] == order
    assert world.phases[-1] is Phase.PLACE
    assert all(d.why and (d.winner is not None or d.do is not Do.ACT) for d in world.decisions)


def test_a_false_mug_is_looked_at_again_and_not_picked() -> None:
    """Detected in 3 of 10 views: its score settles below tau_g, so only the true one is taken."""
    false = mug(4, x=2.9, y=6.5, z=0.95, rate=0.3)
    world = flat([coffee_table(), counter(), mug(), false])
    run(world)
    assert world.released is world.things[3]
    assert world.picks == 1
    assert world.contacts == 0


def test_a_pick_that_slips_is_tried_again_from_another_place() -> None:
    slippery = mug()
    slippery.slippery = 1
    world = flat([coffee_table(), counter(), slippery])
    run(world)
    assert world.picks == 2
    assert world.released is slippery


def test_a_limit_of_picks_ends_the_task() -> None:
    slippery = mug()
    slippery.slippery = 9
    with pytest.raises(TaskFailed) as failure:
        run(flat([coffee_table(), counter(), slippery]), max_picks=1)
    assert failure.value.cause is Cause.PICK_FAILED


def test_a_home_without_a_mug_is_searched_and_the_task_fails_with_the_cause() -> None:
    world = flat([coffee_table(), counter()])
    with pytest.raises(TaskFailed) as failure:
        run(world, rounds=1)
    assert failure.value.cause is Cause.OBJECT_NOT_FOUND
    assert any(d.do is Do.SEARCH_RECEPTACLE for d in world.decisions)
    assert world.contacts == 0


def test_a_home_without_a_counter_fails_the_task_with_receptacle_not_found() -> None:
    with pytest.raises(TaskFailed) as failure:
        run(flat([coffee_table(), mug()]), rounds=1)
    assert failure.value.cause is Cause.RECEPTACLE_NOT_FOUND


def test_an_invisible_obstacle_is_avoided_after_a_contact() -> None:
    """The obstacle stands on the path to the first door; after a contact it is remembered."""
    hidden = Box(3.0, 2.8, 3.2, 3.2, 0.5, hidden=True)
    world = flat([coffee_table(), counter(), mug()], start=Pose2(1.5, 3.0, 0.0), extra=[hidden])
    run(world)
    assert world.released is not None
    assert world.contacts <= 3


def test_find_and_go_to_tasks_do_not_use_the_arm() -> None:
    world = flat([coffee_table(), counter(), mug()])
    assert "found the mug" in run(world, "find the mug")
    assert world.pose().distance_m(world.things[3].center_m[:2]) < 2.2
    assert "stands at the counter" in run(world, "go to the counter")
    assert world.pose().distance_m((2.2, 6.6)) < 2.2
    assert world.contacts == 0
    chosen = [d.why for d in world.decisions if d.do is Do.ACT and "counter" in d.why]
    assert chosen
    assert all(why.startswith("stop at the counter") for why in chosen)  # nothing is placed


def test_the_step_budget_ends_a_task() -> None:
    world = flat([coffee_table(), counter(), mug()])
    world.max_steps = 20
    with pytest.raises(TaskFailed) as failure:
        run(world)
    assert failure.value.cause is Cause.STEP_BUDGET
