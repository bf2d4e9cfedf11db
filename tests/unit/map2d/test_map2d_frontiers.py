"""Frontiers against brute force, and how long they keep their ids."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from helios_map2d.grid import Box, GridSpec, TileMask
from helios_map2d.kernels import frontier_cells as frontier_kernels
from helios_map2d.kernels import frontier_clusters as cluster_kernels
from helios_map2d.kernels import frontier_tracking as identity_kernels
from helios_map2d.layers.explored_area import ExploredArea, near_ground
from helios_map2d.layers.frontiers import NO_CELLS, Frontier, FrontierFinder, FrontierRules
from helios_map2d.layers.reachability import ReachableFloor
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy import ndimage

SHAPE = (16, 24)
OCCUPANCIES = arrays(np.int8, SHAPE, elements=st.sampled_from([-1, 0, 0, 0, 100]))
EXPLOREDS = arrays(np.uint8, SHAPE, elements=st.sampled_from([0, 1, 1]))
GRID = GridSpec(0.025, 256, 256, (-128, -128))
RULES = FrontierRules(robot_radius_m=0.1, blind_radius_m=0.1, min_size_m=0.3)


def brute_mask(occupancy: NDArray[np.int8], explored: NDArray[np.uint8]) -> NDArray[np.bool_]:
    mask = np.zeros(occupancy.shape, bool)
    for r, c in np.ndindex(*occupancy.shape):
        if occupancy[r, c] != 0 or not explored[r, c]:
            continue
        for rr, cc in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
            inside = 0 <= rr < occupancy.shape[0] and 0 <= cc < occupancy.shape[1]
            if not inside or (not explored[rr, cc] and occupancy[rr, cc] != 100):
                mask[r, c] = True
    return mask


@settings(max_examples=60, deadline=None)
@given(OCCUPANCIES, EXPLOREDS, EXPLOREDS, st.integers(1, 6))
def test_frontier_cells_and_clusters_equal_brute_force(
    occupancy: NDArray[np.int8],
    before: NDArray[np.uint8],
    explored: NDArray[np.uint8],
    least: int,
) -> None:
    corner, side = (-8, -16), 8  # the tiles of the arrays begin at (-1, -2) of the world
    tiles = TileMask(np.ones((5, 6), np.uint8), (-2, -3))  # some lie beyond the arrays
    cells, other = update_cells(occupancy, before, corner, tiles, side, NO_CELLS)
    assert other == brute_mask(occupancy, before).any()
    known = cells
    cells, other = update_cells(occupancy, explored, corner, tiles, side, known)
    mask = brute_mask(occupancy, explored)
    assert cells.tolist() == by_tile(mask, corner, side)
    assert other == (cells.tolist() != known.tolist())

    own, starts = cluster_kernels.clusters_of(cells, side, least)
    expected, count = labelled(mask, 8)
    parts = [by_tile(expected == k, corner, side) for k in range(1, count + 1)]
    wanted = sorted(
        (p for p in parts if len(p) >= least), key=lambda p: (-len(p), cells.tolist().index(p[0]))
    )
    assert [own[a:b].tolist() for a, b in itertools.pairwise(starts)] == wanted


def update_cells(
    occupancy: NDArray[np.int8],
    explored: NDArray[np.uint8],
    corner: tuple[int, int],
    tiles: TileMask,
    side: int,
    old: NDArray[np.int32],
) -> tuple[NDArray[np.int32], bool]:
    return frontier_kernels.update_frontier_cells(
        occupancy, explored, corner, tiles.mask, tiles.first, side, old
    )


def test_only_the_requested_tiles_are_recomputed() -> None:
    occupancy, explored = np.zeros((24, 24), np.int8), np.zeros((24, 24), np.uint8)
    explored[4, 4] = explored[12, 12] = explored[20, 20] = 1
    everywhere = TileMask.of(itertools.product(range(3), range(3)))
    cells, _ = update_cells(occupancy, explored, (0, 0), everywhere, 8, NO_CELLS)
    explored[4, 4] = explored[20, 20] = 0
    explored[12, 13] = 1
    cells, other = update_cells(occupancy, explored, (0, 0), TileMask.of([(2, 2)]), 8, cells)
    assert (cells.tolist(), other) == ([[4, 4], [12, 12]], True)
    cells, other = update_cells(occupancy, explored, (0, 0), TileMask.of([(2, 2)]), 8, cells)
    assert (cells.tolist(), other) == ([[4, 4], [12, 12]], False)


def by_tile(mask: NDArray[np.bool_], corner: tuple[int, int], side: int) -> list[list[int]]:
    """The cells of a mask in world cells, tile after tile in row order."""
    cells = (np.argwhere(mask) + corner).tolist()
    return sorted(cells, key=lambda cell: ([v // side for v in cell], cell))


CLUSTERS = arrays(np.int8, (9, 40), elements=st.sampled_from([0, 0, 0, 1, 2, 3, 4, 5]))


@settings(max_examples=60, deadline=None)
@given(CLUSTERS, CLUSTERS, st.integers(0, 3), st.booleans())
def test_frontier_matching_equals_brute_force(
    former: NDArray[np.int8], now: NDArray[np.int8], reach: int, alike: bool
) -> None:
    """Clusters are the cells of one colour; some are the same as before."""
    if alike:
        now = np.where(former > 2, former, np.where(now > 2, 0, now)).astype(np.int8)
    old, new = by_colour(former), by_colour(now)
    numbers = [7 + 3 * k for k in range(len(old))]
    ids, same, next_id = identity_kernels.match_frontier_ids(
        *packed(new), *packed(old), np.array(numbers, np.int64), reach, 100
    )
    twins = [next((j for j, b in enumerate(old) if a.tolist() == b.tolist()), -1) for a in new]
    assert same.tolist() == twins
    wanted = {k: j for k, j in enumerate(twins) if j >= 0}
    votes = {
        (k, j): int((np.abs(a[:, None] - b).max(axis=2) <= reach).any(axis=1).sum())
        for k, a in enumerate(new)
        if k not in wanted
        for j, b in enumerate(old)
        if j not in wanted.values()
    }
    for k, j in sorted(votes, key=lambda pair: -votes[pair]):
        if votes[k, j] and k not in wanted and j not in wanted.values():
            wanted[k] = j
    fresh = iter(range(100, 200))
    assert ids.tolist() == [
        numbers[wanted[k]] if k in wanted else next(fresh) for k in range(len(new))
    ]
    assert next_id == next(fresh)


def by_colour(picture: NDArray[np.int8]) -> list[NDArray[np.int32]]:
    found = [np.argwhere(picture == k).astype(np.int32) for k in range(1, 6)]
    return [cells for cells in found if len(cells)]


def packed(parts: list[NDArray[np.int32]]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Clusters in the form that the kernels take."""
    starts = np.cumsum([0, *(len(part) for part in parts)], dtype=np.int64)
    return np.concatenate([NO_CELLS, *parts]), starts


