"""Tests sensor noise and odometry drift: their size, and that they are reproducible."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core.geometry import Pinhole, invert, se2_to_se3
from helios_sim.odometry_drift import DriftingOdometry, moved
from helios_sim.sensor_noise import (
    SENSORS,
    SensorErrorModel,
    incidence_cos,
    sensed_color,
    sensed_depth,
    smear_kernel,
)

CAMERA = Pinhole(470.0, 470.0, 319.5, 239.5, 640, 480)
NONE, REALISTIC = SENSORS["none"], SENSORS["realistic"]
NOISE = SensorErrorModel("noise", inverse_depth_noise_per_m=1.425e-3)


def flat(z_m: float) -> np.ndarray:
    return np.full((480, 640), z_m, np.float32)


def test_the_sensor_model_none_changes_nothing():
    depth = flat(3.0)
    assert sensed_depth(depth, CAMERA, NONE, 1, 2) is depth
    color = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    assert sensed_color(color, NONE, 1, 2) is color


@pytest.mark.parametrize("z_m", [1.0, 2.0, 4.0])
def test_noise_grows_with_the_square_of_depth(z_m: float):
    errors = sensed_depth(flat(z_m), CAMERA, NOISE, 0, 5) - z_m
    assert errors.std() == pytest.approx(1.425e-3 * z_m**2, rel=0.1)
    assert abs(errors.mean()) < 0.1 * 1.425e-3 * z_m**2


def test_depth_errors_correlate_between_neighbours_and_not_at_a_distance():
    error = (sensed_depth(flat(2.0), CAMERA, NOISE, 0, 5) - 2.0) / (1.425e-3 * 4)
    assert 0.3 < np.mean(error[:, 1:] * error[:, :-1]) < 0.6
    assert abs(np.mean(error[:, 40:] * error[:, :-40])) < 0.05


def test_the_same_seed_and_stamp_give_the_same_image_and_others_do_not():
    one = sensed_depth(flat(2.0), CAMERA, REALISTIC, 7, 11)
    assert np.array_equal(one, sensed_depth(flat(2.0), CAMERA, REALISTIC, 7, 11))
    for seed, stamp_ns in ((7, 12), (8, 11)):
        assert not np.array_equal(one, sensed_depth(flat(2.0), CAMERA, REALISTIC, seed, stamp_ns))
    color = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    blurred = [sensed_color(color, REALISTIC, 7, stamp_ns) for stamp_ns in (11, 11, 12)]
    assert np.array_equal(blurred[0], blurred[1])
    assert not np.array_equal(blurred[0], blurred[2])


def test_depth_steps_grow_with_the_square_of_depth():
    steps = SensorErrorModel("steps", inverse_depth_step_per_m=2.85e-3)
    ramp = np.repeat(np.linspace(3.9, 4.1, 640, dtype=np.float32)[None], 480, 0)
    found = np.unique(sensed_depth(ramp, CAMERA, steps, 0, 0))
    assert np.diff(found) == pytest.approx(np.full(len(found) - 1, 2.85e-3 * 16), rel=0.1)


def test_depth_outside_the_range_is_not_measured():
    depth = np.concatenate([flat(z)[:120] for z in (0.2, 2.0, 7.0, 0.0)])
    exact = SensorErrorModel("range", min_depth_m=0.3, max_depth_m=6.0)
    sensed = sensed_depth(depth, CAMERA, exact, 0, 0)
    assert [sensed[row, 0] for row in (60, 180, 300, 420)] == [0.0, pytest.approx(2.0), 0.0, 0.0]


def test_an_edge_hides_pixels_of_the_surface_behind():
    depth = flat(3.0)
    depth[:, :320] = 1.5
    edges = SensorErrorModel("edges", edge_per_m=0.03, edge_px=2)
    lost = sensed_depth(depth, CAMERA, edges, 0, 0) == 0
    assert np.flatnonzero(lost[240]).tolist() == [320, 321]


def test_a_slanted_surface_does_not_count_as_an_edge():
    floor = _floor_depth()
    edges = SensorErrorModel("edges", edge_per_m=0.03, edge_px=2)
    assert not (sensed_depth(floor, CAMERA, edges, 0, 0)[floor > 0] == 0).any()


def _floor_depth() -> np.ndarray:
    """Depth of the floor for a level camera at 1.3 m; 0 at and above the horizon."""
    down = (np.arange(480) - CAMERA.cy) / CAMERA.fy
    z = np.divide(1.3, down, out=np.zeros(480), where=down > 0.15)
    return np.repeat(z.astype(np.float32)[:, None], 640, 1)


def test_the_angle_of_incidence_matches_the_plane():
    floor = _floor_depth()
    seen = np.zeros_like(floor)
    seen[floor > 0] = 1 / floor[floor > 0]
    cos = incidence_cos(seen, CAMERA)
    row, column = 400, 100
    ray = np.array([(column - CAMERA.cx) / CAMERA.fx, (row - CAMERA.cy) / CAMERA.fy, 1.0])
    assert cos[row, column] == pytest.approx(ray[1] / np.linalg.norm(ray), rel=1e-3)
    assert incidence_cos(np.full((480, 640), 0.5, np.float32), CAMERA)[240, 320] == pytest.approx(
        1.0, abs=1e-3
    )


def test_a_grazing_surface_is_not_measured():
    grazing = SensorErrorModel("grazing", grazing_cos=0.3)
    floor = _floor_depth()
    sensed = sensed_depth(floor, CAMERA, grazing, 0, 0)
    down = np.abs(np.arange(480) - CAMERA.cy) / CAMERA.fy
    assert (sensed[(down > 0.5) & (floor[:, 0] > 0), 320] > 0).all()
    assert (sensed[(down < 0.15)] == 0).all()
    low = (down > 0.16) & (down < 0.2) & (floor[:, 0] > 0)
    assert (sensed[low] == 0).mean() > 0.9


def test_motion_blur_keeps_brightness():
    for length_px, angle_rad in ((1.5, 0.0), (5.0, 0.4), (3.0, 1.6)):
        assert smear_kernel(length_px, angle_rad).sum() == pytest.approx(1.0)
    color = np.full((480, 640, 3), 77, np.uint8)
    assert (sensed_color(color, REALISTIC, 0, 3) == 77).all()


def drive(drift: DriftingOdometry, rounds: int) -> None:
    """Drive `rounds` squares of 1 m with full turns."""
    for k in range(4 * rounds):
        corner = (0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)
        (x, y), yaw = corner[k % 4], math.pi / 2 * (k % 4) + 2 * math.pi * (k // 4)
        drift.follow((x, y, yaw))
    drift.follow((0.0, 0.0, 2 * math.pi * rounds))


def test_without_drift_the_estimated_pose_is_the_true_pose():
    drift = DriftingOdometry(NONE, 0, (0.0, 0.0, 0.0))
    drift.follow((1.0, 2.0, 0.5))
    assert drift.estimated_pose == (1.0, 2.0, 0.5)
    assert np.array_equal(drift.T_estimated_true, np.eye(4))


def test_position_drift_is_a_random_walk_over_path_length():
    sensor = SensorErrorModel("drift", drift_m=0.01)
    ends = []
    for seed in range(200):
        drift = DriftingOdometry(sensor, seed, (0.0, 0.0, 0.0))
        drive(drift, 4)
        ends.append(drift.estimated_pose[:2])
    assert np.std(ends, axis=0) == pytest.approx([0.01 * math.sqrt(16)] * 2, rel=0.2)
    assert np.abs(np.mean(ends, axis=0)).max() < 0.01


def test_heading_drift_is_a_random_walk_over_turning():
    sensor = SensorErrorModel("drift", turn_drift_rad=0.01)
    yaws = []
    for seed in range(200):
        drift = DriftingOdometry(sensor, seed, (0.0, 0.0, 0.0))
        for k in range(1, 21):
            drift.follow((0.0, 0.0, 0.5 * k))
        yaws.append(drift.estimated_pose[2] - 10.0)
    assert np.std(yaws) == pytest.approx(0.01 * math.sqrt(10), rel=0.2)


def test_a_point_relative_to_the_estimated_base_maps_to_the_true_base():
    """A point 0.5 m ahead of the estimated base maps to 0.5 m ahead of the true base."""
    drift = DriftingOdometry(REALISTIC, 3, (0.0, 0.0, 0.0))
    drive(drift, 10)
    drift.follow((0.3, 0.2, 1.0))
    T_world_base, T_true = se2_to_se3(*drift.estimated_pose), se2_to_se3(0.3, 0.2, 1.0)
    ahead = np.array([0.5, 0.1, 0.8, 1.0])
    x, y, z, _ = T_world_base @ ahead
    assert np.allclose(drift.true_point_m((x, y, z)), (T_true @ ahead)[:3])
    assert np.allclose(drift.T_estimated_true @ T_true, T_world_base)
    assert not np.allclose(T_world_base, T_true, atol=1e-3)
    assert np.allclose(invert(drift.T_estimated_true) @ drift.T_estimated_true, np.eye(4))


def test_moved_gives_distance_and_turn_between_two_poses():
    assert moved((0.0, 0.0, 3.0), (3.0, 4.0, -3.0)) == pytest.approx((5.0, 2 * math.pi - 6.0))
