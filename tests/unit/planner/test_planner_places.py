"""Where an object is placed: the paper's rule and the flat free area."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helios_core.robot import ActionResult, Place
from helios_core.types import ObjectInstance
from helios_planner.instruction.parser import parse
from helios_planner.manipulation import (
    PAPER_RELEASE_HEIGHT_M,
    PLACE_INSET_M,
    RELEASE_HEIGHT_M,
    Manipulation,
    SkillOutcome,
)
from helios_planner.motion_planning.base_placement import (
    OTHER_SIDE_M,
    AheadRules,
    PlaceRules,
    Spot,
    eye_of,
    highest_ahead,
    in_sight,
    place_spots,
    stand_for,
    surface_height_m,
    tilt_towards,
    top_at_m,
)
from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.motion_planning.path_planner import MotionRules, reach
from helios_planner.settings import PlaceRule, Settings
from helios_planner.tasks.mission import Mission
from hypothesis import given
from hypothesis import strategies as st
from planner_eye import CELL_M, ROBOT
from planner_flat import coffee_table, counter, flat, mug
from planner_things import Box, Thing
from planner_world import FakeWorld

TABLE_TOP_M = 0.7


def table_with_a_box() -> tuple[GroundMap, ObjectInstance]:
    """Make a table from (2, 1) to (3, 2), with a box of 0.2 m on its middle and a wall behind."""
    occupancy, top = np.zeros((120, 160), np.int8), np.zeros((120, 160), np.float32)
    for x0, y0, x1, y1, height in ((2, 1, 3, 2, 0.7), (2.4, 1.4, 2.6, 1.6, 0.9), (3, 0, 3.1, 3, 2)):
        at = np.s_[round(y0 / CELL_M) : round(y1 / CELL_M), round(x0 / CELL_M) : round(x1 / CELL_M)]
        occupancy[at], top[at] = 100, height
    table = ObjectInstance(
        1, "table", np.array([2.5, 1.5, 0.35]), np.array([1.0, 1.0, 0.7]), 1.0, 1.0, 0.0, 9, 9,
        {"table": 1.0}, TABLE_TOP_M, np.array([[2, 1], [3.05, 1], [3.05, 2], [2, 2]], float), 1.0,
    )  # fmt: skip
    return GroundMap(occupancy, top, CELL_M, (0.0, 0.0)), table


def test_the_papers_rule_takes_the_highest_point_ahead_but_not_the_wall() -> None:
    ground, table = table_with_a_box()
    point = highest_ahead(table, ground, Pose2(1.6, 1.5, 0.0), AheadRules(1.5))
    assert point is not None
    assert point[2] == pytest.approx(0.9)
    assert 2.4 <= point[0] <= 2.6


def test_the_papers_rule_sees_only_what_is_ahead_and_in_reach() -> None:
    ground, table = table_with_a_box()
    beside = highest_ahead(table, ground, Pose2(1.6, 1.1, 0.0), AheadRules(1.5))
    assert beside is not None
    assert beside[2] == pytest.approx(TABLE_TOP_M)
    assert highest_ahead(table, ground, Pose2(1.6, 1.5, np.pi), AheadRules(1.5)) is None
    assert highest_ahead(table, ground, Pose2(1.0, 1.5, 0.0), AheadRules(0.8)) is None


def test_the_flat_area_is_free_and_away_from_the_edge() -> None:
    ground, table = table_with_a_box()
    reached = reach(ground, Pose2(1.0, 1.5, 0.0), MotionRules(footprint_m=0.3))
    spots = place_spots(table, reached, 0.8, PlaceRules(inset_m=0.12, flat_m=0.012))
    assert spots
    for spot in spots:
        x, y, z = spot.point_m
        assert z == pytest.approx(TABLE_TOP_M)
        assert 2.1 <= x <= 2.95
        assert 1.1 <= y <= 1.9
        assert max(abs(x - 2.5), abs(y - 1.5)) > 0.1
        assert spot.stand.distance_m((x, y)) <= 0.8


def test_a_surface_comes_before_the_top_of_what_lies_on_it() -> None:
    ground, table = table_with_a_box()
    at = np.s_[round(1.3 / CELL_M) : round(1.7 / CELL_M), round(2.2 / CELL_M) : round(2.8 / CELL_M)]
    ground.top_m[at] = 0.78  # a cushion on the middle
    reached = reach(ground, Pose2(1.0, 1.5, 0.0), MotionRules(footprint_m=0.3))
    rules = PlaceRules(inset_m=0.06, flat_m=0.012)
    anywhere = {round(s.point_m[2], 2) for s in place_spots(table, reached, 0.8, rules)}
    on_it = place_spots(table, reached, 0.8, replace(rules, on_things=False))
    assert anywhere == {TABLE_TOP_M, 0.78}
    assert {round(s.point_m[2], 2) for s in on_it} == {TABLE_TOP_M}


@given(st.lists(st.floats(0.1, 1.5), min_size=1, max_size=40), st.floats(0.3, 1.2))
def test_the_height_of_a_surface_is_that_of_most_cells(others: list[float], top_m: float) -> None:
    heights = np.array([*others, *[top_m] * (3 * len(others) + 1)])
    assert surface_height_m(heights) == pytest.approx(top_m, abs=0.031)


def test_an_obstacle_beside_a_place_does_not_raise_the_place() -> None:
    """A low seat before a high tank: the place has the height of the seat, not of the tank."""
    ground, table = table_with_a_box()
    at = np.s_[round(1 / CELL_M) : round(2 / CELL_M), round(2 / CELL_M) : round(3 / CELL_M)]
    ground.top_m[at] = 0.8
    ground.top_m[at[0], round(2 / CELL_M) : round(2.25 / CELL_M)] = 0.45
    seat = replace(table, outline_m=np.array([[2, 1], [2.3, 1], [2.3, 2], [2, 2]], float))
    reached = reach(ground, Pose2(1.0, 1.5, 0.0), MotionRules(footprint_m=0.3))
    spots = place_spots(seat, reached, 0.8, PlaceRules(inset_m=0.06, flat_m=0.012))
    assert spots
    assert {round(spot.point_m[2], 3) for spot in spots} == {0.45}


def test_a_partly_seen_receptacle_has_a_subset_of_the_same_places() -> None:
    ground, table = table_with_a_box()
    part = replace(table, outline_m=np.array([[2, 1.07], [2.6, 1.07], [2.6, 2], [2, 2]], float))
    reached = reach(ground, Pose2(1.0, 1.5, 0.0), MotionRules(footprint_m=0.3))
    rules = PlaceRules(inset_m=0.12, flat_m=0.012)
    whole, some = (
        {tuple(np.round(s.point_m, 4)) for s in place_spots(of, reached, 0.8, rules)}
        for of in (table, part)
    )
    assert some
    assert some <= whole


def test_a_failed_place_is_tried_from_another_stand() -> None:
    ground, table = table_with_a_box()
    reached = reach(ground, Pose2(1.0, 1.5, 0.0), MotionRules(footprint_m=0.3))
    rules = PlaceRules(inset_m=0.12, flat_m=0.012)
    first = place_spots(table, reached, 0.8, rules)[0].stand
    others = place_spots(table, reached, 0.8, rules, not_from=[first.xy])
    assert others
    assert all(spot.stand.distance_m(first.xy) > OTHER_SIDE_M for spot in others)


def test_the_height_beyond_the_map_is_zero() -> None:
    ground, _ = table_with_a_box()
    assert top_at_m(ground, (2.5, 1.5), 0.05) == pytest.approx(0.9)
    for outside in ((-1.0, 1.5), (2.5, -1.0), (9.0, 1.5), (2.5, 9.0)):
        assert top_at_m(ground, outside, 0.05) == 0.0


def test_sight_begins_at_the_camera_and_not_at_the_base() -> None:
    """A post just ahead of the base hides nothing from a hand camera that is further ahead."""
    ground, _ = table_with_a_box()
    ground.top_m[round(1.5 / CELL_M), round(1.3 / CELL_M)] = 1.4
    stand, target = Pose2(1.0, 1.5, 0.0), (2.2, 1.5, 0.7)
    by_hand = replace(ROBOT, camera_forward_m=0.5)
    seen = [
        in_sight(ground, eye_of(stand, robot), 1.3, target, 0.15, 2.0) for robot in (ROBOT, by_hand)
    ]
    assert seen == [False, True]


def test_an_object_at_the_back_of_a_lower_shelf_is_picked() -> None:
    """The height map knows only the bookcase's top, which hides the objects on its boards."""
    low = mug(x=2.5, y=6.62, z=0.4)
    world = flat([low], Pose2(2.5, 4.9, 1.57), [Box(2.0, 6.25, 3.0, 6.95, 1.2)])
    mission = Mission(world, parse("find the mug"), Settings())
    mission.tools.base.look_around()
    (thing,) = world.objects("mug")
    reached = mission.tools.base.reach()
    assert stand_for(thing.center_m, reached, ROBOT, 0.74) is None
    assert mission.skills.pick(thing, "mug") is SkillOutcome.SUCCEEDED
    assert low.views == []  # the object map has retired the mug
    assert world.contacts == 0


