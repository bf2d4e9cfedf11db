"""Occupancy grids of ray-cast rooms."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.types import Frame
from helios_map2d.epoch_map import EpochMap
from helios_map2d.layers.occupancy import OccupancyRules
from helios_map2d.layers.parameters import MapRules
from helios_map2d.settings import Settings
from map2d_scene import Block, Walk, chair, room, table
from numpy.typing import NDArray

RULES = MapRules(size_cells=480)
RADIUS_M = 0.2


def mapped(frames: list[Frame], rules: MapRules = RULES) -> EpochMap:
    base = frames[0].T_world_base
    state = EpochMap(rules, (base[0, 3], base[1, 3]), RADIUS_M)
    for frame in frames:
        state.integrate_frame(frame)
    return state


def at(state: EpochMap, x: float, y: float) -> int:
    return int(state.stack.occupancy.occupancy[state.stack.grid.cell_of(x, y)])


def distances_to_walls(state: EpochMap, width: float, depth: float) -> NDArray[np.float64]:
    """Distance (m) of every occupied cell's centre to the nearest inner wall face of the room."""
    cells = np.argwhere(state.stack.occupancy.occupancy == 100)
    x, y = np.array([state.stack.grid.centre_of(r, c) for r, c in cells]).T
    return np.min([abs(x), abs(x - width), abs(y), abs(y - depth)], axis=0)


@pytest.mark.parametrize("pitch_deg", [10, 30, 45])
def test_walls_are_within_two_cells_and_the_floor_is_free(pitch_deg: int) -> None:
    walk = Walk(room())
    state = mapped(walk.look_around(3.0, 1.5, pitch_down=math.radians(pitch_deg)))
    far = distances_to_walls(state, 4.0, 3.0)
    assert len(far) > 200
    assert far.max() <= 2 * state.stack.grid.cell_m
    assert at(state, 0.6, 1.5) == 0
    assert at(state, -0.5, 1.5) == -1  # behind the wall


def test_noise_and_outliers_leave_walls_thin_and_the_floor_free() -> None:
    walk = Walk(room(), noise_at_1_m=0.0025, outliers=0.002)
    frames = [f for x in (0.7, 2.0, 3.3) for y in (0.8, 2.2) for f in walk.look_around(x, y)]
    state = mapped(frames)
    far = distances_to_walls(state, 4.0, 3.0)
    assert np.mean(far <= 3 * state.stack.grid.cell_m) > 0.97
    assert far.max() < 0.2
    inside = [at(state, x, y) for x in np.arange(0.4, 3.6, 0.05) for y in np.arange(0.4, 2.6, 0.05)]
    assert np.mean(np.array(inside) == 0) > 0.99


def test_a_moved_chair_is_freed_within_three_frames() -> None:
    walk = Walk([*room(), *chair(3.0, 1.5)])
    state = mapped([walk.frame(1.0, 1.5, 0.1 * k) for k in (-1, 0, 1, 0, 1)])
    assert at(state, 3.0, 1.671) == 100
    assert at(state, 3.0, 1.5) == 100
    walk.blocks = [*room(), *chair(3.0, 0.6)]
    for k in (-1, 0, 1):
        state.integrate_frame(walk.frame(1.0, 1.5, 0.1 * k))
    for dx in (-0.15, 0.0, 0.15):
        assert at(state, 3.0 + dx, 1.65) == 0
        assert at(state, 3.0 + dx, 1.671) == 0
    assert at(state, 3.0, 0.6) == 100


def test_an_obstacle_behind_a_sofa_is_freed_although_its_floor_is_never_seen() -> None:
    sofa = Block((2.0, 0.5, 0), (2.4, 2.5, 0.85))
    person = Block((2.5, 1.3, 0), (2.8, 1.7, 1.2))
    walk = Walk([*room(), sofa, person])
    state = mapped([walk.frame(0.5, 1.5, 0.0, math.radians(15))])
    assert at(state, 2.51, 1.5) == 100
    walk.blocks = [*room(), sofa]
    for _ in range(3):
        state.integrate_frame(walk.frame(0.5, 1.5, 0.0, math.radians(15)))
    assert at(state, 2.51, 1.5) == -1
    assert at(state, 2.01, 1.5) == 100


