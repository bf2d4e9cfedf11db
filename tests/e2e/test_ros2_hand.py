"""Runs tests/inside_ros2 with the interpreter that has rclpy."""

from __future__ import annotations

import pytest

from tests.ros2_processes import free_domain, in_ros, needs_ros2


@pytest.mark.long
@pytest.mark.timeout(900)
@needs_ros2
def test_hand_person_nav2_stop_silence_and_restart_of_a_ros2_robot() -> None:
    done = in_ros(
        free_domain(),
        "pytest",
        "--noconftest",
        "-q",
        "-p",
        "no:cacheprovider",
        "tests/inside_ros2",
        timeout_s=800,
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
