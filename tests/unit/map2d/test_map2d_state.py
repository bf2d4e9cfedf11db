"""The 2D map of one world epoch: refused input, searches and published versions."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from helios_core.errors import Conflict, HeliosError, InvalidInput
from helios_core.types import Frame, Observation, SearchContext
from helios_map2d.epoch_map import EpochMap
from helios_map2d.epochs import EpochMaps
from helios_map2d.grid import Box
from helios_map2d.layers.parameters import MapRules
from helios_map2d.snapshots.snapshot import decode_npz, encode_npz
from map2d_kept import parked
from map2d_scene import Block, Walk, room, table

RULES = MapRules(size_cells=400)


def context(name: str) -> SearchContext:
    return SearchContext(id=name, classes=(), prompts={"pick": "a mug", "place": "a counter"})


def observation_of(frame: Frame, context_id: str, **scores: float) -> Observation:
    return Observation(frame, context_id, (), scores, "test")


def map_after_looking_around(walk: Walk) -> EpochMap:
    state = EpochMap(RULES, (2.0, 1.5), 0.2)
    state.reset_search(context("first"))
    for frame in walk.look_around(2.0, 1.5):
        state.integrate_frame(frame)
        state.integrate_values(observation_of(frame, "first", pick=0.4, place=0.2))
    return state


def open_room() -> Walk:
    """A room with a doorway of 1 m in its right wall, and a table."""
    walls = room()
    walls[3:] = [Block((4.0, 0, 0), (4.1, 1.0, 2.5)), Block((4.0, 2.0, 0), (4.1, 3.0, 2.5))]
    return Walk([*walls, *table(2.5, 2.4)])


def test_the_doorway_of_a_room_is_a_reachable_frontier_with_values() -> None:
    state = map_after_looking_around(open_room())
    found = state.published.frontiers
    beyond = [f for f in found if f.centre_m[0] > 3.5]
    assert beyond
    assert beyond[0].reachable
    assert beyond[0].values["pick"] == pytest.approx(0.4, abs=1e-3)
    assert beyond[0].values["place"] == pytest.approx(0.2, abs=1e-3)
    # The near blind zone around the robot is not a frontier.
    assert all(math.hypot(f.centre_m[0] - 2.0, f.centre_m[1] - 1.5) > 0.9 for f in found)


def test_a_frontiers_value_follows_its_layer() -> None:
    walk = open_room()
    state = map_after_looking_around(walk)
    (doorway,) = (f for f in state.published.frontiers if f.centre_m[0] > 3.5)
    for _ in range(6):
        state.integrate_values(observation_of(walk.frame(2.0, 1.5, 0.0), "first", pick=0.9))
    (now,) = (f for f in state.published.frontiers if f.id == doorway.id)
    assert now.values["pick"] > 0.7
    assert now.values["place"] == doorway.values["place"]


def test_a_new_search_clears_the_explored_area_and_keeps_the_occupancy() -> None:
    walk = open_room()
    state = map_after_looking_around(walk)
    before = state.published
    assert state.reset_search(context("second"))
    after = state.published
    assert after.frontiers == ()
    assert not after.explored_for_search.any()
    assert not any(layer.any() for layer in after.values.values())
    assert (after.occupancy == 100).sum() == (before.occupancy == 100).sum()
    state.integrate_frame(walk.frame(2.0, 1.5, math.pi / 2))
    assert state.published.frontiers  # a mapped room must be explored again
    assert not state.reset_search(context("second"))  # the same context changes nothing
    assert state.published.frontiers


def test_an_observation_of_another_context_is_refused() -> None:
    walk = open_room()
    state = map_after_looking_around(walk)
    with pytest.raises(Conflict, match="'old'"):
        state.integrate_values(observation_of(walk.frame(2, 1.5, 0), "old", pick=1.0))


def test_scores_of_layers_that_the_search_does_not_have_are_refused_and_take_no_memory() -> None:
    walk = open_room()
    state = map_after_looking_around(walk)
    layers = set(state.stack.values.layers)
    more = {f"layer {n}": 0.5 for n in range(20)}
    with pytest.raises(InvalidInput, match="20 layers that this search does not have"):
        state.integrate_values(observation_of(walk.frame(2, 1.5, 0), "first", pick=0.5, **more))
    assert set(state.stack.values.layers) == layers


def test_a_frame_sent_twice_is_integrated_once() -> None:
    walk = open_room()
    state = map_after_looking_around(walk)
    frame = walk.frame(2.0, 1.5, 0.0)
    assert state.integrate_frame(frame)
    version = state.published.version
    assert not state.integrate_frame(frame)
    assert state.integrate_values(observation_of(frame, "first", pick=0.9))
    assert not state.integrate_values(observation_of(frame, "first", pick=0.9))
    assert state.published.version == version + 1


def test_a_late_stream_frame_is_refused_and_a_late_keyframe_is_integrated() -> None:
    walk = open_room()
    late, late_key = walk.frame(2, 1.5, 0, keyframe=False), walk.frame(2, 1.5, 0.2)
    state = map_after_looking_around(walk)
    pose, newest = state.published.robot_pose, state.published.frame_id
    with pytest.raises(Conflict, match="older"):
        state.integrate_frame(late)
    assert state.integrate_frame(late_key)
    assert state.published.robot_pose == pose  # the newest frame sets the robot pose
    assert state.published.frame_id == newest


def broken_frames() -> list[tuple[str, Frame]]:
    frame = Walk(room()).frame(2.0, 1.5, 0.0)
    nan_pose = frame.T_world_cam.copy()
    nan_pose[0, 3] = np.nan
    scaled = frame.T_world_cam.copy()
    scaled[:3, :3] *= 1.1
    far = frame.T_world_base.copy()
    far[0, 3] = 500.0
    far_cam = frame.T_world_cam.copy()
    far_cam[1, 3] = -500.0
    change = dataclasses.replace
    return [
        ("NaN", change(frame, T_world_cam=nan_pose)),
        ("rigid", change(frame, T_world_cam=scaled)),
        ("the camera is at", change(frame, T_world_base=far)),
        ("the camera is at", change(frame, T_world_cam=far_cam)),
        ("calibration", change(frame, depth_m=frame.depth_m[:-1])),
        ("float32", change(frame, depth_m=frame.depth_m.astype(np.uint16))),
        ("focal", change(frame, camera=dataclasses.replace(frame.camera, fx=0.0))),
    ]


@pytest.mark.parametrize(("reason", "frame"), broken_frames())
def test_an_invalid_frame_is_refused_with_the_reason_and_changes_nothing(
    reason: str, frame: Frame
) -> None:
    state = EpochMap(RULES, (2.0, 1.5), 0.2)
    before = state.published
    with pytest.raises(InvalidInput, match=reason):
        state.integrate_frame(frame)
    with pytest.raises(HeliosError):
        state.integrate_values(observation_of(frame, "", pick=0.3))
    assert state.published is before
    assert (state.stack.occupancy.occupancy == -1).all()


def test_a_frame_from_far_away_is_refused_and_the_next_frame_is_integrated() -> None:
    walk = open_room()
    state = map_after_looking_around(walk)
    before = state.published
    with pytest.raises(InvalidInput, match="must begin a new world epoch"):
        state.integrate_frame(walk.frame(302.0, 1.5, 0.0))
    assert state.published is before
    assert state.integrate_frame(walk.frame(2.1, 1.5, 0.0))


def test_a_huge_frame_number_of_another_sender_does_not_freeze_the_robot_pose() -> None:
    walk = open_room()
    state = map_after_looking_around(walk)
    stranger = walk.frame(1.0, 1.0, 0.0)
    huge = dataclasses.replace(stranger.id, seq=2**63)
    assert state.integrate_frame(dataclasses.replace(stranger, id=huge))
    for x in (2.2, 2.4, 2.6):
        state.integrate_frame(walk.frame(x, 1.5, 0.0))
    assert state.published.robot_pose == pytest.approx((2.6, 1.5, 0.0))
    assert state.integrate_frame(walk.frame(2.8, 1.5, 0.0, keyframe=False))


def test_a_published_version_never_changes() -> None:
    walk = open_room()
    state = map_after_looking_around(walk)
    snapshot = state.published
    copy = snapshot.occupancy.copy()
    walk.blocks = room()
    for frame in walk.look_around(2.0, 1.5):
        state.integrate_frame(frame)
    assert (snapshot.occupancy == copy).all()
    assert state.published.version > snapshot.version
    with pytest.raises(ValueError, match="read-only"):
        snapshot.occupancy[0, 0] = 1


def test_a_published_version_contains_the_complete_map_state() -> None:
    walk = Walk(open_room().blocks, noise_at_1_m=0.01, outliers=0.02)
    state = EpochMap(RULES, (2.0, 1.5), 0.2)
    for x in (1.0, 1.2, 1.4, 1.6, 1.8):  # over cells with evidence from noise
        for yaw in (0.0, 2.0, 4.0):
            state.integrate_frame(walk.frame(x, 1.5, yaw))
    layer, grid = state.stack.occupancy, state.stack.grid
    assert len(state.published.ground) > 10
    for place, tile in state.published.ground.items():
        at = grid.to_local(Box.of_tile(place)).slices
        np.testing.assert_array_equal(tile.occupancy, layer.occupancy[at])
        np.testing.assert_array_equal(tile.evidence, layer.evidence[at])
        np.testing.assert_array_equal(tile.floor_seen, layer.floor_seen[at])
        np.testing.assert_array_equal(tile.searched, state.stack.search.explored[at])
        stands = tile.occupancy == 100
        np.testing.assert_array_equal(tile.z_high_m[stands], layer.z_high_m[at][stands])


def test_snapshot_coordinates_are_world_coordinates() -> None:
    snapshot = map_after_looking_around(open_room()).published
    assert snapshot.occupancy.shape == snapshot.grid.shape
    row, column = snapshot.grid.cell_of(0.0 - 0.01, 1.5)
    assert 100 in snapshot.occupancy[row, max(0, column - 2) : column + 3]
    assert snapshot.occupancy[snapshot.grid.cell_of(0.7, 1.5)] == 0
    assert snapshot.robot_pose is not None
    assert snapshot.robot_pose[:2] == pytest.approx((2.0, 1.5))


def test_a_snapshot_round_trips_through_npz() -> None:
    snapshot = map_after_looking_around(open_room()).published
    again = decode_npz(encode_npz(snapshot))
    for field in dataclasses.fields(snapshot):
        one, other = getattr(snapshot, field.name), getattr(again, field.name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other)
        elif field.name in ("ground", "layers"):
            continue  # compared by content below
        elif field.name == "frontiers":
            assert [(f.id, f.centre_m, f.size_m, f.reachable) for f in one] == [
                (f.id, f.centre_m, f.size_m, f.reachable) for f in other
            ]
            for f, g in zip(one, other, strict=True):
                np.testing.assert_array_equal(f.cells, g.cells)
                assert dict(f.values) == dict(g.values)
        else:
            assert one == other
    for name in ("occupancy", "explored_for_search", "z_low_m", "z_high_m"):
        np.testing.assert_array_equal(getattr(snapshot, name), getattr(again, name))
    assert list(snapshot.values) == list(again.values) == ["pick", "place"]
    for name in snapshot.values:
        np.testing.assert_array_equal(snapshot.values[name], again.values[name])
        np.testing.assert_array_equal(snapshot.confidences[name], again.confidences[name])


@pytest.mark.parametrize(
    "data",
    [b"", b"no zip", encode_npz(EpochMap(RULES, (0, 0), 0).published)[:90]],
    ids=["empty", "no zip", "cut"],
)
def test_data_that_is_not_a_snapshot_is_refused(data: bytes) -> None:
    with pytest.raises(InvalidInput, match="no map snapshot"):
        decode_npz(data)


def test_a_new_world_epoch_parks_the_map_and_starts_an_empty_one_in_the_same_search() -> None:
    walk = open_room()
    maps = EpochMaps(RULES, 0.2)
    maps.reset_search(context("first"))
    first = maps.map_for(walk.frame(2.0, 1.5, 0.0))
    old_frame = walk.frame(2.0, 1.5, 0.0)
    assert first.integrate_frame(old_frame)
    walk.epoch = 1
    second = maps.map_for(walk.frame(3.0, 1.5, 0.0))
    assert second is not first
    assert second.context_id == "first"
    assert list(parked(maps).values()) == [first]
    assert second.published.empty
    with pytest.raises(Conflict, match="which is over"):
        maps.map_for(old_frame)


def test_frames_of_an_earlier_start_or_world_epoch_are_refused() -> None:
    walk, maps = open_room(), EpochMaps(RULES, 0.2)
    old = walk.frame(2.0, 1.5, 0.0)
    maps.map_for(old)
    new = dataclasses.replace(old, id=dataclasses.replace(old.id, robot_boot_id="later"))
    second = maps.map_for(new)
    with pytest.raises(Conflict, match="which is over"):
        maps.map_for(old)
    assert maps.map_for(new) is second
    third, unseen = (dataclasses.replace(new.id, world_epoch=epoch) for epoch in (5, 3))
    maps.map_for(dataclasses.replace(new, id=third))
    with pytest.raises(Conflict, match="which is over"):
        maps.map_for(dataclasses.replace(new, id=unseen))


def test_line_of_sight_is_blocked_by_a_wall_and_passes_over_a_table() -> None:
    snapshot = map_after_looking_around(open_room()).published
    eye = (2.0, 1.0, 1.31)
    assert snapshot.line_of_sight(eye, (2.5, 2.7, 0.9))
    assert snapshot.line_of_sight(eye, (0.1, 1.0, 1.0))
    assert not snapshot.line_of_sight(eye, (-1.0, 1.0, 1.0))  # behind the wall
    assert not snapshot.line_of_sight((2.5, 1.0, 0.70), (2.5, 3.0, 0.70))  # through the table top
    assert snapshot.line_of_sight((2.5, 1.0, 0.4), (2.5, 3.0, 0.4))  # under the table top
    assert snapshot.line_of_sight(eye, (2.5, 2.4, 0.75))  # an object on the table
    assert snapshot.line_of_sight((2e4, 0, 1), (-2e4, 1e4, 1)) in (True, False)
    with pytest.raises(InvalidInput, match="within"):
        snapshot.line_of_sight(eye, (1e20, 1.0, 1.0))
    with pytest.raises(InvalidInput, match="finite"):
        snapshot.line_of_sight(eye, (math.nan, 0, 0))
