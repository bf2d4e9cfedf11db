"""Blocked and narrow paths: the robot takes another path, or gives the goal up."""

from __future__ import annotations

import pytest
from helios_core.robot import Action, ActionResult, Forward
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.navigation.base_controller import Outcome
from helios_planner.task import Cause, TaskFailed
from planner_flat import coffee_table, counter, flat, mug
from planner_things import Box
from planner_trouble import bring, legs_in, once, troubled
from planner_world import FakeWorld


def test_a_newly_blocked_path_is_replaced_by_another() -> None:
    world = flat(start=Pose2(0.6, 3.0, 0.0))
    base = legs_in(world)
    box = Box(3.2, 2.5, 3.5, 3.5, 0.8)
    troubled(world, once(lambda: world.add_box(box), lambda: world.pose().x_m > 1.0))
    assert base.go_to(Pose2(3.95, 3.0, 0.0), "test") is Outcome.ARRIVED
    assert box in world.boxes
    assert world.contacts == 0


def test_a_path_narrower_than_wanted_is_still_taken() -> None:
    """A door of 0.68 m leaves 0.04 m on each side, where 0.08 m are wanted."""
    posts = [Box(4.3, 2.3, 4.6, 2.66, 2.5), Box(4.3, 3.34, 4.6, 3.7, 2.5)]
    world = flat(start=Pose2(1.5, 3.0, 0.0), extra=posts)
    assert legs_in(world).go_to(Pose2(6.0, 3.0, 0.0), "test") is Outcome.ARRIVED
    assert world.contacts == 0


def test_a_robot_that_never_comes_nearer_gives_the_goal_up() -> None:
    """On a slippery floor the robot ends each move where it began."""
    world = flat(start=Pose2(1.5, 3.0, 0.0))
    base = legs_in(world)

    def slips(_: FakeWorld, action: Action) -> ActionResult | None:
        return ActionResult(True, moved_m=0.2) if isinstance(action, Forward) else None

    troubled(world, slips).look = lambda: None  # the robot sees nothing new either
    before = world.steps
    assert base.go_to(Pose2(3.5, 3.0, 0.0), "test") is Outcome.UNREACHABLE
    assert world.steps - before <= 80 + 10 * 2


def test_a_goal_without_a_path_is_soon_reported_unreachable() -> None:
    world = flat(start=Pose2(1.5, 3.0, 0.0))
    base = legs_in(world)
    shut = Box(4.3, 2.4, 4.6, 3.6, 2.5)
    troubled(world, once(lambda: world.add_box(shut), lambda: world.pose().x_m > 2.0))
    before = world.steps
    assert base.go_to(Pose2(6.0, 3.0, 0.0), "test") is Outcome.UNREACHABLE
    assert world.steps - before < 80
    assert world.contacts == 0


def test_a_visible_but_unreachable_mug_fails_the_task_with_a_cause() -> None:
    fence = [
        Box(5.6, 4.5, 8.4, 4.7, 0.6),
        Box(5.6, 4.5, 5.8, 6.9, 0.6),
        Box(8.2, 4.5, 8.4, 6.9, 0.6),
    ]
    world = flat([coffee_table(), counter(), mug()], extra=fence)
    with pytest.raises(TaskFailed) as failure:
        bring(world, rounds=1)
    assert failure.value.cause is Cause.OBJECT_NOT_FOUND
    assert world.picks == 0
    assert world.contacts == 0
