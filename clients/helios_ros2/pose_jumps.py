"""Recognition of poses with a new origin. No I/O."""

from __future__ import annotations

import math

from helios_core.geometry import Matrix

FASTEST_M_S = 3.0  # no robot indoors is faster


def is_new_origin(
    before: Matrix, before_ns: int, after: Matrix, after_ns: int, jump_m: float
) -> bool:
    """True if the base cannot have moved from one pose to the other: its poses have a new origin.

    before, after: T_world_base [4, 4]. A clock that goes back means a restart of the robot.
    """
    passed_s = (after_ns - before_ns) / 1e9
    if passed_s < -1.0:
        return True
    moved_m = math.hypot(*(after - before)[:2, 3])
    return moved_m > jump_m + FASTEST_M_S * max(passed_s, 0.0)
