"""Actions of the fake ROS 2 robot: Nav2's behaviours, and a hand."""

from __future__ import annotations

import argparse
import math
import time
from typing import Any

from rclpy.action import ActionServer, CancelResponse

from tests.fake_ros2.robot import FakeRobot

SPEED_M_S, TURN_RAD_S, POLL_S, HAND_S = 0.4, 1.0, 0.02, 0.3


def serve_actions(robot: FakeRobot, options: argparse.Namespace) -> None:
    """Serve what the options name."""
    if options.nav2:
        from nav2_msgs.action import BackUp, DriveOnHeading, Spin

        _serve(robot, Spin, "spin", lambda goal: _turn(robot, goal))
        _serve(robot, DriveOnHeading, "drive_on_heading", lambda goal: _drive(robot, goal, 1))
        _serve(robot, BackUp, "backup", lambda goal: _drive(robot, goal, -1))
    if options.hand:
        from test_msgs.action import Fibonacci

        for name in ("/pick", "/place"):
            _serve(robot, Fibonacci, name, _use_hand)


def _serve(robot: FakeRobot, kind: Any, name: str, do: Any) -> None:
    def execute(handle: Any) -> Any:
        done = do(handle)
        robot.halt()
        if handle.is_cancel_requested:
            handle.canceled()
        elif done:
            handle.succeed()
        else:
            handle.abort()
        return kind.Result()

    ActionServer(
        robot.node,
        kind,
        name,
        execute,
        callback_group=robot.group,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
    )


def _turn(robot: FakeRobot, handle: Any) -> bool:
    goal_rad, start_rad = handle.request.target_yaw, robot.yaw
    sign = math.copysign(1.0, goal_rad)

    def left() -> float:
        return abs(goal_rad) - sign * (robot.yaw - start_rad)

    return _until(robot, handle, left, lambda speed: robot.command(0.0, sign * speed), TURN_RAD_S)


def _drive(robot: FakeRobot, handle: Any, sign: int) -> bool:
    goal_m, x, y = handle.request.target.x, robot.x, robot.y

    def left() -> float:
        return goal_m - math.hypot(robot.x - x, robot.y - y)

    return _until(robot, handle, left, lambda speed: robot.command(sign * speed, 0.0), SPEED_M_S)


def _until(robot: FakeRobot, handle: Any, left: Any, command: Any, fastest: float) -> bool:
    end_s = time.monotonic() + handle.request.time_allowance.sec
    while left() > 0.005 and not handle.is_cancel_requested:
        if time.monotonic() > end_s:
            return False
        command(min(fastest, max(0.05, 2 * left())))
        time.sleep(POLL_S)
    return True


def _use_hand(handle: Any) -> bool:
    """Take some time; fail for the order 13."""
    end_s = time.monotonic() + HAND_S
    while time.monotonic() < end_s and not handle.is_cancel_requested:
        time.sleep(POLL_S)
    return handle.request.order != 13
