"""FM²: fast marching over a speed field, and the descent along arrival times."""

from __future__ import annotations

import heapq
import itertools
import math

import cv2
import numpy as np
import pytest
import skfmm
from helios_core.errors import InvalidInput
from helios_planner.motion_planning import path_planner
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from planner_ground import CELL_M, free_places, random_ground


def heap_marching(speed: NDArray[np.float32], source: tuple[int, int]) -> NDArray[np.float64]:
    """Readable reference of `kernels.march`: an exact heap, one cell at a time."""
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


def test_marching_matches_the_exact_heap() -> None:
    rng = np.random.default_rng(0)
    for seed in range(4):
        ground = random_ground(seed, 60)
        speed = rng.uniform(0.1, 1.0, ground.occupancy.shape).astype(np.float32)
        speed = np.asarray(cv2.GaussianBlur(speed, (9, 9), 0), np.float32)
        speed[ground.occupancy > 0] = 0
        source = (int(np.argwhere(speed > 0)[17, 0]), int(np.argwhere(speed > 0)[17, 1]))
        fast = path_planner.arrival_time(speed, np.array([source]))
        exact = heap_marching(speed, source)
        assert (np.isfinite(fast) == np.isfinite(exact)).all()
        known = np.isfinite(exact) & (exact > 5)
        # Both solve the same equations; they differ only by rounding to float32.
        assert np.max(np.abs(fast[known] - exact[known]) / exact[known]) < 1e-4


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_exactly_the_connected_cells_have_an_arrival_time(seed: int) -> None:
    ground = random_ground(seed)
    speed = np.where(ground.occupancy > 0, 0, 1).astype(np.float32)
    source = np.argwhere(speed > 0)[:1]
    arrival = path_planner.arrival_time(speed, source)
    _, labels = cv2.connectedComponents((speed > 0).astype(np.uint8), connectivity=4)
    same = labels == labels[tuple(source[0])]
    assert (np.isfinite(arrival) == same).all()


def test_a_descent_never_cuts_a_corner() -> None:
    speed = np.zeros((12, 12), np.float32)
    speed[1:-1, 1:-1] = 1
    speed[5, 1:9] = 0
    arrival = path_planner.arrival_time(speed, np.array([[1, 1]]))
    path = path_planner.descend(arrival, (9, 1)).astype(float) + 0.5
    assert least_crossed(speed, path) > 0
    assert np.isinf(arrival[5, 4])


def least_crossed(field: NDArray[np.float32], path: NDArray[np.float64]) -> float:
    """Return the least value of the cells on a path [n, 2] (rows, columns, not rounded)."""
    dense = np.concatenate(
        [a + (b - a) * np.linspace(0, 1, 200)[:, None] for a, b in itertools.pairwise(path)]
    )
    cells = np.floor(dense).astype(int)
    return float(field[cells[:, 0], cells[:, 1]].min())


def test_free_border_cells_and_blocked_sources_are_refused() -> None:
    with pytest.raises(InvalidInput, match="border"):
        path_planner.arrival_time(np.ones((8, 8), np.float32), np.array([[4, 4]]))
    with pytest.raises(InvalidInput, match="source"):
        path_planner.arrival_time(np.zeros((8, 8), np.float32), np.array([[0, 4]]))


def time_along(speed: NDArray[np.float32], path: NDArray[np.float64]) -> float:
    """Return the time of a path [n, 2] (rows, columns, not rounded) through cells of that speed."""
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
    """The optimum is second-order marching by another implementation, on a grid five times as fine.
    The limit adds one cell's crossing to the 5 %, since both ends of a path are cells."""
    ground = random_ground(seed, 80)
    places = free_places(ground, 2, seed)
    if len(places) < 2:
        return
    source, start = ((int(r), int(c)) for r, c in ground.cells_of(np.array(places)))
    distance = cv2.distanceTransform((ground.occupancy == 0).astype(np.uint8), cv2.DIST_L2, 5)
    speed = path_planner.speed_field((distance * CELL_M).astype(np.float32), 0.35, 0.3, 0.3)
    arrival = path_planner.arrival_time(speed, np.array([source]))
    path = path_planner.descend(arrival, start).astype(float) + 0.5
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
