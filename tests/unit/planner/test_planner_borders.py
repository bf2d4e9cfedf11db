"""Borders between known and unknown floor, on synthetic maps."""

from __future__ import annotations

import numpy as np
from helios_planner.motion_planning.costmap import GroundMap
from helios_planner.motion_planning.unknown_borders import borders_of, floor_m2
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

CELL_M = 0.05


def ground(occupancy: np.ndarray) -> GroundMap:
    occupancy = occupancy.astype(np.int8)
    return GroundMap(occupancy, np.zeros(occupancy.shape, np.float32), CELL_M, (-1.0, 2.0))


def room(unknown_from: int) -> np.ndarray:
    """Make a walled room of 40 x 40 cells; columns from `unknown_from` on were never seen."""
    occupancy = np.zeros((40, 40))
    occupancy[[0, -1]], occupancy[:, [0, -1]] = 100, 100
    occupancy[:, unknown_from:] = -1
    return occupancy


def test_a_border_is_where_free_floor_meets_the_unknown() -> None:
    [border] = borders_of(ground(room(20)), 0.4, 0.01)
    x_m, y_m = border.xy_m
    assert abs(x_m - (-1.0 + 19.5 * CELL_M)) < 1e-9
    assert abs(y_m - (2.0 + 20 * CELL_M)) < 2 * CELL_M
    assert abs(border.size_m - 38 * CELL_M) < 1e-9


def test_a_room_that_is_known_up_to_its_walls_has_no_border() -> None:
    assert borders_of(ground(room(40)), 0.4, 0.01) == []


def test_specks_and_short_borders_are_ignored() -> None:
    occupancy = room(40)
    occupancy[10:12, 10:12] = -1
    assert borders_of(ground(occupancy), 0.1, 0.015) == []
    occupancy[20:23, 20:23] = -1
    assert borders_of(ground(occupancy), 1.0, 0.015) == []
    assert len(borders_of(ground(occupancy), 0.4, 0.015)) == 1


def test_the_longest_border_comes_first() -> None:
    occupancy = room(40)
    occupancy[5:10, 5:10] = -1
    occupancy[20:35, 20:35] = -1
    sizes = [b.size_m for b in borders_of(ground(occupancy), 0.1, 0.015)]
    assert sizes == sorted(sizes, reverse=True)
    assert len(sizes) == 2


def test_floor_is_counted_in_square_metres() -> None:
    assert abs(floor_m2(ground(room(20))) - 38 * 19 * CELL_M**2) < 1e-9


@given(
    hnp.arrays(
        np.int8,
        hnp.array_shapes(min_dims=2, max_dims=2, max_side=12),
        elements=st.sampled_from([-1, 0, 100]),
    ),
    st.floats(0.0, 1.0),
    st.floats(0.0, 0.1),
)
def test_every_border_of_any_map_lies_on_free_floor(
    occupancy: np.ndarray, least_m: float, speck_m2: float
) -> None:
    here = ground(occupancy)
    for border in borders_of(here, least_m, speck_m2):
        (cell,) = here.cells_of(np.array([border.xy_m]))
        assert here.occupancy[cell[0], cell[1]] == 0
        assert border.size_m >= max(least_m, CELL_M)
