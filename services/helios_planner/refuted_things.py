"""Things that looked wrong in the hand, remembered over the tasks of one world. Not in the paper.

Within a task the search keeps them itself. A later task that seeks the same name leaves them until
nothing better is found, and then looks at them again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from helios_planner.match_radii import SAME_INSTANCE_M

KEPT_S = 12 * 3600.0  # somebody may have put another thing there since


@dataclass(frozen=True)
class RefutedThing:
    """A thing that was put back. class_name: the name that it is not; center_m: where it lies,
    world; probability: that it has the name all the same; unnamed: True if it was no candidate of
    the object map; at_s: when it was put back, Unix time."""

    class_name: str
    center_m: tuple[float, float, float]
    probability: float
    unnamed: bool
    at_s: float


class RefutedThings:
    """The refuted things of one world."""

    def __init__(
        self,
        known: Iterable[RefutedThing] = (),
        save: Callable[[list[RefutedThing]], object] = lambda things: None,
    ) -> None:
        """known: from earlier tasks; save: called with all of them after each change."""
        self._things, self._save = list(known), save

    def add(self, thing: RefutedThing) -> None:
        """Remember a thing; it replaces an earlier look at the same place."""
        self._things = [*self._others(thing.class_name, thing.center_m), thing]
        self._save(self._things)

    def forget(self, class_name: str, center_m: tuple[float, float, float]) -> None:
        """Forget a place, since the thing that lay there has the name, or lies there no longer."""
        left = self._others(class_name, center_m)
        if len(left) < len(self._things):
            self._things = left
            self._save(left)

    def of(self, class_name: str) -> list[RefutedThing]:
        """Those that a search for a class leaves for the end, oldest first."""
        return [t for t in self._things if t.class_name == class_name and _is_fresh(t)]

    def _others(self, name: str, center_m: tuple[float, float, float]) -> list[RefutedThing]:
        """Those of other places or names that are not too old."""
        return [
            t
            for t in filter(_is_fresh, self._things)
            if t.class_name != name or math.dist(t.center_m, center_m) >= SAME_INSTANCE_M
        ]


def _is_fresh(thing: RefutedThing) -> bool:
    """False for an old thing, and for one from the future: the clock was set back since then."""
    return abs(time.time() - thing.at_s) <= KEPT_S
