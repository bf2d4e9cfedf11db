"""Suggested tasks that suit the robot and whose names the detector knows.

They name objects of this home if it has known ones, else common names.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

MIN_SCORE = 0.5  # lowest score Ψ for a suggestion; below it an object is often a detector error
CARRIED_M = 0.4  # longest side of a portable object
SURFACE_M = 0.35  # shortest horizontal side of a receptacle
SURFACE_HEIGHTS_M = (0.2, 1.3)  # of the receptacle's top


# Names that most people and most detectors know, for a home without known objects.
COMMON_OBJECTS = (
    "mug", "apple", "cup", "bottle", "book", "bowl", "laptop", "remote", "banana", "teddy bear",
)  # fmt: skip
COMMON_RECEPTACLES = (
    "coffee table", "kitchen counter", "sofa", "dining table", "couch", "table", "counter", "bed",
    "desk", "chair",
)  # fmt: skip


@dataclass(frozen=True)
class KnownObject:
    """Object of the map: name in words, score Ψ, centre and size in metres, world z up."""

    name: str
    score: float
    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]

    @property
    def is_portable(self) -> bool:
        return max(self.size_m) <= CARRIED_M

    @property
    def is_receptacle(self) -> bool:
        low_m, high_m = SURFACE_HEIGHTS_M
        top_m = self.center_m[2] + self.size_m[2] / 2
        return min(self.size_m[:2]) >= SURFACE_M and low_m <= top_m <= high_m

    def holds(self, thing: KnownObject) -> bool:
        """True if the centre of `thing` is above the centre of this box and inside its outline."""
        return all(
            abs(thing.center_m[i] - self.center_m[i]) <= self.size_m[i] / 2 for i in (0, 1)
        ) and (thing.center_m[2] > self.center_m[2])


def words(name: str) -> str:
    """Class name in words: `coffee table` for `coffee_table`."""
    return name.replace("_", " ")


def suggestions(
    open_names: bool,
    names: Iterable[str],
    has_arm: bool,
    believed: Sequence[KnownObject],
    most: int,
    robot_xy: tuple[float, float] | None = None,
) -> list[str]:
    """At most `most` instructions, those for this home first.

    Next come common names, then other names that the detector knows. `open_names`: the detector
    takes any name. `has_arm`: the robot can pick and place. `robot_xy`: its position (m).
    """
    known = [words(name) for name in names]
    things = [name for name in COMMON_OBJECTS if open_names or name in known]
    places = [name for name in COMMON_RECEPTACLES if open_names or name in known]
    out = [
        *_of_this_home(believed, has_arm, robot_xy),
        *_examples(things, places, has_arm),
        *(f"Find the {name}" for name in known if name not in places),
        *(f"Go to the {name}" for name in places),
    ]
    return list(dict.fromkeys(out))[:most]


def _examples(things: Sequence[str], places: Sequence[str], has_arm: bool) -> list[str]:
    """One task of each kind, with different names if possible; then more tasks to find objects."""
    move = has_arm and bool(things) and len(places) >= 2
    return [
        *([f"Move the {things[0]} from the {places[0]} to the {places[1]}"] if move else []),
        *(f"Find the {name}" for name in things[1:2] or things[:1]),
        *(f"Go to the {name}" for name in places[2:3] or places[-1:]),
        *(f"Find the {name}" for name in things),
    ]


def _of_this_home(
    believed: Sequence[KnownObject], has_arm: bool, robot_xy: tuple[float, float] | None
) -> list[str]:
    """One task of each kind, for the highest scores; among similar scores, for the nearest."""
    x_m, y_m = robot_xy or (0.0, 0.0)

    def rank(one: KnownObject) -> tuple[float, float]:
        away_m = math.hypot(one.center_m[0] - x_m, one.center_m[1] - y_m) if robot_xy else 0.0
        return -round(one.score, 1), away_m

    surest = sorted((b for b in believed if b.score >= MIN_SCORE), key=rank)
    things = [b for b in surest if b.is_portable]
    surfaces = [b for b in surest if b.is_receptacle]
    moves = [_move(t, surfaces) for t in things] if has_arm else []
    moved = next((text for text in moves if text), None)
    return [
        *([moved] if moved else []),
        *(f"Find the {thing.name}" for thing in things[:1]),
        *(f"Go to the {surface.name}" for surface in surfaces[:1]),
    ]


def _move(thing: KnownObject, surfaces: Sequence[KnownObject]) -> str | None:
    """Instruction to move an object, from its receptacle if known, to one of another name."""
    start = next((s.name for s in surfaces if s.holds(thing)), None)
    goal = next((s.name for s in surfaces if s.name not in (start, thing.name)), None)
    if goal is None:
        return None
    return f"Move the {thing.name}{f' from the {start}' if start else ''} to the {goal}"
