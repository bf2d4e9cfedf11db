"""Tests shortest paths over free ground against hand-computed values and a plain search."""

from __future__ import annotations

import heapq
import math

import numpy as np
import pytest
from helios_sim.navigable_area import NavigableArea, clearance_m
from helios_sim.objectnav_metrics import spl
from hypothesis import given, settings
from hypothesis import strategies as st

OPEN = NavigableArea(np.ones((80, 80), bool), (-1.0, -2.0), 0.05)  # x from -1 to 3, y from -2 to 2


def walled() -> NavigableArea:
    """An area with a wall at x in [1, 1.1] that ends at y = 1."""
    free = OPEN.free.copy()
    free[:60, 40:42] = False
    return NavigableArea(free, OPEN.origin_m, OPEN.cell_m)


def test_an_area_contains_the_points_in_its_free_cells():
    points = np.array([[-1.0, -2.0], [2.999, 1.999], [-1.001, 0.0], [3.0, 0.0], [0.0, 2.0]])
    assert OPEN.contains(points).tolist() == [True, True, False, False, False]
    assert walled().contains(np.array([[1.05, 0.99], [1.05, 1.01]])).tolist() == [False, True]


@given(st.floats(-0.9, 2.9), st.floats(-1.9, 1.9), st.floats(-0.9, 2.9), st.floats(-1.9, 1.9))
def test_the_shortest_path_over_open_ground_is_the_straight_line(
    ax: float, ay: float, bx: float, by: float
):
    away_m = math.dist((ax, ay), (bx, by))
    assert OPEN.shortest_m((ax, ay), np.array([[bx, by]])) == pytest.approx(away_m, abs=1e-6)


def test_the_shortest_path_bends_around_the_end_of_a_wall():
    around = OPEN.shortest_m((0.5, 0.0), np.array([[1.6, 0.0]]))
    assert around == pytest.approx(1.1)
    exact = math.hypot(0.5, 1.0) + 0.1 + math.hypot(0.5, 1.0)
    assert walled().shortest_m((0.5, 0.0), np.array([[1.6, 0.0]])) == pytest.approx(exact, rel=0.03)


def test_the_nearest_goal_is_nearest_by_path_length():
    goals = np.array([[1.3, 0.0], [-0.5, 0.0]])  # behind the wall, and on this side
    assert walled().shortest_m((0.5, 0.0), goals) == pytest.approx(1.0)


def test_the_distance_to_an_unreachable_goal_is_infinite():
    free = OPEN.free.copy()
    free[:, 40] = False
    shut = NavigableArea(free, OPEN.origin_m, OPEN.cell_m)
    assert shut.shortest_m((0.5, 0.0), np.array([[1.6, 0.0]])) == math.inf
    assert OPEN.shortest_m((0.5, 0.0), np.zeros((0, 2))) == math.inf
    assert OPEN.shortest_m((0.5, 0.0), np.array([[9.0, 0.0]])) == math.inf


def plain_search(ground: NavigableArea) -> np.ndarray:
    """Shortest path lengths from the middle of cell (0, 0) over 8 neighbours [rows, columns]."""
    rows, columns = ground.free.shape
    away = np.full((rows, columns), np.inf)
    queue = [(0.0, (0, 0))]
    away[0, 0] = 0.0
    while queue:
        so_far, (r, c) = heapq.heappop(queue)
        if so_far > away[r, c]:
            continue
        for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            to = (r + dr, c + dc)
            if not (0 <= to[0] < rows and 0 <= to[1] < columns):
                continue
            if not (ground.free[to] and ground.free[r, to[1]] and ground.free[to[0], c]):
                continue
            new = so_far + math.hypot(dr, dc) * ground.cell_m
            if new < away[to]:
                away[to] = new
                heapq.heappush(queue, (new, to))
    return away


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.35))
def test_paths_through_clutter_are_no_longer_than_those_of_a_plain_search(seed: int, share: float):
    rng = np.random.default_rng(seed)
    free = rng.random((14, 14)) >= share
    free[0, 0] = True
    ground = NavigableArea(free, (0.0, 0.0), 0.1)
    away = plain_search(ground)
    for row, column in np.argwhere(free)[::9]:
        goal = np.array([[(column + 0.5) * 0.1, (row + 0.5) * 0.1]])
        found = ground.shortest_m((0.05, 0.05), goal)
        assert np.isfinite(found) == np.isfinite(away[row, column])
        if np.isfinite(found):
            assert found <= away[row, column] + 1e-9
            assert found >= math.dist((0.05, 0.05), goal[0]) - 1e-9


def test_clearance_is_the_distance_to_the_nearest_rectangle():
    rectangles = np.array([[0.0, 0.0, 0.5, 0.2, 0.0], [3.0, 0.0, 0.5, 0.2, math.pi / 2]])
    points = np.array([[0.0, 0.1], [0.0, 0.6], [0.8, 0.6], [3.0, 0.9], [2.6, 0.0]])
    assert clearance_m(points, rectangles) == pytest.approx([0.0, 0.4, 0.5, 0.4, 0.2])
    assert clearance_m(points, np.zeros((0, 5))).min() == math.inf


def test_spl_weights_success_by_path_length():
    assert spl(True, 10.0, 5.0) == 0.5
    assert spl(True, 5.0, 5.0) == 1.0
    assert spl(True, 4.95, 5.0) == 1.0  # the robot may stop 0.1 m before the viewpoint
    assert spl(False, 5.0, 5.0) == 0.0
    assert spl(True, 0.0, 0.0) == 1.0
