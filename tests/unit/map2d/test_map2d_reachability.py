"""Reachable floor against brute force, while obstacles appear and disappear."""

from __future__ import annotations

import numpy as np
from helios_map2d.grid import EMPTY, TILE, Box, GridSpec
from helios_map2d.layers.explored_area import near_ground
from helios_map2d.layers.reachability import ReachableFloor, ReachedCells
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

GRID = GridSpec(0.025, 3 * TILE, 2 * TILE, (-TILE, 5 * TILE))


def brute_force_reachable(
    occupancy: NDArray[np.int8], cell: tuple[int, int], radius: float, blind: float
) -> NDArray[np.bool_]:
    """The distance of every cell to every obstacle, then one flood fill over the whole grid."""
    row, column = cell
    r, c = np.indices(occupancy.shape)
    occupied = occupancy == 100
    clear = np.ones(occupancy.shape, bool)
    if occupied.any():
        clear = np.asarray(ndimage.distance_transform_edt(~occupied)) > radius
    whole = Box(0, occupancy.shape[0], 0, occupancy.shape[1])
    known = (occupancy == 0) | (near_ground(occupancy, whole, cell, blind) > 0)
    own = ((r - row) ** 2 + (c - column) ** 2 <= radius**2) & ~occupied
    open_cells = (clear & known) | own
    open_cells[row, column] = True
    labels = np.zeros(occupancy.shape, np.int32)
    ndimage.label(open_cells, output=labels)
    return labels == labels[row, column]


def mask_of(ground: ReachableFloor, reached: ReachedCells) -> NDArray[np.bool_]:
    """The reachable cells of the whole grid."""
    out = np.zeros(ground.grid.shape, np.bool_)
    offsets = np.repeat(np.repeat(reached.offsets, TILE, 0), TILE, 1)
    open_cells = ground.labels > 0
    at = offsets[open_cells] + ground.labels[open_cells] - 1
    out[open_cells] = reached.reached[at] > 0
    row, column = reached.near_corner
    rows, columns = reached.near.shape
    out[row : row + rows, column : column + columns] |= reached.near > 0
    return out


def rooms(rng: np.random.Generator) -> NDArray[np.int8]:
    """Random rectangles of free ground and obstacles on unknown."""
    out = np.full(GRID.shape, -1, np.int8)
    for _ in range(rng.integers(5, 40)):
        scribble(rng, out)
    return out


def scribble(rng: np.random.Generator, occupancy: NDArray[np.int8]) -> Box:
    """Change one random rectangle and return its box."""
    height, width = rng.integers(1, 60, 2) if rng.random() < 0.7 else rng.integers(1, 4, 2)
    row, column = rng.integers(0, GRID.rows - 1), rng.integers(0, GRID.columns - 1)
    box = Box(int(row), int(row + height), int(column), int(column + width)).intersection(
        GRID.whole
    )
    occupancy[box.slices] = rng.choice([-1, 0, 0, 0, 100])
    return box


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32 - 1).map(np.random.default_rng),
    st.sampled_from([1.3, 4.1, 12.2]),
    st.sampled_from([0.0, 5.0, 40.0]),
)
def test_reachable_floor_equals_brute_force_as_the_map_changes(
    rng: np.random.Generator, radius: float, blind: float
) -> None:
    ground = ReachableFloor(GRID, radius)
    occupancy, former = np.full(GRID.shape, -1, np.int8), np.zeros(GRID.shape, np.bool_)
    for change in range(4):
        before = occupancy.copy()
        if change == 0:
            occupancy, box = rooms(rng), GRID.whole
        else:
            box = EMPTY
            for _ in range(3):
                box = box.union(scribble(rng, occupancy))
        ground.update(occupancy, before[box.slices], box)
        cell = (int(rng.integers(0, GRID.rows)), int(rng.integers(0, GRID.columns)))
        reached = ground.reached_from(occupancy, cell, blind)
        got = mask_of(ground, reached)
        np.testing.assert_array_equal(got, brute_force_reachable(occupancy, cell, radius, blind))
        changed = np.repeat(np.repeat(reached.changed, TILE, 0), TILE, 1) > 0
        np.testing.assert_array_equal(got[~changed], former[~changed])
        former = got


def test_floor_near_the_robot_behind_a_narrow_gap_is_reached_by_a_detour() -> None:
    occupancy = np.full(GRID.shape, -1, np.int8)
    occupancy[40:171, 20:61] = 0  # where the robot is
    occupancy[155:171, 20:126] = 0  # a detour around the wall
    occupancy[120:171, 80:101] = 0
    occupancy[85:96, 80:93] = 0  # beyond unknown floor, which may be crossed near the robot
    occupancy[50:141, 70] = 100
    occupancy[96, 70] = -1  # too narrow
    ground = ReachableFloor(GRID, 4.1)
    ground.update(occupancy, np.full(GRID.shape, -1, np.int8), GRID.whole)
    got = mask_of(ground, ground.reached_from(occupancy, (96, 60), 40.0))
    assert got[85:96, 80:93].all()
    np.testing.assert_array_equal(got, brute_force_reachable(occupancy, (96, 60), 4.1, 40.0))


def test_inflation_beyond_the_known_area_is_kept_when_the_grid_grows() -> None:
    occupancy = np.full(GRID.shape, -1, np.int8)
    occupancy[100, 60] = 100
    ground = ReachableFloor(GRID, 6.2)
    ground.update(occupancy, np.full(GRID.shape, -1, np.int8), GRID.whole)
    before = ground.obstacle_count.sum()
    large = GridSpec(0.025, 6 * TILE, 5 * TILE, (-3 * TILE, 3 * TILE))
    ground.grow(large, GRID.to_world(Box(100, 101, 60, 61)))
    assert ground.obstacle_count.sum() == before > 100


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1).map(np.random.default_rng))
def test_a_grown_grid_equals_one_that_was_large_from_the_start(rng: np.random.Generator) -> None:
    large = GridSpec(0.025, 6 * TILE, 5 * TILE, (-3 * TILE, 3 * TILE))
    occupancy = rooms(rng)
    # The margin that a map keeps around its known cells.
    occupancy[:20], occupancy[-20:], occupancy[:, :20], occupancy[:, -20:] = -1, -1, -1, -1
    ground = ReachableFloor(GRID, 6.2)
    ground.update(occupancy, np.full(GRID.shape, -1, np.int8), GRID.whole)
    ground.grow(large, GRID.to_world(GRID.whole))
    over = np.full(large.shape, -1, np.int8)
    over[large.to_local(GRID.to_world(GRID.whole)).slices] = occupancy
    anew = ReachableFloor(large, 6.2)
    anew.update(over, np.full(large.shape, -1, np.int8), large.whole)
    np.testing.assert_array_equal(ground.obstacle_count, anew.obstacle_count)
    np.testing.assert_array_equal(ground.labels, anew.labels)
    np.testing.assert_array_equal(ground.counts, anew.counts)
