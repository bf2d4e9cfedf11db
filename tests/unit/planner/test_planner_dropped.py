"""Objects that are not grasped, or fall while carried or placed: the robot retries a few times."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from helios_core.robot import Action, ActionResult, Forward, Pick, Place, Turn
from helios_planner.motion_planning.base_placement import OTHER_SIDE_M
from helios_planner.motion_planning.costmap import GroundMap
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed
from planner_flat import coffee_table, counter, flat, mug
from planner_things import Box
from planner_trouble import Trouble, bring, troubled
from planner_world import FakeWorld

COUNTER_M = 0.9  # height of the flat's counter
BOOK = Box(2.95, 6.3, 3.2, 6.6, COUNTER_M + 0.04)  # where a robot from the coffee table arrives


def test_a_pick_that_leaves_the_gripper_empty_fails_although_it_reports_success() -> None:
    world = troubled(
        flat([coffee_table(), counter(), mug()]),
        lambda _, action: ActionResult(True) if isinstance(action, Pick) else None,
    )
    with pytest.raises(TaskFailed, match="holds nothing") as failure:
        bring(world, rounds=1)
    assert failure.value.cause is Cause.PICK_FAILED
    assert world.picks == Settings().picks_per_object
    assert world.retired == []  # an object that was not grasped stays in the map


def falling(times: int, after: int = 4) -> Trouble:
    """Drop the carried object to the floor beside the robot, `after` actions after each pick."""
    left, carried = [times], [0]

    def trouble(world: FakeWorld, action: Action) -> None:
        carried[0] = carried[0] + 1 if world.held() else 0
        if carried[0] > after and left[0] and isinstance(action, Turn | Forward):
            left[0] -= 1
            thing, pose = world.things[3], world.pose()
            thing.center_m = np.array([pose.x_m, pose.y_m - 0.7, 0.05])
            thing.views.clear()
            world._held = None

    return trouble


def test_an_object_that_fell_on_the_way_is_picked_up_again() -> None:
    world = troubled(flat([coffee_table(), counter(), mug()]), falling(1))
    bring(world)
    hands = [type(a) for a in world.log if isinstance(a, Pick | Place)]
    assert hands == [Pick, Pick, Place]  # noticed at once, not at the counter
    assert world.released is world.things[3]
    assert world.retired == [3, 3]  # once per grasp
    fell = [message for _, message in world.said if message.startswith("the mug fell: ")]
    assert fell[0].endswith("; looking for the mug")
    assert "; looking" not in fell[-1]  # the next decision's message repeats it


def test_an_object_that_falls_during_the_first_look_around_is_picked_up_again() -> None:
    """An earlier task has left the mug in the gripper."""
    world = troubled(flat([coffee_table(), counter(), mug()]), falling(1, after=3))
    world._held = world.things[3]
    bring(world)
    hands = [type(a) for a in world.log if isinstance(a, Pick | Place)]
    assert hands == [Pick, Place]
    assert world.released is world.things[3]
    assert any(message.startswith("the mug fell: ") for _, message in world.said)


def test_a_single_wrong_gripper_reading_does_not_count_as_a_drop() -> None:
    world = flat([coffee_table(), counter(), mug()])
    honest, asked = world.held, [0]

    def mistaken() -> str:
        asked[0] += bool(honest())
        return "" if asked[0] == 6 else honest()

    world.held = mistaken
    bring(world)
    assert asked[0] > 6
    assert world.picks == 1


def test_an_object_that_falls_too_often_is_given_up() -> None:
    world = troubled(flat([coffee_table(), counter(), mug()]), falling(99))
    with pytest.raises(TaskFailed, match="fell 3 times") as failure:
        bring(world)
    assert failure.value.cause is Cause.PLACE_MISSED


def test_an_object_that_fell_while_being_placed_is_picked_up_and_placed_again() -> None:
    left = [1]

    def slips(world: FakeWorld, action: Action) -> ActionResult | None:
        if not isinstance(action, Place) or not left[0]:
            return None
        left[0] -= 1
        world.things[3].center_m = np.array([world.pose().x_m, world.pose().y_m - 0.7, 0.05])
        world.things[3].views.clear()
        world._held = None
        return ActionResult(False, "it slipped out of the gripper")

    world = troubled(flat([coffee_table(), counter(), mug()]), slips)
    bring(world)
    assert world.picks == 2
    assert world.released is not None


def test_nothing_is_placed_on_clutter_that_is_seen_only_from_near() -> None:
    """From afar no surface is seen, so the edge is chosen; from near the book on it is seen."""
    world = flat([coffee_table(), counter(), mug()], extra=[BOOK])
    reported = world.ground

    def ground() -> GroundMap:
        known = reported()
        if world.pose().y_m > 5.5:
            return known
        return replace(known, top_m=np.where(known.top_m >= COUNTER_M, 0, known.top_m))

    world.ground = ground
    bring(world)
    assert [type(a) for a in world.log if isinstance(a, Pick | Place)] == [Pick, Place]
    assert world.released is not None
    assert world.released.center_m[2] == pytest.approx(COUNTER_M + 0.05)


def test_an_object_is_placed_on_top_of_what_covers_a_counter() -> None:
    board = Box(1.2, 6.3, 3.2, 6.95, COUNTER_M + 0.04)
    world = flat([coffee_table(), counter(), mug()], extra=[board])
    bring(world, places_per_receptacle=1)
    assert [type(a) for a in world.log if isinstance(a, Pick | Place)] == [Pick, Place]


def test_a_place_that_fails_is_tried_at_other_points_and_then_given_up() -> None:
    def refusing(world: FakeWorld, action: Action) -> ActionResult | None:
        return ActionResult(False, "no room") if isinstance(action, Place) else None

    world = troubled(flat([coffee_table(), counter(), mug()]), refusing)
    with pytest.raises(TaskFailed, match="no room") as failure:
        bring(world, rounds=1, rounds_held=1, place_at_last=1)
    assert failure.value.cause is Cause.PLACE_MISSED
    asked = [a.point_world_m[:2] for a in world.log if isinstance(a, Place)]
    assert 2 <= len(asked) <= Settings().places_per_receptacle
    assert min(math.dist(a, b) for a in asked for b in asked if a is not b) > 0.1


@pytest.mark.parametrize(("rounds_held", "place_at_last"), [(2, 1.0), (1, 0.9)])
def test_the_next_round_and_the_last_resort_try_other_points_of_the_receptacle(
    rounds_held: int, place_at_last: float
) -> None:
    most = Settings().places_per_receptacle
    asked: list[tuple[float, float]] = []

    def refusing(world: FakeWorld, action: Action) -> ActionResult | None:
        if not isinstance(action, Place):
            return None
        asked.append(action.point_world_m[:2])
        return ActionResult(False, "no room") if len(asked) <= most else None

    world = troubled(flat([coffee_table(), counter(), mug()]), refusing)
    bring(world, rounds=1, rounds_held=rounds_held, place_at_last=place_at_last)
    assert world.released is not None
    assert len(asked) == most + 1
    assert min(math.dist(a, b) for a, b in itertools.combinations(asked, 2)) > 0.1


def test_an_object_that_cannot_be_placed_from_one_side_is_placed_from_another() -> None:
    """Something blocks the arm around the robot's first stand."""
    barred: list[tuple[float, float]] = []

    def bar(world: FakeWorld, action: Action) -> ActionResult | None:
        if not isinstance(action, Place):
            return None
        barred[:] = barred or [world.pose().xy]
        near = world.pose().distance_m(barred[0]) < OTHER_SIDE_M - 0.1
        return ActionResult(False, "something is in the arm's way") if near else None

    world = troubled(flat([coffee_table(), counter(), mug()]), bar)
    bring(world)
    assert sum(isinstance(a, Place) for a in world.log) == 2
    assert world.released is not None
