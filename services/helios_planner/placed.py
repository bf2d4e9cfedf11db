"""After placing: what is seen of the thing, instead of what the robot says of it.

The keyframe after the placing shows the surface from near. What was not known before and is of the
thing's class must be it: on the receptacle, or beside it on the ground. Seen nowhere proves
nothing, since detectors miss things; it is said.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum, auto

from helios_core.types import ObjectInstance

from helios_planner.explore import near_outline

ON_M = 0.15  # this near to a receptacle's outline is on it
BELOW_M = 0.20  # lower than its top by this is not on it
SAME_M = 0.15  # nearer than this to what was known before is the same thing
AROUND_M = 1.5  # what fell lies this near


class Seen(Enum):
    ON_IT = auto()
    BESIDE_IT = auto()
    NOWHERE = auto()


def seen_after(
    receptacle: ObjectInstance,
    before: Sequence[ObjectInstance],
    now: Sequence[ObjectInstance],
    least_class_score: float,
) -> tuple[Seen, ObjectInstance | None]:
    """Where the placed thing is seen; before, now: all instances of its class."""
    believed = [
        o for o in now
        if o.class_score >= least_class_score
        and all(math.dist(o.center_m, b.center_m) > SAME_M for b in before)
        and math.dist(o.center_m[:2], receptacle.center_m[:2]) <= _around_m(receptacle)
    ]  # fmt: skip
    on = [o for o in believed if _is_on(o, receptacle)]
    if on:
        return Seen.ON_IT, max(on, key=lambda o: o.class_score)
    if believed:
        return Seen.BESIDE_IT, max(believed, key=lambda o: o.class_score)
    return Seen.NOWHERE, None


def _is_on(thing: ObjectInstance, receptacle: ObjectInstance) -> bool:
    high = float(thing.center_m[2]) >= receptacle.top_m - BELOW_M
    return high and near_outline(receptacle, thing.center_m, ON_M)


def _around_m(receptacle: ObjectInstance) -> float:
    return AROUND_M + float(math.hypot(*receptacle.size_m[:2])) / 2