def test_a_thin_leg_and_a_table_edge_are_obstacles_although_floor_is_seen_around_them() -> None:
    pole = Block((1.8, 0.5, 0), (1.82, 0.52, 1.0))
    walk = Walk([*room(), *table(2.5, 1.5), pole])
    frames = [walk.frame(0.6, 1.5, 0.0), walk.frame(0.6, 0.9, -0.1), walk.frame(0.6, 2.0, 0.0)]
    state = mapped(frames)
    assert at(state, 1.805, 0.51) == 100
    for y in (1.25, 1.5, 1.75):
        assert at(state, 2.11, y) == 100, "front edge of the table top"
    before = state.stack.occupancy.occupancy.copy()
    for _ in range(5):
        state.integrate_frame(walk.frame(0.6, 1.5, 0.0))
    lost = (before == 100) & (state.stack.occupancy.occupancy != 100)
    assert lost.sum() == 0


def test_floor_seen_under_a_table_leaves_the_top_occupied() -> None:
    walk = Walk([*room(), *table(2.5, 1.5)])
    state = mapped([walk.frame(0.7, 1.5, 0.0), walk.frame(1.2, 1.5, 0.0), *walk.look_around(1, 1)])
    row, column = state.stack.grid.cell_of(2.46, 1.5)
    assert state.stack.occupancy.occupancy[row, column] == 100
    assert state.stack.occupancy.z_high_m[row, column] == pytest.approx(0.74, abs=0.02)


def test_obstacle_heights_are_accurate_to_two_centimetres() -> None:
    box = Block((2.0, 1.2, 0), (2.5, 1.8, 0.6))
    state = mapped(Walk([*room(), box]).look_around(0.8, 1.5))
    row, column = state.stack.grid.cell_of(2.01, 1.5)
    assert state.stack.occupancy.z_high_m[row, column] == pytest.approx(0.6, abs=0.02)
    assert state.stack.occupancy.z_low_m[row, column] < 0.15


@pytest.mark.parametrize("roll", [math.pi, math.pi / 2, 0.4])
def test_a_rolled_or_upside_down_camera_sees_the_same_walls(roll: float) -> None:
    state = mapped(Walk(room()).look_around(2.0, 1.5, roll=roll))
    assert distances_to_walls(state, 4.0, 3.0).max() <= 2 * state.stack.grid.cell_m
    assert at(state, 0.7, 1.5) == 0


def test_a_camera_looking_straight_down_frees_the_floor_under_it() -> None:
    state = mapped([Walk(room()).frame(2.0, 1.5, 0.0, math.pi / 2)])
    for dx in (-0.4, -0.1, 0.1, 0.4):
        assert at(state, 2.0 + dx, 1.5 + 0.1) == 0
    assert at(state, 3.5, 1.5) == -1


def test_only_the_footprint_is_free_where_the_tilted_camera_cannot_see() -> None:
    state = mapped([Walk(room()).frame(2.0, 1.5, 0.0)])
    assert at(state, 2.0, 1.5) == 0
    assert at(state, 2.0 + RADIUS_M - 0.03, 1.5) == 0
    assert at(state, 2.0 + RADIUS_M + 0.1, 1.5) == -1  # the near blind zone
    assert at(state, 1.0, 1.5) == -1  # behind the robot
    assert at(state, 3.5, 1.5) == 0


def test_the_robots_own_arm_leaves_no_obstacle() -> None:
    arm = Block((2.1, 1.45, 0.6), (2.2, 1.55, 0.9))
    state = mapped(Walk([*room(), arm]).look_around(2.0, 1.5))
    assert distances_to_walls(state, 4.0, 3.0).max() <= 2 * state.stack.grid.cell_m


