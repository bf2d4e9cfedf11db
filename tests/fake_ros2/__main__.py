"""Entry point `python -m tests.fake_ros2`."""

from __future__ import annotations

import contextlib
import sys

import rclpy
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor

from tests.fake_ros2.options import parsed
from tests.fake_ros2.robot import FakeRobot


def main() -> int:
    options = parsed()
    rclpy.init(args=[])
    node = rclpy.create_node("fake_robot", start_parameter_services=False)
    robot = FakeRobot(node, options)
    if options.nav2 or options.hand:
        from tests.fake_ros2.actions import serve_actions

        serve_actions(robot, options)
    executor = MultiThreadedExecutor(num_threads=4)
    executor.add_node(node)
    print("the fake robot is up", flush=True)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()
    return 0


if __name__ == "__main__":
    sys.exit(main())