@settings(max_examples=60, deadline=None)
@given(OCCUPANCIES, st.integers(0, 15), st.integers(0, 23), st.floats(0, 12))
def test_near_ground_is_the_flood_fill_of_open_cells_in_the_disc(
    occupancy: NDArray[np.int8], row: int, column: int, radius: float
) -> None:
    near = near_ground(occupancy, Box(0, SHAPE[0], 0, SHAPE[1]), (row, column), radius)
    r, c = np.indices(SHAPE)
    open_cells = (occupancy != 100) & ((r - row) ** 2 + (c - column) ** 2 <= radius**2)
    labels, _ = labelled(open_cells, 4)
    expected = (labels == labels[row, column]) & open_cells
    assert (near.astype(bool) == expected).all()


def labelled(mask: NDArray[np.bool_], connectivity: int) -> tuple[NDArray[np.int32], int]:
    """Connected components of a mask by scipy, counted from 1, and how many there are."""
    labels = np.zeros(mask.shape, np.int32)
    structure = ndimage.generate_binary_structure(2, 1 if connectivity == 4 else 2)
    ndimage.label(mask, structure=structure, output=labels)
    return labels, int(labels.max())


class World:
    """A grid that a test paints on, and a frontier finder."""

    def __init__(self, rules: FrontierRules = RULES) -> None:
        self.occupancy = np.full(GRID.shape, -1, np.int8)
        self.area = ExploredArea(GRID)
        self.finder = FrontierFinder(GRID, rules)
        self.ground = ReachableFloor(GRID, rules.robot_radius_m / GRID.cell_m)
        self.values = {"pick": np.zeros(GRID.shape, np.float32)}
        self._before = self.occupancy.copy()

    def free(self, rows: slice, columns: slice) -> None:
        box = Box(rows.start, rows.stop, columns.start, columns.stop).moved(28, 28)
        self.occupancy[box.slices] = 0
        self.area.add(np.ones((box.rows, box.columns), np.uint8), box)

    def wall(self, rows: slice, columns: slice) -> None:
        self.free(rows, columns)
        self.occupancy[
            Box(rows.start, rows.stop, columns.start, columns.stop).moved(28, 28).slices
        ] = 100

    def find(self, x_m: float = 0.0, y_m: float = 0.0) -> tuple[Frontier, ...]:
        self.ground.update(self.occupancy, self._before, GRID.whole)
        self._before = self.occupancy.copy()
        everywhere = TileMask.of(GRID.to_world(GRID.whole).tiles)
        self.finder.update(self.occupancy, self.area.explored, everywhere)
        return self.finder.find(self.occupancy, self.ground, (x_m, y_m), self.values)


