"""Messages of the robot with impossible content: only what is wrong is left out, and said once."""

from __future__ import annotations

import logging
import math
from types import SimpleNamespace
from typing import Any

import pytest
from helios_ros2.offered_qos import Qos
from helios_ros2.robot_input import RobotInput
from helios_ros2.settings import Ros2Settings
from helios_ros2.topic_reader import TopicReader

from tests.unit.ros2.ros2_stage import CAMERA, MS, Graph, transform

UNSET = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=0.0)
JOINT = "head"


def tf(*transforms: SimpleNamespace) -> SimpleNamespace:
    return SimpleNamespace(transforms=list(transforms))


def without_orientation(parent: str, child: str) -> SimpleNamespace:
    """A transform whose orientation nobody has set."""
    made = transform(parent, child, 0)
    made.transform.rotation = UNSET
    return made


@pytest.mark.parametrize("is_static", [True, False])
def test_a_wrong_transform_hides_none_of_the_others_of_its_message(
    is_static: bool, caplog: pytest.LogCaptureFixture
) -> None:
    graph: Any = Graph()
    senses = RobotInput(graph, Ros2Settings(pose="tf"))
    message = tf(
        transform("base_link", "camera_link", 0),
        without_orientation("base_link", "gps"),
        transform("camera_link", CAMERA, 0),
    )
    with caplog.at_level(logging.WARNING):
        for _ in range(50):
            senses._on_tf(message, is_static)
    assert senses._tf.frames_between("base_link", CAMERA) == {"camera_link", CAMERA}
    assert not senses._tf.knows("gps")
    [said] = caplog.messages
    assert "that of gps in base_link" in said
    assert "orientation [0.0, 0.0, 0.0, 0.0]" in said


def test_a_clock_that_went_back_is_seen_beside_a_wrong_transform() -> None:
    graph: Any = Graph()
    senses = RobotInput(graph, Ros2Settings(pose="tf", world_frame="odom"))
    senses._on_tf(tf(transform("base_link", CAMERA, 0)), True)
    senses._info_frames["color"] = CAMERA
    senses._on_tf(tf(transform("odom", "base_link", 100_000 * MS)), False)
    senses._poses = senses._choose(0.0)
    senses._on_tf(tf(transform("odom", "base_link", 100_020 * MS)), False)
    back = tf(transform("odom", "base_link", 20 * MS), without_orientation("base_link", "gps"))
    senses._on_tf(back, False)
    assert senses.world_epoch == 1


class Joints:
    """The reader of a head's joint, as its topic calls it."""

    def __init__(self) -> None:
        graph: Any = Graph()
        self.senses = RobotInput(graph, Ros2Settings(tilt="/t", tilt_joint=JOINT, pose="topic"))

    def come(self, names: list[str], angles_rad: list[float]) -> None:
        stamp = SimpleNamespace(sec=1, nanosec=0)
        header = SimpleNamespace(stamp=stamp, frame_id="")
        message = SimpleNamespace(header=header, name=names, position=angles_rad)
        self.senses._joints._on_message(message)


@pytest.mark.parametrize("angles_rad", [[], [0.1], [0.1, math.nan], [0.1, math.inf]])
def test_a_joint_state_without_the_joints_angle_keeps_the_angle_before_and_is_said_once(
    angles_rad: list[float], caplog: pytest.LogCaptureFixture
) -> None:
    joints = Joints()
    joints.come(["arm", JOINT], [0.1, 0.4])
    with caplog.at_level(logging.WARNING):
        for _ in range(50):
            joints.come(["arm", JOINT], angles_rad)
            joints.come(["arm"], [0.1])
    assert joints.senses.tilt_rad() == pytest.approx(0.4)
    [said] = caplog.messages
    assert f"the joint {JOINT} has no angle" in said


def test_no_message_of_a_topic_ends_the_nodes_spin_and_the_fault_is_said_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    handled = list[int]()
    ros: Any = SimpleNamespace(every=lambda *_: None)

    def handle(message: Any) -> None:
        handled.append(message.value[0])

    reader = TopicReader(ros, lambda: "/x", ("x/msg/X",), handle, 1)
    reader._taken = ("/x", "x/msg/X", Qos())
    with caplog.at_level(logging.WARNING):
        for _ in range(50):
            reader._on_message(SimpleNamespace(value=[]))
    [said] = caplog.messages
    assert "it could not be read (IndexError: list index out of range)" in said
    assert "IndexError: list index" in reader.silence().message
    reader._on_message(SimpleNamespace(value=[3]))
    assert handled == [3]
    assert "IndexError" not in reader.silence().message
