"""Compilation of every Numba kernel, or loading from the cache, so that no task waits for it."""

from __future__ import annotations

import numpy as np

from helios_planner.motion_planning import kernels
from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.motion_planning.lattice_planner import Capsule, pose_reach
from helios_planner.motion_planning.path_planner import (
    MotionRules,
    next_primitive,
    reach,
    straightened,
)


def warm_up() -> None:
    """Plan paths on a small empty map, for a disc footprint and for a box footprint."""
    ground = GroundMap(
        np.zeros((64, 64), np.int8), np.zeros((64, 64), np.float32), 0.05, (0.0, 0.0)
    )
    robot, rules = Pose2(1.6, 1.6, 0.0), MotionRules(footprint_m=0.3)
    reached = reach(ground, robot, rules)
    next_primitive(straightened(reached.route_to((2.2, 2.2)), reached), reached, rules)
    kernels.hidden_along(ground.top_m, 1.0, 1.0, 1.0, 9.0, 9.0, 0.5, 1.0, 1.25)
    mask, labels = np.ones((2, 2), np.uint8), np.zeros((2, 2), np.int32)
    kernels.clear_labels(labels, np.ones(1, np.bool_), mask)
    pose_reach(ground, robot, Capsule.around(0.6, 0.4), rules)
