"""After placing: what is seen of the thing, instead of what the robot says of it.

The keyframe after the placing shows the surface from near. What was not known before and is of the
thing's class must be it: on the receptacle, or beside it and lower. Seen at its height but not over
what is known of it proves nothing, since a receptacle is seldom known whole; seen nowhere proves
nothing either, since detectors miss things. It is said.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from enum import Enum, auto

from helios_core.robot import Observe
from helios_core.types import ObjectInstance

from helios_planner.robot.body import Body
from helios_planner.searching.explore import near_outline
from helios_planner.task import TaskFailed

ON_M = 0.15  # this near to a receptacle's outline is on it
BELOW_M = 0.20  # lower by this than where it was let go is not on it
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
    surface_m: float,
) -> tuple[Seen, ObjectInstance | None]:
    """Where the placed thing is seen; before, now: all instances of its class. surface_m: height
    of what it was put on, where it was let go."""
    believed = [
        o for o in now
        if o.class_score >= least_class_score
        and all(math.dist(o.center_m, b.center_m) > SAME_M for b in before)
        and math.dist(o.center_m[:2], receptacle.center_m[:2]) <= _around_m(receptacle)
    ]  # fmt: skip
    high = [o for o in believed if float(o.center_m[2]) >= surface_m - BELOW_M]
    on = [o for o in high if near_outline(receptacle, o.center_m, ON_M)]
    if on:
        return Seen.ON_IT, max(on, key=lambda o: o.class_score)
    lower = [o for o in believed if float(o.center_m[2]) < surface_m - BELOW_M]
    if lower:
        return Seen.BESIDE_IT, max(lower, key=lambda o: o.class_score)
    return Seen.NOWHERE, None


def look_after(
    body: Body,
    receptacle: ObjectInstance,
    before: Sequence[ObjectInstance],
    now: Callable[[], Sequence[ObjectInstance]],
    least_class_score: float,
    surface_m: float,
) -> tuple[Seen, ObjectInstance | None]:
    """As `seen_after`; what is seen nowhere is looked for once more."""
    seen, thing = seen_after(receptacle, before, now(), least_class_score, surface_m)
    if seen is Seen.NOWHERE:
        # In the image of the placing the map took it for still held. Where no step is left to
        # look once more, it is placed all the same.
        with contextlib.suppress(TaskFailed):
            body.act(Observe())
        seen, thing = seen_after(receptacle, before, now(), least_class_score, surface_m)
    return seen, thing


def _around_m(receptacle: ObjectInstance) -> float:
    return AROUND_M + float(math.hypot(*receptacle.size_m[:2])) / 2
