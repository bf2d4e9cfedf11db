"""Plays a data set as a robot: each capture gives the next image, at rest, and no action moves."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix, se2_to_se3
from helios_core.robot import (
    Action,
    ActionResult,
    Capture,
    EndOfRecording,
    Observe,
    RobotDriver,
)
from helios_core.types import RobotDescription, RobotState

from helios_replay.dataset import read_dataset, read_image

FOOTPRINT_RADIUS_M = 0.3  # of a person who carries a camera
STRAIGHT_DOWN = 1e-3  # below this share of horizontal, the optical axis has no heading


def base_below_camera(T_world_cam: Matrix) -> Matrix:
    """T_world_base [4, 4]: the camera's place on the floor, heading where the camera looks.

    A camera that looks straight up or down heads where the top of its image points.
    """
    ahead = T_world_cam[:2, 2]  # the optical axis on the ground
    if np.hypot(*ahead) < STRAIGHT_DOWN:
        ahead = -T_world_cam[:2, 1]
    x_m, y_m = (float(v) for v in T_world_cam[:2, 3])
    return se2_to_se3(x_m, y_m, math.atan2(ahead[1], ahead[0]))


class ReplayDriver(RobotDriver):
    """A folder as `helios_replay.dataset` describes. Raises InvalidInput when it is not whole.

    An image that cannot be read raises InvalidInput from `capture`, once; the next capture gives
    the next image.
    """

    def __init__(self, source: Path | None, limit: int = 0) -> None:
        """source: the folder. limit: play so many images only; 0 plays all."""
        if source is None:
            raise InvalidInput("a replay needs a data set; name its folder with --source")
        self._dataset = read_dataset(source, limit)
        self._next = 0
        self._T_world_base = base_below_camera(self._dataset.images[0].T_world_cam)
        self._stopped = False
        self._steps = 0
        self._results: dict[str, ActionResult] = {}

    def describe(self) -> RobotDescription:
        heights_m = [image.T_world_cam[2, 3] for image in self._dataset.images]
        return RobotDescription(
            name=self._dataset.folder.name,
            footprint_radius_m=FOOTPRINT_RADIUS_M,
            height_m=float(max(heights_m)),
            camera=self._dataset.camera,
            camera_height_m=float(np.median(heights_m)),
            reach_m=0.0,
            max_depth_m=self._dataset.max_depth_m,
            can_move=False,
            can_pick=False,
            can_place=False,
        )

    def state(self) -> RobotState:
        given, total = self._next, len(self._dataset.images)
        return RobotState(
            T_world_base=self._T_world_base,
            stopped=self._stopped,
            message=f"frame {given} of {total}",
            finished=given >= total,
        )

    def capture(self) -> Capture:
        index = self._next
        if index >= len(self._dataset.images):
            raise EndOfRecording(f"{self._dataset.folder} has no frame after {index}")
        self._next += 1
        image = self._dataset.images[index]
        color, depth_m = read_image(self._dataset, index)
        self._T_world_base = base_below_camera(image.T_world_cam)
        return Capture(
            stamp_ns=image.stamp_ns,
            color=color,
            depth_m=depth_m,
            camera=self._dataset.camera,
            T_world_cam=image.T_world_cam,
            T_world_base=self._T_world_base,
        )

    def act(self, action: Action, action_id: str) -> ActionResult:
        if action_id not in self._results:
            self._results[action_id] = self._do(action)
        return self._results[action_id]

    def stop(self, reason: str) -> None:
        self._stopped = True

    def clear_stop(self) -> None:
        self._stopped = False

    def _do(self, action: Action) -> ActionResult:
        if self._stopped:
            return ActionResult(False, "the robot is stopped; clear the stop first")
        if not isinstance(action, Observe):
            return ActionResult(
                False, f"a recording cannot {type(action).__name__.lower()}; it can only observe"
            )
        self._steps += 1
        return ActionResult(True, steps=self._steps)
