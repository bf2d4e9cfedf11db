"""Tilt of a head or a camera by a JointTrajectory, measured by its joint state."""

from __future__ import annotations

import time

from helios_ros2.offered_qos import Qos
from helios_ros2.robot_input import RobotInput
from helios_ros2.ros_node import RosNode
from helios_ros2.settings import Ros2Settings
from helios_ros2.stop_latch import NotDone, StopLatch
from helios_ros2.zenoh_node import ZenohNode

NEAR_RAD = 0.03
WITHIN_S = 6.0
STEADY_S = 0.15
MOVE_S = 1.0  # duration of the trajectory
POLL_S = 0.03


class CameraTilt:
    """The joint that tilts the camera. Without one, the tilt is fixed."""

    def __init__(
        self, ros: RosNode | ZenohNode, settings: Ros2Settings, senses: RobotInput, latch: StopLatch
    ) -> None:
        self._s, self._senses, self._latch = settings, senses, latch
        self._publisher = None
        if settings.tilt and settings.tilt_joint:
            kind = "trajectory_msgs/msg/JointTrajectory"
            self._point = ros.interface(f"{kind}Point")
            self._message = ros.interface(kind)
            self._publisher = ros.publisher(settings.tilt, kind, Qos(), 1)

    @property
    def range_rad(self) -> tuple[float, float] | None:
        """Lowest and highest tilt, positive looks down; None if it is fixed."""
        if self._publisher is None:
            return None
        return self._s.tilt_min_rad, self._s.tilt_max_rad

    def move(self, tilt_rad: float) -> None:
        """Tilt, and wait until the joint has arrived. Raises NotDone."""
        if self._publisher is None:
            if abs(tilt_rad - self._senses.tilt_rad()) < NEAR_RAD:
                return
            raise NotDone("the camera is fixed; HELIOS_ROS2_TILT and …_TILT_JOINT name its joint")
        wanted_rad = min(max(tilt_rad, self._s.tilt_min_rad), self._s.tilt_max_rad)
        point = self._point(positions=[self._s.tilt_sign * (wanted_rad - self._s.tilt_offset_rad)])
        point.time_from_start.sec = int(MOVE_S)
        message = self._message(joint_names=[self._s.tilt_joint], points=[point])
        end_s, arrived_s = time.monotonic() + WITHIN_S, None
        self._publisher.publish(message)
        while time.monotonic() < end_s:
            self._latch.rest(POLL_S)
            is_near = abs(self._senses.tilt_rad() - wanted_rad) < NEAR_RAD
            if not is_near:
                arrived_s = None
            elif arrived_s is None:
                arrived_s = time.monotonic()
            elif time.monotonic() - arrived_s > STEADY_S:
                return
        raise NotDone(
            f"the joint {self._s.tilt_joint} is at {self._senses.tilt_rad():.2f} rad after "
            f"{WITHIN_S:g} s, wanted {wanted_rad:.2f}; does {self._s.tilt} move it, and does "
            f"{self._s.joint_states} tell it?"
        )