def corridor() -> World:
    """Free ground 1.5 m wide, walled on both sides, open at both ends."""
    world = World()
    world.wall(slice(68, 70), slice(60, 140))
    world.wall(slice(130, 132), slice(60, 140))
    world.free(slice(70, 130), slice(60, 140))
    return world


def test_a_corridor_has_a_frontier_at_each_open_end_and_none_along_its_walls() -> None:
    found = corridor().find()
    assert len(found) == 2
    for frontier in found:
        assert frontier.size_m == pytest.approx(1.5)
        assert frontier.reachable
        assert abs(frontier.centre_m[0]) == pytest.approx(1.0, abs=0.02)
        assert frontier.centre_m[1] == pytest.approx(0.0, abs=0.03)


def test_small_frontiers_are_dropped() -> None:
    world = corridor()
    world.wall(slice(80, 132), slice(138, 140))
    assert len(world.find()) == 1  # the right end is open over 0.25 m only


def test_a_frontier_that_moves_a_little_keeps_its_id() -> None:
    world = corridor()
    left, right = sorted(world.find(), key=lambda f: f.centre_m[0])
    world.free(slice(70, 130), slice(140, 144))
    world.wall(slice(68, 70), slice(140, 144))
    world.wall(slice(130, 132), slice(140, 144))
    moved_left, moved_right = sorted(world.find(), key=lambda f: f.centre_m[0])
    assert (moved_left.id, moved_right.id) == (left.id, right.id)


def test_a_frontier_that_jumps_or_reappears_gets_a_new_id() -> None:
    world = corridor()
    before = {f.id for f in world.find()}
    saved = world.area.explored.copy(), world.occupancy.copy()
    world.wall(slice(70, 130), slice(138, 140))  # the right end is closed
    kept = world.find()
    assert len(kept) == 1
    assert kept[0].id in before
    world.area.explored[:], world.occupancy[:] = saved
    again = {f.id for f in world.find()}
    assert len(again & before) == 1
    assert max(again) > max(before)


def test_the_larger_part_of_a_split_frontier_keeps_the_id() -> None:
    world = corridor()
    right = max(world.find(), key=lambda f: f.centre_m[0])
    world.wall(slice(90, 94), slice(138, 140))
    parts = [f for f in world.find() if f.centre_m[0] > 0]
    assert len(parts) == 2
    larger, smaller = sorted(parts, key=lambda f: -f.size_m)
    assert larger.id == right.id
    assert smaller.id > right.id


