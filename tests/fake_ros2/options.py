"""Command line of the fake ROS 2 robot."""

from __future__ import annotations

import argparse


def parsed(argv: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.fake_ros2",
        description="A ROS 2 robot in the room of helios_examples: RGB-D, odometry, cmd_vel.",
    )
    add = parser.add_argument
    add("--size", default="320x240", help="WIDTHxHEIGHT of the images")
    add("--hz", type=float, default=15.0, help="images per second")
    add("--still", action="store_true", help="draw the image only after a motion: costs less")
    add("--best-effort", action="store_true", help="images with best effort")
    add("--depth", choices=("32FC1", "16UC1"), default="32FC1", help="encoding of depth")
    add("--unaligned", action="store_true", help="depth from a camera beside the colour camera")
    add("--stamped", action="store_true", help="cmd_vel is TwistStamped")
    add("--tf", action="store_true", help="publish /tf and /tf_static (needs tf2_msgs)")
    add("--no-odom", action="store_true", help="publish no /odom")
    add("--tilt", action="store_true", help="a head that a JointTrajectory tilts")
    add("--nav2", action="store_true", help="serve Spin, DriveOnHeading, BackUp (needs nav2_msgs)")
    add("--hand", action="store_true", help="serve /pick and /place as test_msgs/action/Fibonacci")
    add("--battery", type=float, help="publish this charge, 0 to 1")
    add("--clock-rate", type=float, default=0.0, help="simulated time at this rate; 0: real time")
    add("--clock-start", type=float, default=100.0, help="start of the simulated time, s")
    return parser.parse_args(argv)
