"""Look at a picked object before it is carried away, and put a wrong one back (not in the paper)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from helios_core.robot import Place, Show
from numpy.typing import NDArray

from helios_planner.decisions.held_object import HeldObject
from helios_planner.motion_planning.base_placement import tilt_towards
from helios_planner.navigation.base_controller import BaseController
from helios_planner.robot.interface import RobotInterface
from helios_planner.settings import Settings

RAISED_M = (0.01, 0.10)  # heights above the old place from which the object is released


@dataclass
class HandCheck:
    """Views of the held object from several sides."""

    robot: RobotInterface
    base: BaseController
    settings: Settings
    put_back: int = 0  # wrong objects so far
    fails: bool = False  # True once the robot could not show what it holds

    @property
    def possible(self) -> bool:
        """True if the robot looks at what it picks, and another pick may follow."""
        can = self.robot.description.show_base_m is not None and not self.fails
        return can and self.settings.hand_sides > 0

    def look(self, class_name: str) -> HeldObject | None:
        """Show the held object from all sides. Returns what it looks like, None if it cannot be
        shown. Raises Dropped."""
        x, y, z = self.robot.description.show_base_m or (0.0, 0.0, 0.0)
        self.base.tilt(tilt_towards(math.hypot(x, y), z, self.robot.description))
        for k in range(self.settings.hand_sides):
            angle_rad = 2 * math.pi * k / self.settings.hand_sides
            if not self.base.monitor.act(Show(angle_rad)).succeeded:
                self.fails = True
                return None
        return self.robot.held_object(class_name)

    def return_to(self, point_m: NDArray[np.float64]) -> bool:
        """Release the object at the place [3] from which it was picked: centre and floor height of
        its box. False if the robot still holds it."""
        x, y, z = (float(v) for v in point_m)
        for raised_m in RAISED_M:
            self.base.monitor.act(Place((x, y, z + raised_m)))
            if not self.robot.held():
                self.base.monitor.carrying = False
                self.put_back += 1
                return True
        return False
