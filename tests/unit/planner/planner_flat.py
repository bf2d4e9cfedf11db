"""A flat for tests, objects for it, and instructions that can be done there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from helios_planner.motion_planning.costmap import Pose2
from planner_things import Box, Thing
from planner_world import FakeWorld

MOVE = "Move the mug from the coffee table to the counter"
GO = "go to the counter"


def flat(
    things: Sequence[Thing] = (), start: Pose2 | None = None, extra: Sequence[Box] = ()
) -> FakeWorld:
    """Make three rooms, 9 x 7 m, doors 1 m wide; a coffee table, a counter, a bed as boxes."""
    walls = [
        Box(4.4, 0, 4.5, 2.5, 2.5),
        Box(4.4, 3.5, 4.5, 7, 2.5),
        Box(4.5, 4.0, 6.5, 4.1, 2.5),
        Box(7.5, 4.0, 9, 4.1, 2.5),
    ]
    furniture = [
        Box(6.5, 5.2, 7.5, 5.8, 0.45),
        Box(1.2, 6.3, 3.2, 6.95, 0.9),
        Box(6.8, 0.05, 8.8, 1.9, 0.5),
    ]
    return FakeWorld((9, 7), [*walls, *furniture, *extra], things, start or Pose2(1.5, 1.5, 0.3))


def coffee_table(id: int = 1) -> Thing:
    return Thing(
        id, "coffee table", np.array([7.0, 5.5, 0.4]), np.array([1.0, 0.6, 0.1]), graspable=False
    )


def counter(id: int = 2) -> Thing:
    return Thing(
        id, "counter", np.array([2.2, 6.62, 0.85]), np.array([2.0, 0.65, 0.1]), graspable=False
    )


def mug(id: int = 3, x: float = 7.2, y: float = 5.35, z: float = 0.5, rate: float = 1.0) -> Thing:
    return Thing(id, "mug", np.array([x, y, z]), np.array([0.08, 0.08, 0.1]), rate)


def flat_with_mug() -> FakeWorld:
    """Make a flat in which `MOVE` can be done."""
    return flat([coffee_table(), counter(), mug()])
