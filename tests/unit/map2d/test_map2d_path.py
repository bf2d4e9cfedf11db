"""Cost and clearance along a path."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.topics import PATH_COST
from helios_map2d.epoch_map import EpochMap
from helios_map2d.layers.parameters import MapRules
from helios_map2d.snapshots.path_cost import cost_along
from helios_map2d.snapshots.snapshot import MapSnapshot
from map2d_rig import Rig
from map2d_scene import Walk, room


def empty_room() -> MapSnapshot:
    """A room of 4 x 3 m, seen from two places."""
    walk, state = Walk(room()), EpochMap(MapRules(size_cells=400), (2.0, 1.5), 0.2)
    for x in (1.0, 3.0):
        for frame in walk.look_around(x, 1.5):
            state.integrate_frame(frame)
    return state.published


def test_clearance_is_the_distance_to_the_nearest_wall_less_the_radius() -> None:
    way = np.array([[0.5, 1.5], [3.5, 1.5]])
    cost = cost_along(empty_room(), way, 0.2, 5.0)
    assert cost.length_m == pytest.approx(3.0)
    expected = np.minimum(np.minimum(cost.samples_m[:, 0], 4 - cost.samples_m[:, 0]), 1.5) - 0.2
    np.testing.assert_allclose(cost.clearance_m, expected, atol=0.06)
    assert cost.least_clearance_m == pytest.approx(0.3, abs=0.06)
    assert not cost.blocked
    assert cost.unknown_m < 0.1  # between the two near blind zones


def test_a_wide_path_costs_its_length_and_a_narrow_path_more() -> None:
    snapshot = empty_room()
    middle = cost_along(snapshot, np.array([[1.5, 1.5], [2.5, 1.5]]), 0.2, 0.5)
    along_the_wall = cost_along(snapshot, np.array([[1.5, 0.35], [2.5, 0.35]]), 0.2, 0.5)
    assert middle.cost_m == pytest.approx(1.0, abs=1e-6)
    assert along_the_wall.cost_m > 2.5


def test_a_path_through_a_wall_is_blocked_and_unknown_floor_is_reported() -> None:
    cost = cost_along(empty_room(), np.array([[2.0, 1.5], [2.0, -1.5]]), 0.2, 0.5)
    assert cost.blocked
    assert math.isinf(cost.cost_m)
    assert cost.least_clearance_m < 0
    assert 1.3 < cost.unknown_m < 2.0  # behind the wall, and in both near blind zones


def test_path_samples_include_all_corners_and_are_at_most_a_cell_apart() -> None:
    way = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.01], [2.0, 2.01]])
    cost = cost_along(empty_room(), way, 0.2, 0.5)
    steps = np.hypot(*np.diff(cost.samples_m, axis=0).T)
    assert steps.max() <= 0.025 + 1e-9
    assert cost.length_m == pytest.approx(2.01)
    for corner in way:
        assert np.abs(cost.samples_m - corner).sum(axis=1).min() < 1e-9


@pytest.mark.parametrize(
    ("way", "reason"),
    [
        ([[0.0, 0.0]], "two corners"),
        ([[0.0, 0.0], [math.nan, 1.0]], "finite"),
        ([[0.0, 0.0], *[[2e4, 2e4], [-2e4, -2e4]] * 9], "too long"),
        ([[0.0, 0.0], [1e30, 1.0]], "within 20000 m"),
    ],
)
def test_an_invalid_path_is_refused(way: list[list[float]], reason: str) -> None:
    with pytest.raises(InvalidInput, match=reason):
        cost_along(empty_room(), np.array(way), 0.2, 0.5)


def test_a_path_request_without_a_radius_uses_the_robots_radius() -> None:
    rig = Rig()
    rig.settle()
    way = [1.0, 1.2, 3.0, 1.2]
    own = rig.bus.call(PATH_COST, pb.PathCostRequest(path_m=way), 5)
    given = rig.bus.call(PATH_COST, pb.PathCostRequest(path_m=way, radius_m=0.2), 5)
    assert own == given
    assert own.length_m == pytest.approx(2.0, abs=1e-5)
    assert len(own.samples_m) == 2 * len(own.clearance_m)
