"""Transforms, poses of base and camera, and new origins: no ROS needed."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import helios_ros2.robot_input
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
from helios_ros2.offered_qos import Qos
from helios_ros2.pose_jumps import is_new_origin
from helios_ros2.poses import TfPoses, TopicPoses
from helios_ros2.robot_input import RobotInput
from helios_ros2.settings import Ros2Settings
from helios_ros2.topic_choice import RAW
from helios_ros2.topic_reader import TopicReader
from helios_ros2.transforms import Pose, Transforms, pose_of
from hypothesis import given
from hypothesis import strategies as st

from tests.unit.ros2.ros2_stage import CAMERA as CAMERA_FRAME
from tests.unit.ros2.ros2_stage import Graph, camera_info, transform

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
    there, back = (tf.at("map", CAMERA, int(at * S)), tf.at(CAMERA, "map", int(at * S)))
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


class Heard:
    """A robot whose odometry speaks, and whose TF has these frames; nothing names a camera."""

    def __init__(self, settings: Ros2Settings, *frames: tuple[str, str]) -> None:
        self.graph: Any = Graph()
        self.senses = RobotInput(self.graph, settings)
        found = [transform(parent, child, S) for parent, child in frames]
        if found:
            self.graph.handlers["/tf"](SimpleNamespace(transforms=found))
        self.senses._on_info("color", camera_info())
        T = transform("odom", "base_link", S).transform
        self.senses._on_pose(
            SimpleNamespace(
                header=SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0), frame_id="odom"),
                pose=SimpleNamespace(position=T.translation, orientation=T.rotation),
            )
        )

    def connect(self) -> str:
        """World frame of the poses."""
        self.senses.connect(0.01)
        return self.senses.world_frame


def test_tf_that_is_heard_is_waited_for_before_a_topic_takes_its_place(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    robot = Heard(Ros2Settings(), ("odom", "base_link"))
    with pytest.raises(Unavailable, match="connect"):
        robot.connect()
    monkeypatch.setattr(helios_ros2.robot_input, "TF_WITHIN_S", 0.0)
    assert robot.connect() == "odom"
    assert "TF is heard but does not help" in caplog.text


def test_without_tf_a_topic_is_taken_at_once() -> None:
    assert Heard(Ros2Settings()).connect() == "odom"


@pytest.mark.parametrize("named", [{"world_frame": "map"}, {"base_frame": "base"}])
def test_named_frames_are_waited_for(named: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(helios_ros2.robot_input, "TF_WITHIN_S", 0.0)
    robot = Heard(Ros2Settings(**named), ("odom", "base_link"))
    with pytest.raises(Unavailable):
        robot.connect()


def test_a_named_origin_is_that_of_the_map() -> None:
    frames = [("odom", "base_link"), ("base_link", CAMERA_FRAME)]
    assert Heard(Ros2Settings(), *frames).connect() == "odom"
    with pytest.raises(Unavailable, match="TF has no frame map"):
        Heard(Ros2Settings(origin="ground floor", pose="tf"), *frames).connect()
    known = Heard(Ros2Settings(origin="ground floor"), ("map", "odom"), *frames)
    assert known.connect() == "map"


def test_a_better_world_frame_that_comes_later_is_told_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    robot = Heard(Ros2Settings(), ("odom", "base_link"), ("base_link", CAMERA_FRAME))
    assert robot.connect() == "odom"
    for k in range(3):
        later = [transform("map", "odom", 2 * S + k)]
        robot.graph.handlers["/tf"](SimpleNamespace(transforms=later))
    assert robot.senses.world_frame == "odom"
    assert caplog.text.count("TF now has the frame map") == 1


def test_a_refused_message_is_the_fault_of_its_topic_and_is_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    graph: Any = Graph()
    graph.offered = lambda topic: [("sensor_msgs/msg/CameraInfo", Qos())]

    def refuse(_: object) -> None:
        raise InvalidInput("K is 0")

    reader = TopicReader(graph, lambda: "/camera_info", ("sensor_msgs/msg/CameraInfo",), refuse, 1)
    for _ in range(3):
        graph.handlers["/camera_info"](SimpleNamespace())
    assert reader.silence().message == "/camera_info (sensor_msgs/msg/CameraInfo, reliable): K is 0"
    assert caplog.text.count("K is 0") == 1


def test_static_transforms_are_kept_for_late_subscribers_whoever_else_publishes() -> None:
    graph: Any = Graph()
    taken: dict[str, Qos] = {}
    graph.offered = lambda topic: [("tf2_msgs/msg/TFMessage", q) for q in (Qos(True, True), Qos())]
    graph.subscribe = lambda topic, kind, handler, qos, depth: taken.update({topic: qos})
    RobotInput(graph, Ros2Settings())
    assert taken["/tf_static"].retained
    assert not taken["/tf"].retained


def test_a_second_camera_that_appears_before_the_connection_must_be_named() -> None:
    robot = Heard(Ros2Settings())
    assert robot.senses.color.topic == "/camera/color/image_raw"
    robot.graph.graph = lambda: {f"/{s}/color/image_raw": [RAW] for s in ("front", "rear")}
    with pytest.raises(Unavailable, match="/front/color/image_raw, /rear/color/image_raw"):
        robot.connect()
