"""Pick and place by points, with a reason for each failure.

The gripper holds the picked object at once. `PickRule` says which object a pick takes:

- physical: the object nearest to the point, of whatever class. It must lie within 0.15 m of the
  point, in reach and in view.
- ovmm: the object of the sought class that is nearest to the point, of those in reach and in view.
  Without any the pick fails, and nothing moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Literal, get_args

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.name_rules import is_named, same_name
from numpy.typing import NDArray

from helios_sim.gripper import Graspable, Gripper, RestState
from helios_sim.mujoco_library import mujoco
from helios_sim.robot_model import REACH_M

PICK_WITHIN_M = 0.15  # from the requested point to the object's box

Point = tuple[float, float, float]
PickRule = Literal["physical", "ovmm"]
PICK_RULES: tuple[PickRule, ...] = get_args(PickRule)


def pick_rule_named(name: str) -> PickRule:
    """Pick rule of that name, in any letter case. Raises InvalidInput for an unknown name."""
    known = same_name(name, PICK_RULES)
    for rule in PICK_RULES:
        if rule == known:
            return rule
    raise InvalidInput(f"no pick rule is called {name!r}; wanted {' or '.join(PICK_RULES)}")


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
        classes: Mapping[str, str],
        rule: PickRule = "physical",
    ) -> None:
        """bodies_seen: returns the body id of each pixel of the current view [h, w]. classes:
        class name of each object of `things`, by object name. rule: see the module."""
        self._data, self._gripper, self._things = data, gripper, things
        self._bodies_seen = bodies_seen
        self._classes, self._rule = classes, rule

    def pick(self, point_world_m: Point, spot: str, class_name: str) -> Graspable:
        """Grasp the object that the pick rule selects. point_world_m: true world position, m.
        spot: text for the point in messages. class_name: sought class. Raises
        ManipulationFailed."""
        if self._gripper.held:
            raise ManipulationFailed("the gripper already holds something; place it first")
        if self._rule == "ovmm":
            thing = self._nearest_of_class(point_world_m, class_name)
        else:
            thing = self._nearest_at_point(point_world_m, spot)
        self._gripper.grasp(thing)
        return thing

    def _nearest_at_point(self, point_world_m: Point, spot: str) -> Graspable:
        """Object at the point, of any class. Raises ManipulationFailed."""
        thing = self._nearest(self._things, point_world_m)
        if thing is None or thing.distance_m(self._data, point_world_m) > PICK_WITHIN_M:
            raise ManipulationFailed(
                f"nothing to grasp within {PICK_WITHIN_M} m of {spot}; look again"
            )
        if not self._in_reach(thing):
            raise ManipulationFailed(
                f"what is at {spot} is out of reach ({REACH_M} m); drive nearer"
            )
        if not np.any(self._bodies_seen() == thing.body):
            raise ManipulationFailed(f"what is at {spot} is not in view; look at it first")
        return thing

    def _nearest_of_class(self, point_world_m: Point, class_name: str) -> Graspable:
        """Object of a class in reach and in view, the nearest to the point. Raises
        ManipulationFailed."""
        near = [
            t
            for t in self._things
            if is_named(class_name, self._classes[t.name]) and self._in_reach(t)
        ]
        seen = self._bodies_seen() if near else np.empty(0, np.int32)
        thing = self._nearest([t for t in near if np.any(seen == t.body)], point_world_m)
        if thing is None:
            raise ManipulationFailed(
                f"nothing of the class {class_name!r} is in reach ({REACH_M} m) and in view; "
                "look again"
            )
        return thing

    def _nearest(self, things: Collection[Graspable], point_world_m: Point) -> Graspable | None:
        return min(
            things,
            key=lambda t: (
                t.distance_m(self._data, point_world_m),
                math.dist(self._data.xpos[t.body], point_world_m),
                t.name,
            ),
            default=None,
        )

    def _in_reach(self, thing: Graspable) -> bool:
        return self._gripper.distance_m(self._data.xpos[thing.body]) <= REACH_M

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
