"""Tests that the robot's camera images agree with the true poses of objects."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.geometry import camera_on_base, lift_pixels, project
from helios_core.robot import Observe, Tilt, Turn
from helios_sim.episode_tracker import episode_of
from helios_sim.ground_truth_solver import GroundTruthSolver
from helios_sim.home import Home
from helios_sim.home.floor_plans import WALL_HALF_M
from helios_sim.past_frame_truth import MAX_STORED_CAPTURES
from helios_sim.renderer import metric_depth
from helios_sim.robot_model import CAMERA_HEIGHT_M, MAX_DEPTH_M
from helios_sim.sensor_noise import SENSORS
from helios_sim.world import World
from hypothesis import given
from hypothesis import strategies as st


@given(st.floats(0.05, 29.0))
def test_metric_depth_inverts_the_projection(z: float):
    near, far = 0.03, 30.0
    buffer = np.full((1, 1), (far * near / z - near) / (far - near), np.float32)
    depth = float(metric_depth(buffer, near, far, 10.0)[0, 0])
    if abs(z - 10.0) > 0.01:
        assert depth == pytest.approx(z if z < 10.0 else 0.0, rel=1e-4)


def look_around(world: World) -> list[tuple[np.ndarray, np.ndarray, dict[int, str]]]:
    """World points [h, w, 3], ids [h, w] and classes by id, for a full turn."""
    views = []
    for k in range(6):
        for half in range(2):
            assert world.act(Turn(math.pi / 6), f"look-{k}-{half}").succeeded
        shot = world.capture()
        truth = world.segmentation(shot.stamp_ns)
        points = lift_pixels(shot.depth_m, shot.camera, shot.T_world_cam)
        views.append((points, truth.ids, {i.id: i.class_name for i in truth.instances}))
    return views


def test_lifted_points_of_floor_and_walls_lie_on_their_planes(world: World, sim_home: Home):
    floor, wall = [], []
    for points, ids, classes in look_around(world):
        for id, name in classes.items():
            found = points[(ids == id) & np.isfinite(points[..., 0])]
            if name == "floor":
                floor.append(found)
            elif name == "wall":
                wall.append(found)
    heights = np.abs(np.concatenate(floor)[:, 2])
    assert len(heights) > 50_000
    assert np.quantile(heights, 0.999) < 0.01
    points = np.concatenate(wall)
    planes = [
        (axis, edge + side * WALL_HALF_M)
        for room in sim_home.rooms
        for axis, edges in ((0, (room.x0, room.x1)), (1, (room.y0, room.y1)))
        for edge in edges
        for side in (-1, 1)
    ]
    off = np.min([np.abs(points[:, axis] - at) for axis, at in planes], axis=0)
    assert len(points) > 50_000
    # The skirting board protrudes slightly from the wall, and door reveals cross it.
    assert np.quantile(off, 0.9) < 0.01


def test_objects_appear_at_their_true_positions(world: World, sim_home: Home):
    oracle = GroundTruthSolver(world)
    for thing in sim_home.objects[:4]:
        assert oracle.approach(thing.name)
        shot = world.capture()
        truth = world.segmentation(shot.stamp_ns)
        instance = next(i for i in truth.instances if i.name == thing.name)
        assert instance.graspable
        assert (instance.class_name, instance.on) == (thing.class_name, thing.receptacle)
        mask = truth.ids == instance.id
        center, radius_m = np.array(instance.center_m), np.linalg.norm(thing.size_m) / 2
        seen = lift_pixels(shot.depth_m, shot.camera, shot.T_world_cam)[mask]
        assert np.quantile(np.linalg.norm(seen - center, axis=1), 0.95) < radius_m + 0.01
        uv, z = project(center[None], shot.camera, shot.T_world_cam)
        v, u = np.nonzero(mask)
        away_px = np.hypot(u.mean() - uv[0, 0], v.mean() - uv[0, 1])
        assert away_px < shot.camera.fx * radius_m / z[0]


def test_the_camera_pose_follows_base_and_tilt(world: World):
    world.act(Tilt(0.7), "tilt")
    shot = world.capture()
    expected = camera_on_base(shot.T_world_base, CAMERA_HEIGHT_M, 0.7)
    assert np.allclose(shot.T_world_cam, expected, atol=1e-6)
    assert world.state().tilt_rad == pytest.approx(0.7)


def test_depth_is_in_metres_between_zero_and_the_maximum(world: World):
    world.act(Tilt(0.0), "level")
    depth_m = world.capture().depth_m
    assert depth_m.dtype == np.float32
    assert depth_m.min() >= 0
    assert depth_m.max() <= MAX_DEPTH_M


def test_stamps_rise_even_at_rest(world: World):
    stamps = [world.capture().stamp_ns for _ in range(3)]
    world.act(Observe(), "observe")
    stamps.append(world.capture().stamp_ns)
    assert stamps == sorted(set(stamps))


def test_the_segmentation_of_an_old_capture_does_not_change(world: World):
    shot = world.capture()
    before = world.segmentation(shot.stamp_ns).ids
    world.act(Turn(0.5), "turn")
    assert np.array_equal(world.segmentation(shot.stamp_ns).ids, before)
    assert not np.array_equal(world.segmentation(world.capture().stamp_ns).ids, before)


def test_a_stamp_without_a_stored_capture_is_refused(world: World):
    first = world.capture().stamp_ns
    with pytest.raises(InvalidInput, match="no capture with stamp 5"):
        world.segmentation(5)
    for _ in range(MAX_STORED_CAPTURES):
        world.capture()
    with pytest.raises(InvalidInput):
        world.segmentation(first)


def test_the_same_seed_gives_the_same_images(make_world: Callable[[], World]):
    a, b = make_world(), make_world()
    for world in (a, b):
        world.act(Turn(0.4), "turn")
    shot_a, shot_b = a.capture(), b.capture()
    assert np.array_equal(shot_a.color, shot_b.color)
    assert np.array_equal(shot_a.depth_m, shot_b.depth_m)
    assert shot_a.stamp_ns == shot_b.stamp_ns


@pytest.mark.parametrize("sensor", ["none", "realistic"])
def test_without_color_depth_and_ground_truth_are_the_same(sim_home: Home, sensor: str):
    colored, plain = (
        World(sim_home, episode_of(sim_home, 0), sensor=SENSORS[sensor], colored=colored)
        for colored in (True, False)
    )
    try:
        for k in range(4):
            shots = []
            for world in (colored, plain):
                world.act(Turn(0.9), f"turn {k}")
                shots.append(world.capture())
            a, b = shots
            assert a.stamp_ns == b.stamp_ns
            assert np.array_equal(a.depth_m, b.depth_m)
            assert np.array_equal(a.T_world_cam, b.T_world_cam)
            truth_a, truth_b = (
                world.segmentation(shot.stamp_ns)
                for world, shot in zip((colored, plain), shots, strict=True)
            )
            assert np.array_equal(truth_a.ids, truth_b.ids)
            assert truth_a.instances == truth_b.instances
            assert a.color.any()
            assert not b.color.any()
            assert np.array_equal(colored.color_image(), plain.color_image())
    finally:
        colored.close()
        plain.close()