def test_a_held_object_leaves_no_obstacle() -> None:
    held = Block((2.35, 1.42, 0.7), (2.45, 1.58, 0.9))  # beyond the robot's radius of 0.2 m
    walk = Walk([*room(), held])
    for holding in (True, False):
        state = EpochMap(RULES, (2.0, 1.5), RADIUS_M)
        for _ in range(3):
            state.integrate_frame(walk.frame(2.0, 1.5, 0.0), holding=holding)
        assert (at(state, 2.36, 1.5) == 100) is not holding
        assert at(state, 3.99, 0.9) == 100


def test_flying_pixels_at_depth_edges_leave_no_obstacle() -> None:
    frame = Walk([*room(), Block((2.4, 1.2, 0), (2.6, 1.8, 1.2))]).frame(1.0, 1.5, 0.0, 0.2)
    depth = frame.depth_m.copy()
    rows, columns = np.nonzero(np.abs(np.diff(depth, axis=1)) > 0.5)
    depth[rows, columns] = (depth[rows, columns - 1] + depth[rows, columns + 1]) / 2
    assert len(rows) > 50
    state = mapped([replace(frame, depth_m=depth)])
    (x_m,) = (np.argwhere(state.published.occupancy == 100)[:, 1:] * 0.025).T
    x_m += state.published.grid.origin_m[0]
    assert not ((x_m > 2.65) & (x_m < 3.6)).any()  # where the flying pixels are
    assert (x_m > 3.9).any()
    assert (x_m < 2.65).any()


def test_a_passing_person_leaves_no_obstacle() -> None:
    walk = Walk(room())
    frames = []
    for x in np.arange(1.8, 3.4, 0.2):
        walk.blocks = [*room(), Block((x, 1.0, 0), (x + 0.3, 1.5, 1.75))]
        frames.append(walk.frame(0.5, 1.5, -0.1, math.radians(20)))
    assert at(mapped(frames), 3.21, 1.3) == 100
    walk.blocks = room()
    frames += [walk.frame(0.5, 1.5, -0.1, math.radians(20)) for _ in range(3)]
    state = mapped(frames)
    assert distances_to_walls(state, 4.0, 3.0).max() <= 2 * state.stack.grid.cell_m
    for x in (2.2, 2.6, 3.1):
        assert at(state, x, 1.25) == 0


@pytest.mark.parametrize(
    ("block_m", "settings", "obstacle"),
    [
        ((1.60, 1.90), {}, False),  # the robot passes under the block
        ((1.60, 1.90), {"band_hi_m": 1.8}, True),
        ((0.0, 0.06), {}, False),  # a rug
        ((0.0, 0.06), {"band_lo_m": 0.04, "floor_tolerance_m": 0.02, "band_rise_per_m": 0}, True),
        ((0.0, 0.30), {}, True),
        ((0.0, 0.30), {"band_lo_m": 0.40}, False),
    ],
)
def test_the_height_band_decides_what_is_an_obstacle(
    block_m: tuple[float, float], settings: dict[str, Any], obstacle: bool
) -> None:
    low, high = block_m
    walk = Walk([*room(), Block((3.0, 0.7, low), (3.4, 2.3, high))])
    state = mapped(
        [walk.frame(0.5, 1.5, 0.0, math.radians(10)) for _ in range(2)],
        replace(RULES, occupancy=OccupancyRules(**settings)),
    )
    row, column = state.stack.grid.cell_of(3.01, 1.5)
    front = state.stack.occupancy.occupancy[row, column - 2 : column + 3]
    assert (100 in front) is obstacle


