"""The contract suite on the ROS 2 driver, with real rclpy processes over loopback."""

from __future__ import annotations

import os
import re

import pytest

from tests.ros2_processes import contract, fake_robot, free_domain, needs_interfaces, needs_ros2

pytestmark = pytest.mark.timeout(900)
PICK = '{"action": "/pick", "type": "test_msgs/action/Fibonacci", "goal": {"order": 5}}'
TOPIC = {"HELIOS_ROS2_POSE": "topic", "HELIOS_ROS2_CAMERA_TILT_RAD": "0.55"}


def passed(output: str) -> int:
    found = re.search(r"(\d+) passed", output)
    return int(found.group(1)) if found else 0


@pytest.mark.long
@needs_ros2
def test_the_driver_meets_the_contract_with_odometry_and_velocities() -> None:
    domain = free_domain()
    with fake_robot(domain, "--still"):
        assert passed(contract(domain, settings=TOPIC)) >= 49


@pytest.mark.long
@needs_ros2
@needs_interfaces("tf2_msgs")
def test_a_robot_with_tf_unaligned_millimetres_best_effort_a_head_and_simulated_time() -> None:
    domain = free_domain()
    head = {
        "HELIOS_ROS2_POSE": "tf",
        "HELIOS_ROS2_TILT": "/head_controller/joint_trajectory",
        "HELIOS_ROS2_TILT_JOINT": "head_tilt_joint",
        "HELIOS_ROS2_TILT_MIN_RAD": "0.1",
        "HELIOS_ROS2_MAX_BACK_M": "0.3",
    }
    options = (
        "--still", "--tf", "--no-odom", "--unaligned", "--depth", "16UC1", "--best-effort",
        "--tilt", "--stamped", "--clock-rate", "1.5",
    )  # fmt: skip
    chosen = (
        "calibration or depth or stamps or upright or mounted or tilt or floor or drive or back"
    )
    with fake_robot(domain, *options):
        assert passed(contract(domain, "-k", chosen, settings=head)) >= 10


@pytest.mark.slow
@needs_ros2
@needs_interfaces("nav2_msgs")
def test_a_robot_with_nav2_drives_by_its_behaviours_and_backs_up() -> None:
    domain = free_domain()
    settings = TOPIC | {
        "HELIOS_ROS2_MOTION": "nav2",
        "HELIOS_ROS2_MAX_BACK_M": "0.3",
        "HELIOS_ROS2_PICK": PICK,
    }
    with fake_robot(domain, "--still", "--nav2", "--hand"):
        output = contract(domain, "-k", "left or drive or back", settings=settings)
    assert passed(output) >= 4


@needs_ros2
@pytest.mark.parametrize("name", ["HELIOS_ROS2_COLOUR"])
def test_a_misspelt_setting_is_refused_with_a_suggestion(name: str) -> None:
    from tests.ros2_processes import in_ros

    done = in_ros(free_domain(), "helios_contract", "ros2", settings={name: "/a"})
    assert done.returncode == 2
    assert "HELIOS_ROS2_COLOR" in done.stderr, os.linesep + done.stderr
