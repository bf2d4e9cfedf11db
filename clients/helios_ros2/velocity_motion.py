"""Drives and turns by velocities, controlled by the robot's own poses.

The commands end when the driver ends: robots stop without a new one within a moment. Times are of
the robot's clock, so a slow simulation drives as well as a fast one.
"""

from __future__ import annotations

import math
from typing import Any

from helios_core.errors import Unavailable
from helios_core.geometry import invert, wrap_angle, yaw_of

from helios_ros2.offered_qos import Qos
from helios_ros2.robot_input import BasePose, RobotInput
from helios_ros2.ros_node import RosNode
from helios_ros2.settings import Ros2Settings
from helios_ros2.stop_latch import NotDone, StopLatch
from helios_ros2.zenoh_node import ZenohNode

PERIOD_S = 0.05
NEAR_M, NEAR_RAD = 0.01, 0.01  # a motion is complete this near to its end
PROGRESS = 0.01  # m or rad; less counts as standing still
SLOW_PER_S = 2.0  # speed per distance left: a 50 ms old pose does not overshoot
STEER_PER_S, MOST_STEER_RAD_S = 1.5, 0.3
STOPS = 3  # zero velocities at the end: one may be lost
TWISTS = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Twist")


class VelocityPublisher:
    """Publisher of velocities, with the type to which the robot subscribes."""

    def __init__(
        self, ros: RosNode | ZenohNode, settings: Ros2Settings, senses: RobotInput
    ) -> None:
        self._ros, self._topic, self._senses = ros, settings.cmd_vel, senses
        self._kind, self._publisher, self._twist = "", None, ros.interface(TWISTS[1])

    def begin(self) -> None:
        """Take the robot's type. Raises Unavailable if nobody listens."""
        heard = [kind for kind, _ in self._ros.requested(self._topic)]
        kind = next((k for k in TWISTS if k in heard), None)
        if kind is None:
            came = f"; its type is {heard[0]}" if heard else ""
            raise Unavailable(
                f"no robot listens to {self._topic} ({' or '.join(TWISTS)}){came}; name the topic "
                f"with HELIOS_ROS2_CMD_VEL, {self._ros.domain}"
            )
        if kind != self._kind:
            self._publisher = self._ros.publisher(self._topic, kind, Qos(), 1)
            self._kind = kind

    def send(self, ahead_m_s: float, left_rad_s: float) -> None:
        """Send one velocity; none before `begin`."""
        publisher: Any = self._publisher
        if publisher is None:
            return
        twist = self._twist()
        twist.linear.x, twist.angular.z = float(ahead_m_s), float(left_rad_s)
        if self._kind == TWISTS[0]:
            message = self._ros.interface(self._kind)(twist=twist)
            ns = self._senses.clock.now_ns()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(ns, 10**9)
            twist = message
        publisher.publish(twist)

    def halt(self) -> None:
        """Command the robot to stand."""
        for _ in range(STOPS):
            self.send(0.0, 0.0)


class VelocityMotion:
    """Motions of one base. For one thread, except `halt`."""

    def __init__(
        self, ros: RosNode | ZenohNode, settings: Ros2Settings, senses: RobotInput, latch: StopLatch
    ) -> None:
        self._s, self._senses, self._latch = settings, senses, latch
        self._velocity = VelocityPublisher(ros, settings, senses)

    def halt(self) -> None:
        """Stop the base. From any thread."""
        self._velocity.halt()

    def forward(self, distance_m: float) -> None:
        """Drive straight ahead; back if negative. Raises NotDone, Unavailable."""
        start, sign = self._senses.here(), math.copysign(1.0, distance_m)
        yaw_rad = yaw_of(start.T_world_base)

        def left_m(here: BasePose) -> float:
            return abs(distance_m) - sign * float(
                (invert(start.T_world_base) @ here.T_world_base)[0, 3]
            )

        def command(here: BasePose, left: float) -> tuple[float, float]:
            speed = min(self._s.speed_m_s, max(self._s.min_speed_m_s, SLOW_PER_S * left))
            off_rad = wrap_angle(yaw_rad - yaw_of(here.T_world_base))
            steer = max(-MOST_STEER_RAD_S, min(MOST_STEER_RAD_S, STEER_PER_S * off_rad))
            return sign * speed, steer

        self._drive(start, left_m, command, NEAR_M, abs(distance_m) / self._s.speed_m_s, "m")

    def turn(self, angle_rad: float) -> None:
        """Turn in place. Raises NotDone, Unavailable."""
        start, sign = self._senses.here(), math.copysign(1.0, angle_rad)
        last_rad, turned_rad = yaw_of(start.T_world_base), 0.0

        def left_rad(here: BasePose) -> float:
            nonlocal last_rad, turned_rad
            yaw_rad = yaw_of(here.T_world_base)
            turned_rad += wrap_angle(yaw_rad - last_rad)
            last_rad = yaw_rad
            return abs(angle_rad) - sign * turned_rad

        def command(_: BasePose, left: float) -> tuple[float, float]:
            rate = min(self._s.turn_rad_s, max(self._s.min_turn_rad_s, SLOW_PER_S * left))
            return 0.0, sign * rate

        least_s = abs(angle_rad) / self._s.turn_rad_s
        self._drive(start, left_rad, command, NEAR_RAD, least_s, "rad")

    def _drive(
        self, start: BasePose, left_of: Any, command: Any, near: float, least_s: float, unit: str
    ) -> None:
        """Command velocities until the distance left is small. Then command the base to stop.

        start: pose from which `left_of` measures. Raises NotDone when a new world begins.
        """
        self._velocity.begin()
        here = self._here(start)
        whole = best = left_of(here)
        best_ns, end_ns = here.stamp_ns, here.stamp_ns + int((3 * least_s + 3) * 1e9)
        try:
            while (left := left_of(here)) > near:
                if left < best - PROGRESS:
                    best, best_ns = left, here.stamp_ns
                if here.stamp_ns - best_ns > self._s.blocked_s * 1e9:
                    raise NotDone(
                        f"blocked after {whole - left:.2f} {unit}; look, and go another way"
                    )
                if here.stamp_ns > end_ns:
                    raise NotDone(
                        f"too slow: {whole - left:.2f} of {whole:.2f} {unit} in "
                        f"{3 * least_s + 3:.1f} s; HELIOS_ROS2_SPEED_M_S and …_TURN_RAD_S are what "
                        "the robot should reach"
                    )
                self._velocity.send(*command(here, left))
                self._latch.rest(PERIOD_S)
                here = self._here(start)
        finally:
            self._velocity.halt()

    def _here(self, start: BasePose) -> BasePose:
        """Newest pose. Raises NotDone if its origin is not that of `start`."""
        here = self._senses.here()
        if here.world_epoch != start.world_epoch:
            raise NotDone(
                "the robot's poses jumped during the motion, so how far it came is not known; "
                "look, and plan the way again"
            )
        return here