@pytest.mark.parametrize("depth_m", [0.0, math.nan, math.inf, -1.0, 65.535])
def test_a_depth_image_without_measurements_frees_only_the_footprint(depth_m: float) -> None:
    frame = Walk(room()).frame(2.0, 1.5, 0.0)
    state = mapped([with_depth(frame, np.full_like(frame.depth_m, depth_m))])
    known = np.argwhere(state.stack.occupancy.occupancy != -1)
    x, y = np.array([state.stack.grid.centre_of(r, c) for r, c in known]).T
    assert np.hypot(x - 2.0, y - 1.5).max() <= RADIUS_M  # where the robot stands


@pytest.mark.parametrize("depth_m", [0.0, math.nan, math.inf, -1.0, 65.535])
def test_depth_images_without_measurements_remove_no_obstacle(depth_m: float) -> None:
    walk = Walk([*room(), Block((3.0, 1.2, 0), (3.3, 1.8, 1.0))])
    frames = [walk.frame(1.0, 1.5, 0.0, math.radians(20)) for _ in range(6)]
    blind = [with_depth(f, np.full_like(f.depth_m, depth_m)) for f in frames[3:]]
    before, after = mapped(frames[:3]), mapped(frames[:3] + blind)
    np.testing.assert_array_equal(after.published.occupancy, before.published.occupancy)


def test_floor_behind_a_box_is_neither_known_nor_explored() -> None:
    walk = Walk([*room(), Block((2.8, 1.0, 0), (3.2, 2.0, 0.9))])
    state = mapped([walk.frame(0.7, 1.5, 0.0, math.radians(20))])
    behind, before = (state.stack.grid.cell_of(x, 1.5) for x in (3.5, 2.5))
    assert (state.stack.occupancy.occupancy[behind], state.stack.search.explored[behind]) == (-1, 0)
    assert (state.stack.occupancy.occupancy[before], state.stack.search.explored[before]) == (0, 1)


def test_a_default_map_starts_with_at_least_2000_cells_of_2_5_cm_a_side() -> None:
    grid = EpochMap(Settings.load([]).rules(10.0, 0.2), (0.0, 0.0), RADIUS_M).stack.grid
    assert grid.cell_m == 0.025
    assert min(grid.shape) >= 2000


def test_invalid_pixels_add_no_known_cells() -> None:
    walk = Walk(room())
    frame = walk.frame(2.0, 1.5, 0.0)
    clean = mapped([frame])
    depth = frame.depth_m.copy()
    upper = np.zeros(depth.shape, bool)
    upper[:30] = True
    for bad in (np.nan, np.inf, -1.0, 0.0):
        broken = np.where(upper, bad, depth).astype(np.float32)
        state = mapped([with_depth(frame, broken)])
        assert set(np.unique(state.stack.occupancy.occupancy)) <= {-1, 0, 100}
        known = state.stack.occupancy.occupancy != -1
        assert known.sum() > 500
        # The known cells are a subset of those that the whole image gives.
        lost = known & (clean.stack.occupancy.occupancy == -1)
        assert lost.sum() <= 0.02 * known.sum()


def test_cells_beyond_the_depth_range_stay_unknown() -> None:
    walk = Walk(room(width=9.0))
    near = mapped([walk.frame(1.0, 1.5, 0.0)], MapRules(size_cells=800, max_depth_m=3.0))
    assert at(near, 3.0, 1.5) == 0
    assert at(near, 5.5, 1.5) == -1


def test_a_floor_tolerance_above_the_obstacle_band_is_refused() -> None:
    with pytest.raises(InvalidInput, match="floor tolerance"):
        OccupancyRules(floor_tolerance_m=0.2)
    with pytest.raises(InvalidInput, match="is empty"):
        OccupancyRules(band_hi_m=0.05)


def with_depth(frame: Frame, depth_m: NDArray[np.float32]) -> Frame:
    return Frame(frame.id, frame.stamp_ns, frame.keyframe, frame.color, depth_m, frame.camera,
                 frame.T_world_cam, frame.T_world_base)  # fmt: skip
