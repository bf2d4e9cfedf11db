"""Another look at everything: from place to place over known ground, looking all around.

Where no frontier is left, what is sought was in view, and was not taken for it. A detector errs by
thing and viewpoint, so views from elsewhere may tell. The paper leaves open how a home is searched
once more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from helios_planner.ground.grid import Pose2
from helios_planner.ground.motion import Reach
from helios_planner.moving.legs import Legs, Outcome

GRID_M = 0.2  # between the places that are considered


class Patrol:
    """Goes to the nearest place that is `apart_m` from all places where it has looked around."""

    def __init__(self, legs: Legs, apart_m: float) -> None:
        self._legs, self._apart_m = legs, apart_m
        self.seen_from: list[tuple[float, float]] = []  # x, y in m

    def begin(self) -> None:
        """Anew, from where the robot has just looked around."""
        self.seen_from = [self._legs.body.pose().xy]

    def step(self, purpose: str, found: Callable[[], bool]) -> bool:
        """Go to one more place and look around there, until `found`; False when none is left."""
        place = next_place(self._legs.reach(), self.seen_from, self._apart_m)
        if place is None:
            return False
        pose = self._legs.body.pose()
        goal = Pose2(*place, pose.yaw_rad)
        outcome = self._legs.go_to(goal, purpose, found, face=False)
        if outcome is Outcome.INTERRUPTED:
            return True
        self.seen_from.append(place)
        if outcome is Outcome.ARRIVED:
            self._legs.turn_around(found)
        return True


def next_place(
    reached: Reach, seen_from: Sequence[tuple[float, float]], apart_m: float
) -> tuple[float, float] | None:
    """The place with the shortest way that is `apart_m` or more from all of these; None where there
    is none. Places are world x, y in m."""
    stride = max(1, round(GRID_M / reached.ground.cell_m))
    arrival = reached.arrival[::stride, ::stride]
    cells = np.argwhere(np.isfinite(arrival))
    if not len(cells):
        return None
    xy = reached.ground.centres_of(cells * stride)
    far = np.ones(len(xy), bool)
    for x_m, y_m in seen_from:
        far &= np.hypot(xy[:, 0] - x_m, xy[:, 1] - y_m) >= apart_m
    if not far.any():
        return None
    way = np.where(far, arrival[cells[:, 0], cells[:, 1]], np.inf)
    k = int(np.argmin(way))
    return float(xy[k, 0]), float(xy[k, 1])
