"""Names and bytes of rmw_zenoh, against examples of its issues and design page."""

from __future__ import annotations

import numpy as np
from helios_ros2.offered_qos import Qos
from helios_ros2.zenoh_node import Messages
from helios_ros2.zenoh_wire import (
    PUBLISHER,
    SUBSCRIPTION,
    Endpoint,
    attachment,
    data_key,
    endpoint_of,
    endpoint_token,
    node_token,
    ros_type,
    wire_type,
)
from hypothesis import given
from hypothesis import strategies as st

STRING = "std_msgs/msg/String"
HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
WORD = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)


def test_the_key_and_the_token_of_a_chatter_are_those_that_rmw_zenoh_shows() -> None:
    assert Messages().hash_of(STRING) == HASH
    key = f"0/chatter/std_msgs::msg::dds_::String_/{HASH}"
    assert data_key(0, "/chatter", STRING, HASH) == key
    named = f"%chatter/std_msgs::msg::dds_::String_/{HASH}"
    token = f"@ros2_lv/0/1a2b/0/10/MP/%/%/talker/{named}/::,7:,:,:,,"
    assert endpoint_of(token) == Endpoint(PUBLISHER, "/chatter", STRING, HASH, Qos())


@given(st.sampled_from([PUBLISHER, SUBSCRIPTION]), WORD, WORD, st.booleans(), st.booleans())
def test_a_token_says_again_what_it_was_made_of(
    kind: str, one: str, two: str, reliable: bool, retained: bool
) -> None:
    end = Endpoint(kind, f"/{one}/{two}", STRING, HASH, Qos(reliable, retained))
    assert endpoint_of(endpoint_token(3, "1a2b", 7, "helios", end)) == end


@given(st.text())
def test_any_other_token_is_left_out(token: str) -> None:
    assert endpoint_of(token) is None
    assert endpoint_of(node_token(0, "1a2b", "helios")) is None


@given(WORD, st.sampled_from(["msg", "srv"]), WORD)
def test_the_name_of_a_type_has_a_reverse(package: str, part: str, short: str) -> None:
    name = f"{package}/{part}/{short}"
    assert ros_type(wire_type(name)) == name


def test_the_attachment_has_33_bytes() -> None:
    out = attachment(1, 2, bytes(range(16)))
    assert len(out) == 33
    assert out[:17] == bytes([1, *7 * [0], 2, *7 * [0], 16])


def test_messages_are_made_with_zeros_and_survive_the_wire() -> None:
    messages = Messages()
    kind = "sensor_msgs/msg/CameraInfo"
    info = messages.maker(kind)(width=640, k=[1.0] * 9, d=[0.5])
    again = messages.read(messages.written(info, kind), kind)
    assert (again.width, again.height, again.header.frame_id) == (640, 0, "")
    np.testing.assert_array_equal(again.d, [0.5])
    np.testing.assert_array_equal(again.r, np.zeros(9))
    point = messages.maker("trajectory_msgs/msg/JointTrajectoryPoint")(positions=[0.25])
    trajectory = messages.maker("trajectory_msgs/msg/JointTrajectory")(
        joint_names=["head"], points=[point]
    )
    kind = "trajectory_msgs/msg/JointTrajectory"
    assert messages.read(messages.written(trajectory, kind), kind).points[0].positions[0] == 0.25
