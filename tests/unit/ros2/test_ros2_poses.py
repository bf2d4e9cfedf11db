"""Transforms, poses of base and camera, and new origins: no ROS needed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import (
    camera_on_base,
    quaternion_from_rotation,
    se2_to_se3,
    tilt_of,
    yaw_of,
)
from helios_ros2.pose_jumps import is_new_origin
from helios_ros2.poses import TfPoses, TopicPoses
from helios_ros2.settings import Ros2Settings
from helios_ros2.transforms import Pose, Transforms, pose_of
from hypothesis import given
from hypothesis import strategies as st

S = 1_000_000_000
CAMERA = "camera_color_optical_frame"
small = st.floats(-3, 3)


def pose(T: np.ndarray) -> Pose:
    return T[:3, 3], np.array(quaternion_from_rotation(T[:3, :3]))


def robot_tf(x0: float, x1: float, height_m: float = 0.0) -> Transforms:
    """map -> odom -> base_footprint (moves from x0 to x1 in 1 s) -> camera."""
    tf = Transforms()
    tf.add("map", "odom", 0, pose(se2_to_se3(1.0, 2.0, math.pi / 2)), is_static=True)
    for ns, x in ((0, x0), (S, x1)):
        base = se2_to_se3(x, 0.0, 0.0)
        base[2, 3] = height_m
        tf.add("odom", "/base_footprint", ns, pose(base))
    mount = camera_on_base(np.eye(4), 1.1, 0.4, 0.2)
    tf.add("base_footprint", CAMERA, 0, pose(mount), is_static=True)
    return tf


@given(small, small, st.floats(0, 1))
def test_a_pose_between_two_transforms_lies_on_the_line(x0: float, x1: float, at: float) -> None:
    tf = robot_tf(x0, x1)
    T = tf.at("odom", "base_footprint", int(at * S))
    assert T[0, 3] == pytest.approx(x0 + at * (x1 - x0), abs=1e-6)


@given(small, small, st.floats(0, 1))
def test_a_transform_and_its_reverse_are_inverse(x0: float, x1: float, at: float) -> None:
    tf = robot_tf(x0, x1)
    there, back = (
        tf.at("map", CAMERA, int(at * S)), tf.at(CAMERA, "map", int(at * S))
    )  # fmt: skip
    np.testing.assert_allclose(there @ back, np.eye(4), atol=1e-9)


def test_the_newest_time_is_that_of_the_slowest_frame_between() -> None:
    tf = robot_tf(0.0, 1.0)
    assert tf.newest_ns("map", "base_footprint") == S
    assert tf.newest_ns("base_footprint", CAMERA) == 0  # static


@pytest.mark.parametrize(
    ("frame", "child", "ns", "said"),
    [
        ("map", "arm", 0, "wanted one tree"),
        ("map", CAMERA, 9 * S, "one clock"),
    ],
)
def test_what_tf_does_not_know_is_said(frame: str, child: str, ns: int, said: str) -> None:
    with pytest.raises(Unavailable, match=said):
        robot_tf(0, 1).at(frame, child, ns)


def test_a_camera_that_tf_does_not_connect_gives_no_poses() -> None:
    tf = Transforms()
    tf.add("odom", "base_link", S, pose(np.eye(4)))
    with pytest.raises(Unavailable, match=f"no {CAMERA}"):
        TfPoses(Ros2Settings(), tf, CAMERA)


def test_a_circle_of_transforms_is_refused() -> None:
    tf = Transforms()
    tf.add("a", "b", 0, pose(np.eye(4)))
    tf.add("b", "a", 0, pose(np.eye(4)))
    with pytest.raises(Unavailable, match="circle"):
        tf.at("a", "b", 0)


def test_a_clock_that_goes_back_forgets_the_time_before() -> None:
    tf = Transforms()
    assert tf.add("odom", "base_link", 100 * S, pose(se2_to_se3(5, 0, 0)))
    assert not tf.add("odom", "base_link", 3 * S, pose(se2_to_se3(0, 0, 0)))
    assert tf.newest_ns("odom", "base_link") == 3 * S


class Numbers:
    def __init__(self, **values: float) -> None:
        self.__dict__.update(values)


def test_numbers_that_are_no_pose_are_refused() -> None:
    at, turned = Numbers(x=0, y=0, z=0), Numbers(x=0, y=0, z=0, w=0)
    with pytest.raises(InvalidInput, match="is no pose"):
        pose_of(at, turned)


def test_poses_by_tf_choose_map_and_base_footprint_and_know_the_mount() -> None:
    poses = TfPoses(Ros2Settings(), robot_tf(0.0, 1.0), CAMERA)
    assert poses.world_frame == "map"
    base, camera = poses.base(S), poses.camera(S)
    np.testing.assert_allclose(base[:2, 3], [1.0, 3.0], atol=1e-9)
    assert yaw_of(base) == pytest.approx(math.pi / 2)
    expected = camera_on_base(base, 1.1, 0.4, 0.2)
    np.testing.assert_allclose(camera, expected, atol=1e-9)


def test_a_drifting_height_of_the_base_is_dropped_unless_it_is_wanted() -> None:
    level = TfPoses(Ros2Settings(), robot_tf(0, 1, 0.3), CAMERA)
    free = TfPoses(Ros2Settings(level=False), robot_tf(0, 1, 0.3), CAMERA)
    assert level.camera(S)[2, 3] == pytest.approx(1.1)
    assert free.camera(S)[2, 3] == pytest.approx(1.4)


def test_poses_of_a_topic_use_the_mount_of_the_settings() -> None:
    settings = Ros2Settings(camera_height_m=0.9, camera_forward_m=0.1)
    poses = TopicPoses(settings, lambda: 0.3)
    with pytest.raises(Unavailable, match="/odom"):
        poses.newest_ns()
    poses.track.add(0, pose(se2_to_se3(1, 1, 0)))
    camera = poses.camera(0)
    np.testing.assert_allclose(camera[:3, 3], [1.1, 1.0, 0.9], atol=1e-9)
    assert tilt_of(camera) == pytest.approx(0.3)


@given(st.floats(0, 2), st.floats(0, 1.5))
def test_driving_begins_no_new_world(seconds: float, speed_m_s: float) -> None:
    after = se2_to_se3(seconds * speed_m_s, 0, 0)
    assert not is_new_origin(np.eye(4), 0, after, int(seconds * S), 0.5)


def test_a_jump_or_a_clock_that_goes_back_begins_a_new_world() -> None:
    assert is_new_origin(np.eye(4), 0, se2_to_se3(2, 0, 0), S // 50, 0.5)
    assert is_new_origin(np.eye(4), 100 * S, np.eye(4), 3 * S, 0.5)
