"""Transforms obey the group laws, and lifting pixels inverts the camera's projection."""

from __future__ import annotations

import math

import numpy as np
from helios_core.geometry import (
    Pinhole,
    camera_on_base,
    invert,
    is_rigid,
    lift_pixels,
    project,
    quaternion_from_rotation,
    rotation_from_quaternion,
    se2_to_se3,
    wrap_angle,
    yaw_of,
)
from hypothesis import given
from hypothesis import strategies as st

angles = st.floats(-math.pi, math.pi)
lengths = st.floats(-10, 10)
CAMERA = Pinhole(50.0, 55.0, 32.0, 24.0, 64, 48)


@given(lengths, lengths, angles)
def test_inverse_undoes_transform(x: float, y: float, yaw: float) -> None:
    T = camera_on_base(se2_to_se3(x, y, yaw), 1.3, 0.5)
    assert is_rigid(T)
    np.testing.assert_allclose(invert(T) @ T, np.eye(4), atol=1e-12)


@given(angles)
def test_the_yaw_of_a_base_pose_round_trips(yaw: float) -> None:
    assert abs(wrap_angle(yaw_of(se2_to_se3(1, 2, yaw)) - yaw)) < 1e-9


@given(st.floats(-50, 50))
def test_wrapped_angles_point_in_the_same_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-9)


@given(angles, st.floats(-1.4, 1.4))
def test_a_rotation_round_trips_through_a_quaternion(yaw: float, tilt: float) -> None:
    R = camera_on_base(se2_to_se3(0, 0, yaw), 1.0, tilt)[:3, :3]
    np.testing.assert_allclose(rotation_from_quaternion(*quaternion_from_rotation(R)), R, atol=1e-9)


@given(angles, st.floats(0, 1.2))
def test_a_lifted_pixel_projects_to_itself(yaw: float, tilt: float) -> None:
    T = camera_on_base(se2_to_se3(1, -2, yaw), 1.31, tilt)
    depth = np.random.default_rng(0).uniform(0.3, 5, (48, 64)).astype(np.float32)
    uv, z = project(lift_pixels(depth, CAMERA, T).reshape(-1, 3), CAMERA, T)
    v, u = np.mgrid[0:48, 0:64]
    np.testing.assert_allclose(uv, np.stack([u.ravel(), v.ravel()], 1), atol=1e-6)
    np.testing.assert_allclose(z, depth.ravel(), atol=1e-6)


def test_pixels_without_depth_lift_to_nan() -> None:
    assert np.isnan(lift_pixels(np.zeros((48, 64), np.float32), CAMERA, np.eye(4))).all()


def test_a_camera_that_looks_down_sees_the_floor_ahead() -> None:
    T = camera_on_base(np.eye(4), 1.0, math.pi / 4)
    on_floor = T[:3, 3] + math.sqrt(2) * T[:3, 2]
    np.testing.assert_allclose(on_floor, [1.0, 0.0, 0.0], atol=1e-12)
