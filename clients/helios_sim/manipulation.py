"""Pick and place by points, with a reason for each failure.

The pick is the benchmark's oracle pick: the gripper holds the object nearest to the point at once,
if it is within reach and in view. The class of the object does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection

import mujoco
import numpy as np
from numpy.typing import NDArray

from helios_sim.gripper import Graspable, Gripper, RestState
from helios_sim.robot_model import REACH_M

PICK_WITHIN_M = 0.15  # from the requested point to the object's box

Point = tuple[float, float, float]


class ManipulationFailed(Exception):
    """Pick or place failed; the message is one sentence without ground truth."""


class Manipulation:
    """Pick and place of the movable objects of a home with the gripper."""

    def __init__(
        self,
        data: mujoco.MjData,
        gripper: Gripper,
        things: Collection[Graspable],
        bodies_seen: Callable[[], NDArray[np.int32]],
    ) -> None:
        """bodies_seen: returns the body id of each pixel of the current view."""
        self._data, self._gripper, self._things = data, gripper, things
        self._bodies_seen = bodies_seen

    def pick(self, point_world_m: Point, spot: str) -> Graspable:
        """Grasp the object at the point. spot: text for the point in messages. Raises
        ManipulationFailed."""
        if self._gripper.held:
            raise ManipulationFailed("the gripper already holds something; place it first")
        nearest = min(
            (
                (t.distance_m(self._data, point_world_m), self._away_m(t, point_world_m), t.name, t)
                for t in self._things
            ),
            default=None,
        )
        if nearest is None or nearest[0] > PICK_WITHIN_M:
            raise ManipulationFailed(
                f"nothing to grasp within {PICK_WITHIN_M} m of {spot}; look again"
            )
        thing = nearest[-1]
        if self._gripper.distance_m(self._data.xpos[thing.body]) > REACH_M:
            raise ManipulationFailed(
                f"what is at {spot} is out of reach ({REACH_M} m); drive nearer"
            )
        if not np.any(self._bodies_seen() == thing.body):
            raise ManipulationFailed(f"what is at {spot} is not in view; look at it first")
        self._gripper.grasp(thing)
        return thing

    def within_grasp(self, point_world_m: Point) -> frozenset[str]:
        """Names of all objects within grasp of the point."""
        return frozenset(
            t.name for t in self._things if t.distance_m(self._data, point_world_m) <= PICK_WITHIN_M
        )

    def place(self, point_world_m: Point, spot: str) -> tuple[Graspable, RestState]:
        """Release the held object above the point and wait until it rests. Raises
        ManipulationFailed."""
        thing = self._gripper.held
        if thing is None:
            raise ManipulationFailed("the gripper is empty; pick something first")
        if self._gripper.distance_m(point_world_m) > REACH_M:
            raise ManipulationFailed(f"{spot} is out of reach ({REACH_M} m); drive nearer")
        if self._gripper.arm_blocked(point_world_m):
            raise ManipulationFailed(
                f"something is in the arm's way to {spot}; go to another side of it"
            )
        if not self._gripper.release(point_world_m):
            raise ManipulationFailed(f"there is no room above {spot}; choose another place")
        return thing, self._gripper.settle(thing)

    def _away_m(self, thing: Graspable, point_world_m: Point) -> float:
        return math.dist(self._data.xpos[thing.body], point_world_m)
