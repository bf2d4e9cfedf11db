"""Small rules of the 2D map that no other test covers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import Conflict, InvalidInput
from helios_core.types import FrameId, Observation, SearchContext, WorldId
from helios_map2d.epoch_map import EpochMap
from helios_map2d.epochs import EpochMaps
from helios_map2d.frame_order import FrameOrder
from helios_map2d.grid import GridSpec
from helios_map2d.kernels import occupancy_fusion as fuse_kernels
from helios_map2d.kernels.occupancy_fusion import MEMORY
from helios_map2d.layers.line_of_sight import line_of_sight
from helios_map2d.layers.occupancy import OccupancyRules
from helios_map2d.layers.parameters import MapRules
from helios_map2d.layers.value_layers import Cone
from helios_map2d.snapshots.delta import changes_after
from helios_map2d.snapshots.path_cost import cost_along
from helios_map2d.snapshots.snapshot import EVIDENCE, ground_of
from helios_map2d.snapshots.tiles import GroundTile
from helios_map2d.view_memory.stored_views import SeenView, ViewMemory
from hypothesis import given, settings
from hypothesis import strategies as st
from map2d_kept import parked
from map2d_scene import Block, Walk, room

RULES = MapRules(size_cells=400)


@pytest.mark.parametrize(
    ("body_m", "holding", "stands"),
    [(0.2, False, True), (0.2, True, False), (0.0, True, True), (0.0, False, True)],
)
def test_near_obstacles_are_ignored_only_for_a_robot_with_a_body_that_holds_an_object(
    body_m: float, holding: bool, stands: bool
) -> None:
    walk = Walk([*room(), Block((1.46, 1.3, 0), (1.52, 1.7, 1.0))])  # 0.46 m ahead of the robot
    state = EpochMap(RULES, (1.0, 1.5), body_m)
    for _ in range(3):
        state.integrate_frame(walk.frame(1.0, 1.5, 0.0), holding=holding)
    row, column = state.stack.grid.cell_of(1.47, 1.5)
    near = state.stack.occupancy.occupancy[row - 2 : row + 3, column - 1 : column + 2]
    assert (near == 100).any() == stands


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1).map(np.random.default_rng), st.floats(0.3, 0.7), st.floats(0, 0.4))
def test_clearing_the_footprint_frees_its_cells_and_reports_only_changed_ones(
    rng: np.random.Generator, x_m: float, radius_m: float
) -> None:
    grid, shape = GridSpec(0.05, 24, 20, (3, 2)), (24, 20)
    evidence = rng.integers(0, 2, shape).astype(np.uint8)
    floor_seen = rng.integers(0, 2, shape).astype(np.uint8)
    occupancy = rng.choice([-1, 0, 100], shape).astype(np.int8)
    before = (evidence != 0) | (floor_seen == 0) | (occupancy != 0)
    came_of_it = np.zeros((22, 18), np.uint8)
    kept = evidence.copy()
    fuse_kernels.clear_disc(
        (1, 23, 2, 20),
        grid.origin_m,
        0.05,
        (x_m, 0.8, radius_m),
        evidence,
        floor_seen,
        occupancy,
        (1, 2),
        came_of_it,
    )
    places = np.array([grid.centre_of(r, c) for r, c in np.ndindex(shape)]).reshape(*shape, 2)
    disc = ((places - (x_m, 0.8)) ** 2).sum(axis=2) <= radius_m**2
    disc[0], disc[23], disc[:, :2] = False, False, False
    assert not evidence[disc].any()
    assert (floor_seen[disc] == 1).all()
    assert not occupancy[disc].any()
    assert (evidence[~disc] == kept[~disc]).all()
    reported = np.zeros(shape, bool)
    reported[1:23, 2:20] = came_of_it == MEMORY
    assert (reported == (disc & before)).all()


def test_a_client_that_knows_another_map_gets_the_whole_map() -> None:
    walk, state = Walk(room()), EpochMap(RULES, (2.0, 1.5), 0.2)
    for frame in walk.look_around(2.0, 1.5):
        state.integrate_frame(frame)
    snapshot = state.published
    whole = changes_after(snapshot, pb.MapChangesRequest(most_tiles=1000))
    assert whole.map_id == state.map_id
    known = pb.MapChangesRequest(map_id=whole.map_id, after=whole.next, most_tiles=1000)
    assert not changes_after(snapshot, known).tiles
    foreign = pb.MapChangesRequest(map_id="another", after=whole.next, most_tiles=1000)
    assert changes_after(snapshot, foreign) == whole
    ahead = pb.MapChangesRequest(
        map_id=whole.map_id, most_tiles=1000, after=pb.MapCursor(version=whole.version + 1)
    )
    assert changes_after(snapshot, ahead) == whole


def test_view_memory_drops_the_view_with_the_largest_covered_share_not_the_largest_count() -> None:
    def view(seq: int, *patches: int) -> SeenView:
        cone = Cone(0.0, 0.0, (1.0, 0.0), 0.5, np.zeros(8, np.float32))
        out = SeenView(FrameId("robot", 0, seq), 0, cone, None, b"")
        out.__dict__["patches"] = frozenset((p, 0, 0) for p in patches)
        return out

    memory = ViewMemory(2)
    # Other views cover 1 of 1 squares of the first view and 5 of 10 of the second.
    for one in (view(1, 0), view(2, *range(10)), view(3, 1, 2, 3, 4)):
        memory.add(one)
    assert [v.id.seq for v in memory.snapshot()] == [2, 3]


def test_clearance_is_measured_to_the_edge_of_an_occupied_cell() -> None:
    occupancy = np.zeros((64, 64), np.int8)
    occupancy[10, 20] = 100
    flat, blank = np.zeros((64, 64), np.float32), np.zeros((64, 64), np.uint8)
    tile = GroundTile((0, 0), 1, 1, occupancy, blank, flat, flat, blank, blank)
    snapshot = dataclasses.replace(
        EpochMap(RULES, (0.5, 0.5), 0.0).published,
        grid=GridSpec(0.025, 64, 64, (0, 0)),
        ground={(0, 0): tile},
    )
    way = np.array([[8.5, 10.5], [10.5, 10.5]]) * 0.025  # from cell to cell along a row
    cost = cost_along(snapshot, way, 0.1, 5.0)
    assert cost.clearance_m[0] == pytest.approx((12 - 0.5) * 0.025 - 0.1, abs=1e-6)
    assert cost.clearance_m[-1] == pytest.approx((10 - 0.5) * 0.025 - 0.1, abs=1e-6)
    beside = np.array([[20.5, 40.5], [22.5, 40.5]]) * 0.025
    assert cost_along(snapshot, beside, 0.4, 0.5).clearance_m[0] == pytest.approx(
        (30 - 0.5) * 0.025 - 0.4, abs=1e-6
    )


def test_line_of_sight_does_not_pass_under_an_obstacle_just_above_the_floor() -> None:
    occupancy = np.zeros((8, 64), np.int8)
    occupancy[:, 30] = 100
    low, high = np.full((2, 8, 64), 0.2, np.float32)
    high[:] = 1.0
    line = (0.1, 0.1, 0.1), (1.5, 0.1, 0.1)
    grid = GridSpec(0.025, 8, 64, (0, 0))
    assert not line_of_sight(grid, occupancy, low, high, *line)
    low[:] = 0.4
    assert line_of_sight(grid, occupancy, low, high, *line)


def test_older_frames_replace_the_newest_only_if_their_numbers_rise() -> None:
    order = FrameOrder(100)
    assert not any(order.record(seq) for seq in (5, 4, 3, 2, 1))
    assert [order.record(seq) for seq in (2, 3)] == [False, True]


def test_the_robots_own_epoch_is_accepted_after_a_later_one_of_another_sender() -> None:
    walk, maps = Walk(room(), epoch=5), EpochMaps(RULES, 0.2)
    maps.set_robot_world(WorldId("boot", 0))
    stranger = maps.map_for(walk.frame(2.0, 1.5, 0.0))
    walk.epoch = 0
    assert maps.map_for(walk.frame(2.0, 1.5, 0.0)) is not stranger
    assert maps.world == WorldId("boot", 0)


def test_a_rejected_world_of_another_sender_does_not_park_the_map_again() -> None:
    walk, maps = Walk(room()), EpochMaps(RULES, 0.2)
    own, later = (walk.frame(2.0, 1.5, 0.0) for _ in range(2))
    state = maps.map_for(own)
    walk.epoch = 5
    strange, again = (walk.frame(2.0, 1.5, 0.0) for _ in range(2))
    stranger = maps.map_for(strange)
    maps.set_robot_world(WorldId("boot", 0))
    assert maps.map_for(later) is state
    assert list(parked(maps).values()) == [stranger]
    with pytest.raises(Conflict, match="which is over"):
        maps.map_for(again)
    assert maps.current is state


def test_only_the_newest_parked_maps_are_kept() -> None:
    walk, maps = Walk(room()), EpochMaps(RULES, 0.2, most_parked=2)
    for walk.epoch in range(5):
        maps.map_for(walk.frame(2.0, 1.5, 0.0))
    assert list(parked(maps)) == [WorldId("boot", 2), WorldId("boot", 3)]


def test_floor_around_the_robot_counts_as_explored_up_to_obstacles() -> None:
    walk = Walk([*room(), Block((1.5, 0.5, 0), (1.6, 2.5, 1.0))])  # longer than that area
    state = EpochMap(RULES, (2.0, 1.5), 0.2)
    for frame in walk.look_around(2.0, 1.5):
        state.integrate_frame(frame)
    state.reset_search(SearchContext("now", (), {}))
    state.integrate_frame(walk.frame(2.0, 1.5, 0.0))
    searched, cell_of = state.published.explored_for_search, state.published.grid.cell_of
    seen = [bool(searched[cell_of(x, 1.5)]) for x in (1.75, 1.45)]
    assert seen == [True, False]


def test_a_refused_frame_of_another_epoch_parks_no_map() -> None:
    walk, maps = Walk(room()), EpochMaps(RULES, 0.2)
    state = maps.map_for(walk.frame(2.0, 1.5, 0.0))
    walk.epoch = 1
    frame = walk.frame(2.0, 1.5, 0.0)
    for broken in (
        dataclasses.replace(frame, T_world_cam=frame.T_world_cam + np.eye(4)[:, [3, 3, 3, 0]]),
        dataclasses.replace(frame, depth_m=frame.depth_m[:-1]),
    ):
        with pytest.raises(InvalidInput):
            maps.map_for(broken)
    assert maps.current is state
    assert not parked(maps)
    assert maps.map_for(frame) is not state


def test_an_observation_of_an_ended_search_parks_no_map() -> None:
    walk, maps = Walk(room()), EpochMaps(RULES, 0.2)
    maps.reset_search(SearchContext("now", (), {}))
    state = maps.map_for(walk.frame(2.0, 1.5, 0.0))
    walk.epoch = 1
    frame = walk.frame(2.0, 1.5, 0.0)
    ended, present = (Observation(frame, id, (), {}, "test") for id in ("ended", "now"))
    with pytest.raises(Conflict, match="search context 'ended'"):
        maps.map_for(frame, ended)
    assert maps.current is state
    assert not parked(maps)
    assert maps.map_for(frame, present) is not state


def test_obstacles_of_an_imported_map_have_enough_evidence_to_be_occupied() -> None:
    occupancy = np.array([[100, 0], [-1, 100]], np.int8)
    flat = np.zeros((2, 2), np.float32)
    (tile,) = ground_of(GridSpec(0.025, 2, 2, (0, 0)), 1, occupancy, flat, flat, flat).values()
    assert tile.evidence[:2, :2].tolist() == [[EVIDENCE, 0], [0, EVIDENCE]]
    assert OccupancyRules().occupied_evidence < EVIDENCE <= OccupancyRules().most_evidence
    assert tile.floor_seen[:2, :2].tolist() == [[0, 1], [0, 0]]
