"""The grid grows when the robot leaves it; no cell moves and none is lost."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.types import Observation, SearchContext
from helios_map2d.epoch_map import EpochMap
from helios_map2d.grid import Box, GridSpec
from helios_map2d.layers.grid_growth import grown_for
from helios_map2d.layers.parameters import MapRules
from hypothesis import given
from hypothesis import strategies as st
from map2d_scene import Block, Walk, room, table

CONTEXT = SearchContext("search", (), {"pick": "a mug"})


def hall() -> Walk:
    """A hall of 24 x 3 m with tables along it."""
    tables = [block for x in range(3, 24, 4) for block in table(float(x), 2.4)]
    return Walk([*room(width=24.0), *tables], noise_at_1_m=0.001)


def map_of_hall(rules: MapRules) -> EpochMap:
    """A map after a walk down the hall with a look around every 4 m."""
    walk, state = hall(), EpochMap(rules, (1.0, 1.0), 0.2)
    state.reset_search(CONTEXT)
    for x in range(1, 24, 4):
        for frame in walk.look_around(float(x), 1.0)[::3]:
            state.integrate_frame(frame)
            score = (frame.id.seq * 37 % 100) / 100
            state.integrate_values(Observation(frame, "search", (), {"pick": score}, "test"))
    return state


def test_a_map_that_grew_equals_one_that_was_large_from_the_start() -> None:
    grown, large = map_of_hall(MapRules(size_cells=64)), map_of_hall(MapRules(size_cells=2400))
    assert grown.stack.grid.columns > 960
    one, other = grown.published, large.published
    assert one.grid == other.grid
    np.testing.assert_array_equal(one.occupancy, other.occupancy)
    np.testing.assert_array_equal(one.explored_for_search, other.explored_for_search)
    np.testing.assert_array_equal(one.z_low_m, other.z_low_m)
    np.testing.assert_array_equal(one.z_high_m, other.z_high_m)
    np.testing.assert_array_equal(one.values["pick"], other.values["pick"])
    np.testing.assert_array_equal(one.confidences["pick"], other.confidences["pick"])
    assert [(f.id, f.centre_m, f.size_m, f.reachable, f.values) for f in one.frontiers] == [
        (f.id, f.centre_m, f.size_m, f.reachable, f.values) for f in other.frontiers
    ]


def test_known_cells_keep_their_positions_when_the_map_grows() -> None:
    walk, state = hall(), EpochMap(MapRules(size_cells=64), (1.0, 1.0), 0.2)
    for frame in walk.look_around(1.0, 1.0):
        state.integrate_frame(frame)
    before, grid = state.published, state.stack.grid
    wall = np.argwhere(before.occupancy == 100)
    places = [before.grid.centre_of(int(r), int(c)) for r, c in wall]
    for x in (6.0, 11.0, 16.0):
        state.integrate_frame(walk.frame(x, 1.0, 0.0))
    after = state.published
    assert state.stack.grid != grid
    assert len(places) > 100
    kept = [after.occupancy[after.grid.cell_of(x, y)] == 100 for x, y in places]
    assert np.mean(kept) > 0.99


def test_a_grown_grid_leaves_a_margin_around_the_needed_area() -> None:
    grid, needed = GridSpec.over(Box(0, 256, 0, 256), 0.025), Box(70, 186, 40, 186)
    assert grown_for(grid, needed, 40, 16000) is grid
    grown = grown_for(grid, needed, 64, 16000)
    assert grown.to_world(grown.whole).holds(needed.grown(64))
    assert (grown.rows, grown.corner[0]) == (256, 0)  # grown only on the sides that need it


def test_a_frame_beyond_the_size_limit_is_refused_with_the_setting_to_change() -> None:
    walk, state = (
        hall(),
        EpochMap(MapRules(size_cells=64, most_cells=600, most_leap_m=500), (1.0, 1.0), 0.2),
    )
    state.integrate_frame(walk.frame(1.0, 1.0, 0.0))
    before = state.published
    with pytest.raises(InvalidInput, match="HELIOS_MAP2D_MOST_CELLS"):
        state.integrate_frame(walk.frame(1.0 + 60.0, 1.0, 0.0))
    assert state.published is before
    assert state.integrate_frame(walk.frame(2.0, 1.0, math.pi))


METRES = st.floats(-500, 500)


@given(METRES, METRES, METRES, METRES, st.sampled_from([0.01, 0.025, 0.05]))
def test_a_cells_position_does_not_depend_on_where_the_grid_is_centred(
    x: float, y: float, x0: float, y0: float, cell_m: float
) -> None:
    here = GridSpec.centred_on(x, y, cell_m, 200)
    there = GridSpec.centred_on(x0, y0, cell_m, 400)
    row, column = here.cell_of(x, y)
    cell = Box(row, row + 1, column, column + 1)
    assert here.whole.holds(cell)
    world = here.to_world(cell)
    same = there.to_local(world)
    assert there.cell_of(x, y) == (same.row_lo, same.column_lo)
    assert there.centre_of(same.row_lo, same.column_lo) == here.centre_of(row, column)


def test_a_wall_far_from_the_world_origin_is_mapped_at_its_position() -> None:
    walk = Walk([Block((102.0, -50, 0), (102.1, 50, 2.5))])
    state = EpochMap(MapRules(size_cells=64), (100.0, -40.0), 0.2)
    state.integrate_frame(walk.frame(100.0, -40.0, 0.0))
    rows, columns = np.nonzero(state.published.occupancy == 100)
    x = np.array(
        [
            state.published.grid.centre_of(int(r), int(c))[0]
            for r, c in zip(rows, columns, strict=True)
        ]
    )
    assert len(x) > 50
    assert np.abs(x - 102.0).max() < 0.05
