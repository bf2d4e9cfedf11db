"""Routes over known ground and the motions along them, as properties of any map."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from helios_core.robot import Forward, Turn
from helios_planner.motion_planning.costmap import GroundMap, Pose2, least_clearance_m
from helios_planner.motion_planning.path_planner import (
    WIDE_ENOUGH_M,
    MotionRules,
    Reach,
    next_primitive,
    reach,
    straightened,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from planner_ground import CELL_M, free_places, random_ground

RULES = MotionRules(footprint_m=0.3, margin_m=0.05)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_arrival_time_falls_along_a_path_that_touches_nothing(seed: int) -> None:
    ground = random_ground(seed)
    places = free_places(ground, 2, seed)
    if len(places) < 2:
        return
    reached = reach(ground, Pose2(*places[0], 0.0), RULES)
    route = reached.route_to(places[1])
    if not np.isfinite(reached.at(np.array([places[1]]))[0]):
        assert len(route) == 0
        return
    cells = reached.ground.cells_of(route)
    falling = reached.arrival[cells[::-1, 0], cells[::-1, 1]]
    assert (np.diff(falling) < 0).all()
    clear = reached.clearance[cells[:, 0], cells[:, 1]]
    assert clear.min() >= RULES.footprint_m
    for a, b in itertools.pairwise(straightened(route, reached)):
        start = Pose2(float(a[0]), float(a[1]), 0.0)
        least = least_clearance_m(reached.clearance, reached.ground, start, (b[0], b[1]))
        assert least >= RULES.footprint_m


def pulled_straight(route: NDArray[np.float64], reached: Reach) -> NDArray[np.float64]:
    """Readable reference of `kernels.pull_straight`."""

    def may_pull(here: int, there: int) -> bool:
        cells = reached.ground.cells_of(route[here : there + 1])
        along = float(reached.slack[cells[:, 0], cells[:, 1]].min())
        start = Pose2(float(route[here, 0]), float(route[here, 1]), 0.0)
        end = (float(route[there, 0]), float(route[there, 1]))
        straight = least_clearance_m(reached.slack, reached.ground, start, end)
        return bool(straight >= min(np.float32(WIDE_ENOUGH_M), max(along, 0.0)))

    kept = [0]
    while kept[-1] < len(route) - 1:
        here, there = kept[-1], len(route) - 1
        while there > here + 1 and not may_pull(here, there):
            there = here + 1 + (there - here - 1) * 2 // 3
        kept.append(there)
    return route[kept]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_pulling_straight_matches_its_reference(seed: int) -> None:
    ground = random_ground(seed)
    places = free_places(ground, 2, seed)
    if len(places) < 2:
        return
    reached = reach(ground, Pose2(*places[0], 0.0), RULES)
    route = reached.route_to(places[1])
    if len(route) >= 3:
        np.testing.assert_array_equal(straightened(route, reached), pulled_straight(route, reached))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_motions_bring_the_robot_to_its_goal_without_contact(seed: int) -> None:
    ground = random_ground(seed)
    places = free_places(ground, 2, seed)
    if len(places) < 2:
        return
    pose = Pose2(*places[0], 1.0)
    if not np.isfinite(reach(ground, pose, RULES).at(np.array([places[1]]))[0]):
        return
    for _ in range(150):
        reached = reach(ground, pose, RULES)
        corners = straightened(reached.route_to(places[1]), reached)
        move = next_primitive(corners, reached, RULES)
        if move is None:
            break
        if isinstance(move, Turn):
            assert RULES.min_turn_rad <= abs(move.angle_rad) + 1e-9
            assert abs(move.angle_rad) <= RULES.max_turn_rad + 1e-9
            pose = Pose2(pose.x_m, pose.y_m, pose.yaw_rad + move.angle_rad)
            continue
        assert isinstance(move, Forward)
        assert RULES.min_forward_m <= move.distance_m <= RULES.max_forward_m
        end = (
            pose.x_m + move.distance_m * math.cos(pose.yaw_rad),
            pose.y_m + move.distance_m * math.sin(pose.yaw_rad),
        )
        assert least_clearance_m(reached.clearance, reached.ground, pose, end) >= RULES.footprint_m
        pose = Pose2(*end, pose.yaw_rad)
    assert pose.distance_m(places[1]) < 0.15


def corridor(width_m: float) -> GroundMap:
    occupancy = np.full((80, 160), 100, np.int8)
    half = round(width_m / CELL_M / 2)
    occupancy[40 - half : 40 + half, 4:156] = 0
    return GroundMap(occupancy, np.zeros(occupancy.shape, np.float32), CELL_M, (0.0, 0.0))


@pytest.mark.parametrize(("width_m", "passes"), [(0.5, False), (0.9, True)])
def test_a_corridor_is_passed_only_if_the_footprint_fits(width_m: float, passes: bool) -> None:
    reached = reach(corridor(width_m), Pose2(1.0, 2.0, 0.0), RULES)
    assert bool(np.isfinite(reached.at(np.array([[7.0, 2.0]]))[0])) is passes


def test_unknown_ground_is_not_driven_over() -> None:
    ground = corridor(2.0)
    ground.occupancy[:, 80:90] = np.where(ground.occupancy[:, 80:90] == 0, -1, 100)
    reached = reach(ground, Pose2(1.0, 2.0, 0.0), RULES)
    assert not np.isfinite(reached.at(np.array([[7.0, 2.0]]))[0])
    assert reached.nearest((7.0, 2.0), 1.0) is None


def test_unknown_ground_under_the_robot_does_not_block_it() -> None:
    ground = corridor(2.0)
    cells = np.argwhere(ground.occupancy == 0)
    own = np.hypot(*(ground.centres_of(cells) - (1.0, 2.0)).T) < 0.32
    ground.occupancy[cells[own, 0], cells[own, 1]] = -1
    reached = reach(ground, Pose2(1.0, 2.0, 0.0), RULES)
    assert np.isfinite(reached.at(np.array([[7.0, 2.0]]))[0])


def test_the_robot_may_leave_a_narrow_place_but_not_enter_one() -> None:
    ground = corridor(2.0)
    ground.occupancy[20:36, 4:60] = 100  # a wall 0.31 m beside the robot
    start = Pose2(2.0, 36 * CELL_M + 0.325, 0.0)
    reached = reach(ground, start, RULES)
    assert np.isfinite(reached.at(np.array([[7.0, 2.2]]))[0])
    other = reach(ground, Pose2(7.0, 2.2, 0.0), RULES)
    assert not np.isfinite(other.at(np.array([start.xy]))[0])


def test_paths_keep_away_from_walls_where_there_is_room() -> None:
    reached = reach(corridor(2.0), Pose2(1.0, 1.5, 0.0), RULES)
    route = reached.route_to((7.0, 1.5))
    middle = route[np.abs(route[:, 0] - 4.0) < 0.1]
    assert middle[:, 1].mean() > 1.6  # the corridor's middle is at 2.0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_pulling_straight_never_lengthens_a_route(seed: int) -> None:
    ground = random_ground(seed)
    places = free_places(ground, 2, seed)
    if len(places) == 2:
        reached = reach(ground, Pose2(*places[0], 0.0), RULES)
        route = reached.route_to(places[1])
        pulled = straightened(route, reached)
        assert length_m(pulled) <= length_m(route) + 1e-9


def length_m(route: NDArray[np.float64]) -> float:
    return float(np.hypot(*np.diff(route, axis=0).T).sum()) if len(route) > 1 else 0.0
