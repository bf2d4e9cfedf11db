"""What goes wrong while moving, picking and placing: it is recovered from, or named at a limit."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.robot import Action, ActionResult, Forward, Pick, Place, Turn
from helios_planner import calls
from helios_planner.calls import patiently
from helios_planner.flow import Mission
from helios_planner.grid import Pose2
from helios_planner.instruction import parse
from helios_planner.legs import Legs, Outcome
from helios_planner.mishaps import MOST_BLOCKS, MOST_JUMPS, MOST_WEDGED
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed
from planner_eye import ROBOT
from planner_flat import coffee_table, counter, flat, mug
from planner_things import Box
from planner_world import FakeWorld

MOVE = "Move the mug from the coffee table to the counter"
Trouble = Callable[[FakeWorld, Action], ActionResult | None]


def troubled(world: FakeWorld, trouble: Trouble) -> FakeWorld:
    """A world in which `trouble` may do an action in its own way, or something beside it."""
    honest = world._do
    world._do = lambda action: trouble(world, action) or honest(action)
    return world


def bring(world: FakeWorld, **settings: Any) -> None:
    Mission(world, parse(MOVE), Settings(**settings)).run()


def legs_in(world: FakeWorld) -> Legs:
    legs = Legs(world, Settings())
    legs.look_around()
    return legs


# --- path newly blocked, goal unreachable ----------------------------------------------------
def once(what: Callable[[], None], when: Callable[[], bool]) -> Trouble:
    done: list[bool] = []

    def trouble(_: FakeWorld, action: Action) -> None:
        if not done and when():
            done.append(True)
            what()

    return trouble


def test_a_way_that_is_newly_blocked_is_left_for_another() -> None:
    world = flat(start=Pose2(0.6, 3.0, 0.0))
    legs = legs_in(world)
    box = Box(3.2, 2.5, 3.5, 3.5, 0.8)
    troubled(world, once(lambda: world.add_box(box), lambda: world.pose().x_m > 1.0))
    assert legs.go_to(Pose2(3.95, 3.0, 0.0), "test") is Outcome.ARRIVED
    assert box in world.boxes
    assert world.contacts == 0


def test_a_way_that_is_narrower_than_wished_is_taken_all_the_same() -> None:
    """A door of 0.68 m: 0.04 m to each side, where 0.08 m are wished for."""
    posts = [Box(4.3, 2.3, 4.6, 2.66, 2.5), Box(4.3, 3.34, 4.6, 3.7, 2.5)]
    world = flat(start=Pose2(1.5, 3.0, 0.0), extra=posts)
    assert legs_in(world).go_to(Pose2(6.0, 3.0, 0.0), "test") is Outcome.ARRIVED
    assert world.contacts == 0


def test_a_robot_that_never_comes_nearer_gives_the_goal_up() -> None:
    """A slippery floor, on which it ends each move where it began it."""
    world = flat(start=Pose2(1.5, 3.0, 0.0))
    legs = legs_in(world)

    def slips(_: FakeWorld, action: Action) -> ActionResult | None:
        return ActionResult(True, moved_m=0.2) if isinstance(action, Forward) else None

    troubled(world, slips).look = lambda: None  # it sees nothing new either
    before = world.steps
    assert legs.go_to(Pose2(3.5, 3.0, 0.0), "test") is Outcome.UNREACHABLE
    assert world.steps - before <= 80 + 10 * 2


def test_a_goal_that_nothing_leads_to_is_called_unreachable_soon() -> None:
    world = flat(start=Pose2(1.5, 3.0, 0.0))
    legs = legs_in(world)
    shut = Box(4.3, 2.4, 4.6, 3.6, 2.5)
    troubled(world, once(lambda: world.add_box(shut), lambda: world.pose().x_m > 2.0))
    before = world.steps
    assert legs.go_to(Pose2(6.0, 3.0, 0.0), "test") is Outcome.UNREACHABLE
    assert world.steps - before < 80
    assert world.contacts == 0


def test_a_mug_that_is_seen_and_out_of_reach_ends_the_task_with_a_cause() -> None:
    fence = [Box(5.6, 4.5, 8.4, 4.7, 0.6), Box(5.6, 4.5, 5.8, 6.9, 0.6),
             Box(8.2, 4.5, 8.4, 6.9, 0.6)]  # fmt: skip
    world = flat([coffee_table(), counter(), mug()], extra=fence)
    with pytest.raises(TaskFailed) as failure:
        bring(world, rounds=1)
    assert failure.value.cause is Cause.OBJECT_NOT_FOUND
    assert world.picks == 0
    assert world.contacts == 0


# --- no motion, wedged -----------------------------------------------------------------------
@pytest.mark.parametrize("kind", [Forward, Turn])
def test_a_robot_that_does_not_move_when_told_to_is_stuck(kind: type[Action]) -> None:
    world = troubled(
        flat([coffee_table(), counter(), mug()]),
        lambda _, action: ActionResult(False, "no") if isinstance(action, kind) else None,
    )
    with pytest.raises(TaskFailed) as failure:
        bring(world)
    assert failure.value.cause is Cause.STUCK
    assert re.search(f"{MOST_BLOCKS + 1} times|wedged", failure.value.message)
    assert sum(isinstance(a, kind) for a in world.log) <= MOST_BLOCKS + 1


def test_a_wedged_robot_looks_around_and_then_says_so() -> None:
    cell = [Box(1.0, 1.0, 2.0, 1.15, 1), Box(1.0, 1.85, 2.0, 2.0, 1),
            Box(1.0, 1.0, 1.15, 2.0, 1), Box(1.85, 1.0, 2.0, 2.0, 1)]  # fmt: skip
    world = flat(start=Pose2(1.5, 1.5, 0.0), extra=cell)
    legs = legs_in(world)
    before = len(world.log)
    with pytest.raises(TaskFailed, match=r"wedged at \(1.50, 1.50\)") as failure:
        legs.go_to(Pose2(3.0, 3.0, 0.0), "test")
    assert failure.value.cause is Cause.STUCK
    assert legs.mishaps.wedged == MOST_WEDGED + 1
    turned = sum(abs(a.angle_rad) for a in world.log[before:] if isinstance(a, Turn))
    assert turned >= MOST_WEDGED * 2 * math.pi - 0.01


def test_what_was_felt_and_is_no_longer_there_does_not_wedge_the_robot_for_good() -> None:
    legs = legs_in(flat(start=Pose2(2.0, 2.0, 0.0)))
    ring = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    for a in ring:
        legs.felt.append((2.0 + 0.42 * math.cos(a), 2.0 + 0.42 * math.sin(a), 0.08))
    assert legs.go_to(Pose2(3.0, 3.0, 0.0), "test") is Outcome.ARRIVED
    assert legs.mishaps.wedged == 1


def lane(max_back_m: float) -> Legs:
    """A robot that stands in a lane in which it just fits, 0.4 m from where it came in."""
    walls = [Box(1.6, 2.0, 3.2, 2.7, 1.0), Box(1.6, 3.325, 3.2, 4.0, 1.0)]
    world = flat(start=Pose2(2.0, 3.0125, 0.0), extra=walls)
    world.description = replace(ROBOT, max_back_m=max_back_m)
    return legs_in(world)


def test_a_wedged_robot_that_can_moves_back_out_of_where_it_came_in() -> None:
    legs = lane(0.3)
    assert legs.go_to(Pose2(0.8, 3.0, 3.1), "test") is Outcome.ARRIVED
    assert isinstance(legs.body, FakeWorld)
    back = [a.distance_m for a in legs.body.log if isinstance(a, Forward) and a.distance_m < 0]
    assert 1 <= len(back) <= MOST_WEDGED
    assert min(back) >= -0.3
    assert legs.body.contacts == 0


def test_a_robot_that_cannot_move_back_is_never_told_to() -> None:
    legs = lane(0.0)
    with pytest.raises(TaskFailed, match="wedged"):
        legs.go_to(Pose2(0.8, 3.0, 3.1), "test")
    assert isinstance(legs.body, FakeWorld)
    assert not any(isinstance(a, Forward) for a in legs.body.log)


@pytest.mark.parametrize(("behind_m", "free_m"), [(0.9, 0.3), (0.52, 0.2), (0.36, 0.0)])
def test_a_move_back_ends_before_what_is_behind(behind_m: float, free_m: float) -> None:
    """A box whose near edge is so far behind the robot's middle; its rim is 0.3 m away."""
    box = Box(3.0 - behind_m - 0.5, 2.5, 3.0 - behind_m, 3.5, 1.0)
    legs = legs_in(flat(start=Pose2(3.0, 3.0, 0.0), extra=[box]))
    assert legs.reach(legs.levels[-1]).free_back_m(0.3, legs.rules) == pytest.approx(
        free_m, abs=0.03
    )


