"""Test rig of a driver."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import pytest
from helios_core.errors import Unavailable
from helios_core.geometry import Matrix, lift_pixels
from helios_core.robot import Action, ActionResult, Capture, Observe, RobotDriver, Turn
from helios_core.types import RobotDescription

BACK_WITHIN_S = 60.0
READY_WITHIN_S = 30.0
RETRY_S = 0.1

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Rig:
    """One driver with its motion limits and tolerances. The scene in front of it must not change.

    The suite drives ahead three times, and back once, if the robot can move back; otherwise it
    drives ahead twice. It turns on the spot, to the left first, and once all the way round.
    """

    driver: RobotDriver
    forward_m: float = 0.3  # distance of a drive; one drive is half as long
    turn_rad: float = 0.4
    tolerance_m: float = 0.05  # tolerance of the reported position after a drive
    tolerance_rad: float = 0.06
    depth_tolerance_m: float = 0.05  # tolerance of the depth image, at 2 m
    # Context in which the robot is unreachable.
    away: Callable[[], AbstractContextManager[object]] | None = None
    # A second driver of the same robot, as after a restart.
    started_again: Callable[[], AbstractContextManager[RobotDriver]] | None = None

    @property
    def robot(self) -> RobotDescription:
        return self.driver.describe()

    def ready(self) -> Rig:
        """This rig, once the robot describes itself. Raises Unavailable if it never does."""
        _available(self.driver.describe, READY_WITHIN_S)
        return self

    def act(self, action: Action) -> ActionResult:
        """Execute an action under a new id."""
        return self.driver.act(action, uuid.uuid4().hex)

    def pose(self) -> Matrix:
        """T_world_base [4, 4] that the driver reports."""
        return self.driver.state().T_world_base

    def when_back(self) -> Capture:
        """First image after an absence of the robot, once it acts again.

        Raises Unavailable if it stays unreachable.
        """

        def image() -> Capture:  # an idle connection may fail once more
            self.act(Turn(self.turn_rad) if self.robot.can_move else Observe())
            return self.driver.capture()

        return _available(image, BACK_WITHIN_S)

    def need_motion(self) -> None:
        """Skip the test if the robot cannot move."""
        if not self.robot.can_move:
            pytest.skip("this robot cannot move")


def _available(ask: Callable[[], Answer], within_s: float) -> Answer:
    """Answer of the robot, asked until it is reachable. Raises Unavailable after the time."""
    deadline_s = time.monotonic() + within_s
    while True:
        try:
            return ask()
        except Unavailable:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(RETRY_S)


def seen_points(capture: Capture, max_depth_m: float) -> Matrix:
    """World points [n, 3] of all pixels with depth up to `max_depth_m`."""
    near = np.where(capture.depth_m <= max_depth_m, capture.depth_m, 0).astype(np.float32)
    points = lift_pixels(near, capture.camera, capture.T_world_cam).reshape(-1, 3)
    return points[np.isfinite(points).all(axis=1)]