def test_a_drifting_robot_faces_the_object_that_it_picks_and_looks_at_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Every move ends 6 cm to the left, so the planned heading is wrong at the stand."""
    world = flat([mug(x=2.5, y=6.62, z=0.4)], Pose2(3.3, 5.5, -1.0), [Box(2.0, 6.25, 3.0, 6.95, 1)])
    drive, seen = world._drive, []

    def drift(distance_m: float) -> ActionResult:
        result, pose = drive(distance_m), world.pose()
        aside = Pose2(pose.x_m, pose.y_m, pose.yaw_rad + np.pi / 2).ahead(0.06)
        if world._clear(*aside.xy):
            world._pose = Pose2(*aside.xy, pose.yaw_rad)
        return result

    def pick(point_m: np.ndarray, class_name: str) -> ActionResult:
        away_m = world.pose().distance_m(point_m)
        aside_rad, aim_rad = (
            world.pose().bearing_rad(point_m),
            tilt_towards(away_m, point_m[2], ROBOT),
        )
        seen.append((aside_rad, world.tilt_rad() - aim_rad))
        return ActionResult(False, "this world only watches")

    monkeypatch.setattr(world, "_drive", drift)
    monkeypatch.setattr(world, "_pick", pick)
    mission = Mission(world, parse("find the mug"), Settings())
    mission.tools.base.look_around()
    (thing,) = world.objects("mug")
    assert mission.skills.pick(thing, "mug") is SkillOutcome.FAILED
    assert len(seen) == mission.skills.attempts
    for aside_rad, off_rad in seen:
        assert abs(aside_rad) < np.radians(5)  # the smallest turn
        assert abs(off_rad) < np.radians(2)


@pytest.mark.parametrize("rule", ["flat", "paper"])
def test_each_rule_brings_the_mug_onto_the_counter_from_its_own_height(rule: PlaceRule) -> None:
    world = flat([coffee_table(), counter(), mug()])
    settings = Settings(place_rule=rule)
    Mission(world, parse("Move the mug from the coffee table to the counter"), settings).run()
    assert world.released is not None
    placed = next(a for a in world.log if isinstance(a, Place))
    drop_m = RELEASE_HEIGHT_M if rule == "flat" else PAPER_RELEASE_HEIGHT_M
    assert placed.point_world_m[2] == pytest.approx(0.9 + drop_m, abs=0.02)


def placing(world: FakeWorld) -> tuple[Mission, ObjectInstance]:
    """Make a mission that holds the mug and knows the counter; return it and the counter."""
    mission = Mission(world, parse("Move the mug from the coffee table to the counter"), Settings())
    world._held = world.things[3]
    mission.tools.base.look_around()
    (goal,) = world.objects("counter")
    return mission, goal


def put_points(world: FakeWorld) -> list[tuple[float, float, float]]:
    return [a.point_world_m for a in world.log if isinstance(a, Place)]


def test_the_robot_faces_a_place_that_was_chosen_again_from_near(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = flat([counter(), mug()], Pose2(2.2, 5.0, 1.57))
    mission, goal = placing(world)
    aside: list[float] = []
    place = world._place

    def watched(point_m: np.ndarray) -> ActionResult:
        aside.append(world.pose().bearing_rad(point_m))
        return place(point_m)

    def half_a_metre_aside(
        _: Manipulation, receptacle: ObjectInstance, spot: Spot, failed: object
    ) -> tuple[float, float, float]:
        x, y, z = spot.point_m
        return x + (0.5 if x < 2.2 else -0.5), y, z

    monkeypatch.setattr(world, "_place", watched)
    monkeypatch.setattr(Manipulation, "_point_from_here", half_a_metre_aside)
    mission.skills.place(goal, "counter")
    assert aside
    assert max(np.abs(aside)) < np.radians(5)  # the smallest turn


def test_the_last_attempt_uses_the_place_that_was_chosen_from_afar(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = flat([counter(), mug()], Pose2(2.2, 5.0, 1.57))
    mission, goal = placing(world)
    monkeypatch.setattr(Manipulation, "_point_from_here", lambda *_: None)
    assert mission.skills.place(goal, "counter") is SkillOutcome.SUCCEEDED
    (point,) = put_points(world)
    assert point[2] == pytest.approx(0.9 + RELEASE_HEIGHT_M, abs=0.02)


def test_half_the_distance_from_the_edge_is_enough_on_a_narrow_board() -> None:
    board = Thing(2, "counter", np.array([2.2, 5.6, 0.85]), np.array([2.0, 0.2, 0.1]))
    board.graspable = False
    world = flat([board, mug()], Pose2(2.2, 4.2, 1.57), [Box(1.2, 5.5, 3.2, 5.7, 0.9)])
    mission, goal = placing(world)
    assert mission.skills.place(goal, "counter") is SkillOutcome.SUCCEEDED
    (point,) = put_points(world)
    assert abs(point[1] - 5.6) <= 0.1 - PLACE_INSET_M / 2
