"""Tests a world with realistic sensor noise and drift."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from helios_core.geometry import camera_on_base
from helios_core.robot import Forward, Pick, Turn
from helios_sim.episode_tracker import episode_of
from helios_sim.ground_truth_solver import GroundTruthSolver
from helios_sim.home import Home
from helios_sim.robot_model import CAMERA_HEIGHT_M
from helios_sim.sensor_noise import SENSORS, SensorErrorModel
from helios_sim.world import World


@pytest.fixture
def realistic(sim_home: Home) -> Iterator[World]:
    world = World(sim_home, episode_of(sim_home, 0), sensor=SENSORS["realistic"])
    yield world
    world.close()


def test_reported_poses_drift_together_and_the_truth_does_not(realistic: World, world: World):
    for k in range(24):
        for each in (realistic, world):
            assert each.act(Turn(math.pi / 6), f"turn-{k}").succeeded
            if k % 4 == 0:
                each.act(Forward(0.2), f"go-{k}")
    assert np.allclose(realistic.trajectory_m, world.trajectory_m, atol=1e-9)
    shot, state = realistic.capture(), realistic.state()
    assert np.array_equal(shot.T_world_base, state.T_world_base)
    expected = camera_on_base(shot.T_world_base, CAMERA_HEIGHT_M, state.tilt_rad)
    assert np.allclose(shot.T_world_cam, expected, atol=1e-6)
    off_m = np.linalg.norm(shot.T_world_base[:2, 3] - realistic.trajectory_m[-1])
    assert 1e-3 < off_m < 0.2
    assert np.allclose(realistic.T_estimated_true @ world.state().T_world_base, state.T_world_base)
    assert np.array_equal(world.T_estimated_true, np.eye(4))
    assert realistic.progress == world.progress
    exact = world.capture()
    truth, same = realistic.segmentation(shot.stamp_ns), world.segmentation(exact.stamp_ns)
    assert np.array_equal(truth.ids, same.ids)
    assert np.array_equal(same.T_world_cam, exact.T_world_cam)
    assert np.allclose(truth.T_world_cam, exact.T_world_cam, atol=1e-9)


def test_the_description_gives_the_depth_range_of_the_sensor(realistic: World, world: World):
    assert realistic.describe().max_depth_m == SENSORS["realistic"].max_depth_m
    depth_m, exact_m = realistic.capture().depth_m, world.capture().depth_m
    assert depth_m.max() <= realistic.describe().max_depth_m
    both = (depth_m > 0) & (exact_m > 0)
    assert both.mean() > 0.7
    assert 0 < np.median(np.abs(depth_m - exact_m)[both] / exact_m[both] ** 2) < 3e-3


def test_a_pick_point_is_relative_to_the_estimated_pose(sim_home: Home):
    sensor = SensorErrorModel("lost", drift_m=0.02)
    world = World(sim_home, episode_of(sim_home, 0), sensor=sensor)
    try:
        name = next(iter(world.tracker.targets.objects))
        assert GroundTruthSolver(world).approach(name)
        # The heading does not drift here: estimated and true pose differ only by a shift.
        dx, dy = world.state().T_world_base[:2, 3] - world.trajectory_m[-1]
        assert math.hypot(dx, dy) > 0.01
        x, y, z = (float(v) for v in world.position_m(name))
        above = z + 0.5 * next(t.size_m[2] for t in world.object_states() if t.name == name) + 0.149
        miss = world.act(Pick((x + 3 * dx, y + 3 * dy, above), "thing"), "miss")
        assert not miss.succeeded
        assert f"({x + 3 * dx:.2f}, {y + 3 * dy:.2f}, {above:.2f})" in miss.reason
        assert world.act(Pick((x + dx, y + dy, above), "thing"), "pick").succeeded
        assert world.held_name == name
    finally:
        world.close()
