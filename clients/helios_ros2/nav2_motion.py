"""Drives and turns by Nav2's behaviours, which check for collisions themselves."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from functools import partial
from typing import Any

from helios_core.errors import InvalidInput

from helios_ros2.action_call import RosAction
from helios_ros2.earlier_goals import EarlierGoals
from helios_ros2.ros_node import RosNode
from helios_ros2.settings import Ros2Settings
from helios_ros2.stop_latch import StopLatch

log = logging.getLogger(__name__)

ACTIONS = {
    "spin": "nav2_msgs/action/Spin",
    "drive_on_heading": "nav2_msgs/action/DriveOnHeading",
    "backup": "nav2_msgs/action/BackUp",
}


class Nav2Motion:
    """Nav2's Spin, DriveOnHeading and BackUp. For one thread, except `halt`."""

    def __init__(self, ros: RosNode, settings: Ros2Settings, latch: StopLatch) -> None:
        """Raises InvalidInput if nav2_msgs is not installed."""
        self._s, self._latch = settings, latch
        self._actions = {
            name: RosAction(ros, settings.nav2_prefix + name, kind)
            for name, kind in ACTIONS.items()
        }

    @staticmethod
    def of(ros: RosNode | None, settings: Ros2Settings, latch: StopLatch) -> Nav2Motion | None:
        """Nav2's motion where its interfaces are installed. Raises InvalidInput if they must be.

        ros: None without rclpy's actions.
        """
        if settings.motion not in ("auto", "nav2"):
            return None
        if ros is None:
            if settings.motion == "nav2":
                raise InvalidInput("motion = nav2 needs transport = rclpy; Zenoh has no actions")
            return None
        try:
            return Nav2Motion(ros, settings, latch)
        except InvalidInput as error:
            if settings.motion == "nav2":
                raise
            log.info("Nav2 is not used: %s", error.message)
            return None

    def is_there(self) -> bool:
        """True if the robot serves Spin and DriveOnHeading."""
        return all(self._actions[name].is_there() for name in ("spin", "drive_on_heading"))

    def cancels(self, until_s: float = 0.0) -> list[Callable[[], None]]:
        """Calls, from any thread, of which one cancels the running behaviour. Each waits for the
        answer until a monotonic time."""
        return [partial(action.cancel, until_s) for action in self._actions.values()]

    def earlier_goals(self) -> list[EarlierGoals]:
        """The goals of each behaviour from before this process."""
        return [action.earlier for action in self._actions.values()]

    def forward(self, distance_m: float) -> None:
        """Drive straight ahead; back if negative. Raises NotDone."""
        seconds = 3 * abs(distance_m) / self._s.speed_m_s + 3
        fields = {"target": {"x": abs(distance_m)}, "speed": self._s.speed_m_s}
        self._run("drive_on_heading" if distance_m >= 0 else "backup", fields, seconds)

    def turn(self, angle_rad: float) -> None:
        """Turn in place. Raises NotDone."""
        seconds = 3 * abs(angle_rad) / self._s.turn_rad_s + 3
        self._run("spin", {"target_yaw": angle_rad}, seconds)

    def _run(self, name: str, fields: dict[str, Any], seconds: float) -> None:
        allowed = {"sec": math.ceil(seconds)}
        action = self._actions[name]
        action.run(action.goal({**fields, "time_allowance": allowed}), self._latch, seconds + 2)
