"""Pairing of images, choice of topics and of quality of service: no ROS needed."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from helios_core.errors import Unavailable
from helios_ros2.image_pairs import MOST_WAITING, ImagePairs
from helios_ros2.offered_qos import Qos, matching
from helios_ros2.robot_clock import RobotClock
from helios_ros2.topic_choice import (
    BATTERY,
    COMPRESSED,
    RAW,
    battery_topic,
    color_topic,
    depth_topic,
    info_beside,
)
from helios_ros2.topic_reader import newest_stamp_ns
from hypothesis import given
from hypothesis import strategies as st

MS = 1_000_000
REALSENSE = {
    "/camera/camera/color/image_raw": [RAW],
    "/camera/camera/color/image_raw/compressed": [COMPRESSED],
    "/camera/camera/depth/image_rect_raw": [RAW],
    "/camera/camera/aligned_depth_to_color/image_raw": [RAW],
    "/camera/camera/infra1/image_rect_raw": [RAW],
    "/helios/value/pick": [RAW],
    "/odom": ["nav_msgs/msg/Odometry"],
}
TURTLEBOT = {
    "/oakd/rgb/preview/image_raw": [RAW],
    "/oakd/rgb/preview/depth": [RAW],
    "/tf": ["x"],
}


@given(
    st.lists(st.integers(0, 40), min_size=1, unique=True),
    st.lists(st.integers(0, 40), min_size=1, unique=True),
    st.integers(0, 30),
)
def test_every_pair_lies_within_the_limit_and_stamps_never_fall(
    color: list[int], depth: list[int], within_ms: int
) -> None:
    pairs, last_ns = ImagePairs(within_ms / 1000), -1
    arriving = sorted([(ms, "c") for ms in color] + [(ms, "d") for ms in depth])
    for ms, kind in arriving:
        add = pairs.add_color if kind == "c" else pairs.add_depth
        pair = add(ms * MS, ms)
        if pair is None:
            continue
        assert pair.stamp_ns == pair.color * MS
        assert abs(pair.color - pair.depth) <= within_ms
        assert pair.stamp_ns >= last_ns
        last_ns = pair.stamp_ns


def test_images_with_equal_stamps_are_paired_in_any_order_of_arrival() -> None:
    for order in ("cd", "dc"):
        pairs = ImagePairs(0.0)
        adds = {"c": pairs.add_color, "d": pairs.add_depth}
        assert adds[order[0]](5, "first") is None
        assert adds[order[1]](5, "second") is not None


def test_unpaired_images_are_forgotten() -> None:
    pairs = ImagePairs(0.01)
    for i in range(3 * MOST_WAITING):
        assert pairs.add_color(i * 100 * MS, i) is None
    assert pairs.add_depth(0, "late") is None


@pytest.mark.parametrize(
    ("graph", "color", "depth"),
    [
        (
            REALSENSE,
            "/camera/camera/color/image_raw",
            "/camera/camera/aligned_depth_to_color/image_raw",
        ),
        (TURTLEBOT, "/oakd/rgb/preview/image_raw", "/oakd/rgb/preview/depth"),
    ],
)
def test_the_topics_of_common_cameras_are_found(
    graph: dict[str, list[str]], color: str, depth: str
) -> None:
    assert color_topic(graph, "") == color
    assert depth_topic(graph, "") == depth


def test_a_named_topic_needs_no_search() -> None:
    assert color_topic({}, "/mine") == "/mine"


@pytest.mark.parametrize(
    ("graph", "said"),
    [
        ({}, "nobody publishes an image"),
        ({"/left/color/image_raw": [RAW], "/right/color/image_raw": [RAW]}, "several topics"),
        ({"/thermal": [RAW]}, "the images are /thermal"),
    ],
)
def test_without_a_clear_topic_the_error_names_setting_and_candidates(
    graph: dict[str, list[str]], said: str
) -> None:
    with pytest.raises(Unavailable, match="HELIOS_ROS2_COLOR") as error:
        color_topic(graph, "")
    assert said in error.value.message


def test_the_calibration_is_beside_the_image() -> None:
    assert info_beside("/camera/color/image_raw") == "/camera/color/camera_info"
    assert info_beside("/camera/color/image_raw/compressed") == "/camera/color/camera_info"


@given(st.lists(st.builds(Qos, st.booleans(), st.booleans()), min_size=1))
def test_a_subscription_asks_for_no_more_than_each_publisher_offers(offered: list[Qos]) -> None:
    asked = matching(offered)
    assert all(q.reliable or not asked.reliable for q in offered)
    assert all(q.retained or not asked.retained for q in offered)
    if len(set(offered)) == 1:
        assert asked == offered[0]


def test_the_robots_clock_goes_on_between_two_messages() -> None:
    now_s = [10.0]
    clock = RobotClock(lambda: now_s[0])
    assert clock.now_ns() == 0
    clock.note(5_000 * MS)
    now_s[0] += 0.25
    assert clock.now_ns() == 5_250 * MS


def test_the_only_battery_is_taken_and_among_several_one_must_be_named() -> None:
    one = {"/battery_state": [BATTERY], "/odom": ["nav_msgs/msg/Odometry"]}
    assert battery_topic(one, "") == "/battery_state"
    assert battery_topic({}, "/mine") == "/mine"
    for graph in ({}, one | {"/arm/battery": [BATTERY]}):
        with pytest.raises(Unavailable, match="HELIOS_ROS2_BATTERY"):
            battery_topic(graph, "")


def test_the_stamp_of_a_message_is_its_headers_or_its_newest_transforms() -> None:
    def stamped(sec: int, **more: object) -> SimpleNamespace:
        stamp = SimpleNamespace(sec=sec, nanosec=5)
        return SimpleNamespace(header=SimpleNamespace(stamp=stamp), **more)

    assert newest_stamp_ns(stamped(3)) == 3_000_000_005
    tf = SimpleNamespace(transforms=[stamped(7), stamped(9), stamped(8)])
    assert newest_stamp_ns(tf) == 9_000_000_005
    assert newest_stamp_ns(SimpleNamespace(data="a String has no stamp")) is None