# --- pick missed, object fallen, place missed ------------------------------------------------
def test_a_gripper_that_says_it_holds_and_does_not_is_a_pick_missed() -> None:
    world = troubled(
        flat([coffee_table(), counter(), mug()]),
        lambda _, action: ActionResult(True) if isinstance(action, Pick) else None,
    )
    with pytest.raises(TaskFailed, match="holds nothing") as failure:
        bring(world, rounds=1)
    assert failure.value.cause is Cause.PICK_FAILED
    assert world.picks == Settings().picks_per_object
    assert world.retired == []  # what was not grasped stays in the map


def falling(times: int, after: int = 4) -> Trouble:
    """What is carried falls to the floor beside the robot, so many actions after each pick."""
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


def test_what_fell_on_the_way_is_picked_up_again() -> None:
    world = troubled(flat([coffee_table(), counter(), mug()]), falling(1))
    bring(world)
    hands = [type(a) for a in world.log if isinstance(a, Pick | Place)]
    assert hands == [Pick, Pick, Place]  # noticed at once, not at the counter
    assert world.released is world.things[3]
    assert world.retired == [3, 3]  # once for each time that it was grasped


def test_a_gripper_that_is_mistaken_for_a_moment_drops_nothing() -> None:
    world = flat([coffee_table(), counter(), mug()])
    honest, asked = world.held, [0]

    def mistaken() -> str:
        asked[0] += bool(honest())
        return "" if asked[0] == 6 else honest()

    world.held = mistaken
    bring(world)
    assert asked[0] > 6
    assert world.picks == 1