def test_a_frontier_behind_a_gap_narrower_than_the_robot_is_not_reachable() -> None:
    world = corridor()
    world.wall(slice(70, 98), slice(120, 122))
    world.wall(slice(102, 130), slice(120, 122))  # a gap of 0.1 m
    left, right = sorted(world.find(), key=lambda f: f.centre_m[0])
    assert left.reachable
    assert not right.reachable


def test_the_value_is_the_median_of_the_non_zero_cells_within_half_a_metre() -> None:
    world = corridor()
    rng = np.random.default_rng(3)
    layer = rng.choice([0.0, 0.2, 0.5, 0.9], GRID.shape).astype(np.float32)
    world.values["pick"][:] = layer
    for frontier in world.find():
        row, column = GRID.cell_of(*frontier.centre_m)
        r, c = np.indices(GRID.shape)
        near = (r - row) ** 2 + (c - column) ** 2 <= 20**2
        expected = np.median(layer[near & (layer != 0)])
        assert frontier.values["pick"] == pytest.approx(float(expected))


def test_the_centre_is_the_first_cell_nearest_to_the_mean_position() -> None:
    for frontier in corridor().find():
        off = ((frontier.cells - frontier.cells.mean(axis=0)) ** 2).sum(axis=1)
        first = frontier.cells[np.argmin(off)]
        assert GRID.cell_of(*frontier.centre_m) == tuple(first - GRID.corner)


def test_a_value_change_just_within_the_radius_updates_the_frontier() -> None:
    world = corridor()
    row, column = GRID.cell_of(*world.find()[0].centre_m)
    world.values["pick"][row, column + 20] = 0.9
    world.finder.values_changed(GRID.to_world(Box(row, row + 1, column + 20, column + 21)))
    assert world.finder.revalued(world.values)[0].values["pick"] == pytest.approx(0.9)


def test_a_reset_explored_area_has_no_frontiers() -> None:
    world = corridor()
    assert world.find()
    world.area.reset()
    world.finder.reset()
    assert world.find() == ()


@given(rng=st.integers(0, 2**32 - 1).map(np.random.default_rng))
@settings(max_examples=20, deadline=None)
def test_updating_only_the_values_equals_finding_all_frontiers_again(
    rng: np.random.Generator,
) -> None:
    """Positions, sizes and ids are equal, too."""
    quick, anew = World(), World()
    for _ in range(3):
        row, column = rng.integers(60, 110, 2)
        for world in (quick, anew):
            world.free(slice(row, row + 30), slice(column, column + 40))
            world.find(0.0, 0.0)
        layer = rng.random(GRID.shape, dtype=np.float32)
        quick.values["pick"], anew.values["pick"] = layer, layer
        quick.finder.values_changed(Box(-1000, 1000, -1000, 1000))
        anew.finder.forget_values()
        fast, slow = quick.finder.revalued(quick.values), anew.find(0.0, 0.0)
        assert len(fast) == len(slow)
        for a, b in zip(fast, slow, strict=True):
            assert (a.id, a.centre_m, a.size_m, a.reachable, a.values) == (
                b.id,
                b.centre_m,
                b.size_m,
                b.reachable,
                b.values,
            )
            np.testing.assert_array_equal(a.cells, b.cells)


@given(rng=st.integers(0, 2**32 - 1).map(np.random.default_rng))
@settings(max_examples=30, deadline=None)
def test_describing_only_changed_frontiers_equals_describing_all(rng: np.random.Generator) -> None:
    quick, anew = World(), World()
    for _ in range(6):
        row, column = (int(v) for v in rng.integers(0, 150, 2))
        height, width = (int(v) for v in rng.integers(2, 50, 2))
        wall = rng.random() < 0.4
        x_m, y_m = rng.uniform(-2, 2, 2)
        for world in (quick, anew):
            paint = world.wall if wall else world.free
            paint(slice(row, row + height), slice(column, column + width))
        one = quick.find(x_m, y_m)
        two = anew.find(x_m, y_m)
        anew.finder.remember(two)  # the next search knows no reachability
        assert [(f.id, f.centre_m, f.reachable, f.size_m) for f in one] == [
            (f.id, f.centre_m, f.reachable, f.size_m) for f in two
        ]
