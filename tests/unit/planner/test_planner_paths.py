"""FM² paths, collision checks and motions: claims about any map."""

from __future__ import annotations

import heapq
import itertools
import math

import cv2
import numpy as np
import pytest
import skfmm
from helios_core.errors import InvalidInput
from helios_core.robot import Forward, Turn
from helios_planner import fm2
from helios_planner.collision import least_clearance_m
from helios_planner.grid import GroundMap, Pose2
from helios_planner.motion import (
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

CELL_M = 0.05
RULES = MotionRules(footprint_m=0.3, margin_m=0.05)


def heap_marching(speed: NDArray[np.float32], source: tuple[int, int]) -> NDArray[np.float64]:
    """The readable twin of `kernels.march`: an exact heap, one cell at a time."""
    rows, columns = speed.shape
    time = np.full(speed.shape, math.inf)
    done = np.zeros(speed.shape, bool)
    time[source] = 0.0
    heap = [(0.0, source)]
    while heap:
        _, (r, c) = heapq.heappop(heap)
        if done[r, c]:
            continue
        done[r, c] = True
        for q in ((r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)):
            if not (0 < q[0] < rows - 1 and 0 < q[1] < columns - 1) or speed[q] <= 0 or done[q]:
                continue
            a = min(time[q[0] - 1, q[1]], time[q[0] + 1, q[1]])
            b = min(time[q[0], q[1] - 1], time[q[0], q[1] + 1])
            slow = 1.0 / float(speed[q])
            a, b = min(a, b), max(a, b)
            if b - a >= slow:
                new = a + slow
            else:
                new = (a + b + math.sqrt(2 * slow * slow - (b - a) ** 2)) / 2
            if new < time[q]:
                time[q] = new
                heapq.heappush(heap, (new, q))
    return time


def random_ground(seed: int, size: int = 120) -> GroundMap:
    """A walled square with boxes in it; nothing unknown."""
    rng = np.random.default_rng(seed)
    occupancy = np.zeros((size, size), np.int8)
    occupancy[:2], occupancy[-2:], occupancy[:, :2], occupancy[:, -2:] = 100, 100, 100, 100
    for _ in range(int(rng.integers(3, 14))):
        r, c = rng.integers(2, size - 12, 2)
        h, w = rng.integers(1, 30, 2)
        occupancy[r : r + h, c : c + w] = 100
    return GroundMap(occupancy, np.zeros((size, size), np.float32), CELL_M, (0.0, 0.0))


def free_places(ground: GroundMap, count: int, seed: int) -> list[tuple[float, float]]:
    """Places where the robot fits."""
    distance = cv2.distanceTransform((ground.occupancy == 0).astype(np.uint8), cv2.DIST_L2, 5)
    cells = np.argwhere(distance * CELL_M > 0.42)
    if not len(cells):
        return []
    rng = np.random.default_rng(seed)
    return [(float(x), float(y)) for x, y in ground.centres_of(rng.permutation(cells)[:count])]


def test_marching_matches_the_exact_heap() -> None:
    rng = np.random.default_rng(0)
    for seed in range(4):
        ground = random_ground(seed, 60)
        speed = rng.uniform(0.1, 1.0, ground.occupancy.shape).astype(np.float32)
        speed = np.asarray(cv2.GaussianBlur(speed, (9, 9), 0), np.float32)
        speed[ground.occupancy > 0] = 0
        source = (int(np.argwhere(speed > 0)[17, 0]), int(np.argwhere(speed > 0)[17, 1]))
        fast = fm2.arrival_time(speed, np.array([source]))
        exact = heap_marching(speed, source)
        assert (np.isfinite(fast) == np.isfinite(exact)).all()
        known = np.isfinite(exact) & (exact > 5)
        # Both solve the same equations; only rounding to float32 lies between them.
        assert np.max(np.abs(fast[known] - exact[known]) / exact[known]) < 1e-4


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_nothing_reachable_is_called_unreachable(seed: int) -> None:
    ground = random_ground(seed)
    speed = np.where(ground.occupancy > 0, 0, 1).astype(np.float32)
    source = np.argwhere(speed > 0)[:1]
    arrival = fm2.arrival_time(speed, source)
    _, labels = cv2.connectedComponents((speed > 0).astype(np.uint8), connectivity=4)
    same = labels == labels[tuple(source[0])]
    assert (np.isfinite(arrival) == same).all()


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
    """The readable twin of `kernels.pull_straight`."""

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
def test_pulling_straight_matches_its_twin(seed: int) -> None:
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
def test_motions_bring_the_robot_there_without_contact(seed: int) -> None:
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


def test_unknown_ground_in_the_own_footprint_does_not_hold_the_robot() -> None:
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


def test_a_descent_never_cuts_a_corner() -> None:
    speed = np.zeros((12, 12), np.float32)
    speed[1:-1, 1:-1] = 1
    speed[5, 1:9] = 0
    arrival = fm2.arrival_time(speed, np.array([[1, 1]]))
    path = fm2.descend(arrival, (9, 1)).astype(float) + 0.5
    assert least_crossed(speed, path) > 0
    assert np.isinf(arrival[5, 4])


def least_crossed(field: NDArray[np.float32], path: NDArray[np.float64]) -> float:
    """Least value of the cells that a path [n, 2] (rows, columns, not rounded) goes through."""
    dense = np.concatenate([a + (b - a) * np.linspace(0, 1, 200)[:, None]
                            for a, b in itertools.pairwise(path)])  # fmt: skip
    cells = np.floor(dense).astype(int)
    return float(field[cells[:, 0], cells[:, 1]].min())


def test_a_front_is_kept_from_the_border() -> None:
    with pytest.raises(InvalidInput, match="border"):
        fm2.arrival_time(np.ones((8, 8), np.float32), np.array([[4, 4]]))
    with pytest.raises(InvalidInput, match="source"):
        fm2.arrival_time(np.zeros((8, 8), np.float32), np.array([[0, 4]]))


def time_along(speed: NDArray[np.float32], path: NDArray[np.float64]) -> float:
    """Time that a path [n, 2] (rows, columns, not rounded) takes through cells of that speed."""
    total = 0.0
    for a, b in itertools.pairwise(path):
        length = float(np.hypot(*(b - a)))
        n = max(2, int(length * 20))
        cells = np.floor(a + (b - a) * ((np.arange(n) + 0.5) / n)[:, None]).astype(int)
        total += float((1 / speed[cells[:, 0], cells[:, 1]]).mean()) * length
    return total


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_a_path_takes_at_most_five_percent_longer_than_the_optimum_of_the_same_field(
    seed: int,
) -> None:
    """The optimum: second-order marching by another implementation, on a grid five times as fine.
    On top of 5 %, a cell's crossing: both ends of a path are cells."""
    ground = random_ground(seed, 80)
    places = free_places(ground, 2, seed)
    if len(places) < 2:
        return
    source, start = ((int(r), int(c)) for r, c in ground.cells_of(np.array(places)))
    distance = cv2.distanceTransform((ground.occupancy == 0).astype(np.uint8), cv2.DIST_L2, 5)
    speed = fm2.speed_field((distance * CELL_M).astype(np.float32), 0.35, 0.3, 0.3)
    arrival = fm2.arrival_time(speed, np.array([source]))
    path = fm2.descend(arrival, start).astype(float) + 0.5
    if len(path) == 0:
        return
    fine, k = np.kron(speed, np.ones((5, 5), np.float32)), 5
    outside = np.ones(fine.shape)
    outside[source[0] * k + 2, source[1] * k + 2] = -1
    exact = skfmm.travel_time(
        np.ma.MaskedArray(outside, fine == 0), np.maximum(fine, 0.05), dx=1 / k
    )
    optimum = float(exact[start[0] * k + 2, start[1] * k + 2])
    assert least_crossed(speed, path) > 0
    assert time_along(speed, path) <= 1.05 * optimum + 1 / float(speed[source])


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