def test_what_falls_again_and_again_is_given_up() -> None:
    world = troubled(flat([coffee_table(), counter(), mug()]), falling(99))
    with pytest.raises(TaskFailed, match="fell 3 times") as failure:
        bring(world)
    assert failure.value.cause is Cause.PLACE_MISSED


def test_a_place_that_let_it_fall_is_made_good() -> None:
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


def test_a_place_that_is_refused_is_tried_elsewhere_and_then_given_up() -> None:
    def refusing(world: FakeWorld, action: Action) -> ActionResult | None:
        return ActionResult(False, "no room") if isinstance(action, Place) else None

    world = troubled(flat([coffee_table(), counter(), mug()]), refusing)
    with pytest.raises(TaskFailed, match="no room") as failure:
        bring(world, rounds=1)
    assert failure.value.cause is Cause.PLACE_MISSED
    asked = [a.point_world_m[:2] for a in world.log if isinstance(a, Place)]
    assert 2 <= len(asked) <= Settings().places_per_receptacle
    assert min(math.dist(a, b) for a in asked for b in asked if a is not b) > 0.1


# --- localisation jump -----------------------------------------------------------------------
def jumping(times: int) -> Trouble:
    left = [times]

    def trouble(world: FakeWorld, action: Action) -> None:
        if isinstance(action, Forward) and left[0]:
            left[0] -= 1
            pose = world.pose()
            world._pose = Pose2(pose.x_m, 4.5 - pose.y_m, pose.yaw_rad)

    return trouble


def test_after_a_jump_of_the_localisation_it_looks_around_and_goes_on() -> None:
    world = flat(start=Pose2(1.0, 1.2, 0.0))
    legs = legs_in(world)
    troubled(world, jumping(1))
    legs.felt.append((6.0, 1.0, 0.08))
    before = len(world.log)
    assert legs.go_to(Pose2(3.5, 1.5, 0.0), "test") is Outcome.ARRIVED
    assert legs.mishaps.jumps == 1
    assert not legs.mishaps.jumped
    assert legs.felt == []  # who knows where that is now
    turned = sum(abs(a.angle_rad) for a in world.log[before:] if isinstance(a, Turn))
    assert turned >= 2 * math.pi - 0.01


def test_a_jump_of_the_heading_alone_is_one_too() -> None:
    world = flat(start=Pose2(1.0, 1.2, 0.0))

    def turned(world: FakeWorld, action: Action) -> None:
        if isinstance(action, Forward):
            pose = world.pose()
            world._pose = Pose2(pose.x_m, pose.y_m, pose.yaw_rad + 1.0)

    mishaps = Legs(troubled(world, turned), Settings()).mishaps
    mishaps.act(Forward(0.2))
    assert mishaps.jumped


def test_a_localisation_that_keeps_jumping_is_named() -> None:
    world = flat(start=Pose2(1.0, 1.2, 0.0))
    legs = legs_in(world)
    troubled(world, jumping(99))
    with pytest.raises(TaskFailed, match="localisation jumped") as failure:
        legs.go_to(Pose2(3.5, 1.5, 0.0), "test")
    assert failure.value.cause is Cause.SYSTEM_ERROR
    assert legs.mishaps.jumps == MOST_JUMPS + 1


# --- a service away --------------------------------------------------------------------------
class Clock:
    """Time that passes only by resting."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 100.0
        monkeypatch.setattr(calls.time, "monotonic", lambda: self.now_s)

    def rest(self, seconds: float) -> None:
        self.now_s += seconds


def test_a_service_may_be_away_for_ten_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)

    def ask() -> pb.Empty:
        if clock.now_s < 110.0:
            raise Unavailable("objectmap does not answer")
        return pb.Empty()

    assert patiently(ask, Settings().away_s, clock.rest) == pb.Empty()
    assert clock.now_s >= 110.0


def test_a_service_that_stays_away_is_a_system_error(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)

    def ask() -> pb.Empty:
        raise Unavailable("objectmap does not answer")

    with pytest.raises(TaskFailed, match="objectmap does not answer") as failure:
        patiently(ask, Settings().away_s, clock.rest)
    assert failure.value.cause is Cause.SYSTEM_ERROR
    assert clock.now_s - 100.0 < Settings().away_s + 1.0
