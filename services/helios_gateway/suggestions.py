"""Tasks to try: of names that the detector knows, that this robot can do, and of this home where
something of it is known."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

SURE_SCORE = 0.3  # from this score Ψ on something seen is worth a task
CARRIED_M = 0.4  # longest side of what a robot may carry
SURFACE_M = 0.35  # shortest horizontal side of a piece of furniture that holds something
SURFACE_HEIGHTS_M = (0.2, 1.3)  # of its top


@dataclass(frozen=True)
class Try:
    """A task by names alone."""

    text: str
    names: tuple[str, ...]
    moves: bool = False  # needs an arm


EXAMPLES = (
    Try(
        "Move the mug from the coffee table to the kitchen counter",
        ("mug", "coffee table", "kitchen counter"),
        moves=True,
    ),
    Try("Find the apple", ("apple",)),
    Try("Go to the sofa", ("sofa",)),
)


@dataclass(frozen=True)
class Believed:
    """An object of the map: name in words, score Ψ, centre and size in metres, world z up."""

    name: str
    score: float
    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]

    @property
    def is_thing(self) -> bool:
        return max(self.size_m) <= CARRIED_M

    @property
    def is_surface(self) -> bool:
        low_m, high_m = SURFACE_HEIGHTS_M
        top_m = self.center_m[2] + self.size_m[2] / 2
        return min(self.size_m[:2]) >= SURFACE_M and low_m <= top_m <= high_m

    def holds(self, thing: Believed) -> bool:
        """Whether the thing's centre is above its box, seen from above."""
        return all(
            abs(thing.center_m[i] - self.center_m[i]) <= self.size_m[i] / 2 for i in (0, 1)
        ) and (thing.center_m[2] > self.center_m[2])


def words(name: str) -> str:
    """`coffee_table` as people say it."""
    return name.replace("_", " ")


def suggestions(
    open_names: bool, names: Iterable[str], has_arm: bool, believed: Sequence[Believed], most: int
) -> list[str]:
    """At most so many instructions: of what was seen here, then examples, then of known names.

    `open_names`: the detector takes any name. `has_arm`: the robot can pick and place.
    """
    known = [words(name) for name in names]
    examples = [
        t for t in EXAMPLES
        if (has_arm or not t.moves) and (open_names or all(name in known for name in t.names))
    ]  # fmt: skip
    named = {name for t in examples for name in t.names}
    out = [
        *_of_this_home(believed, has_arm),
        *(t.text for t in examples),
        *(f"Find the {name}" for name in known if name not in named),
    ]
    return list(dict.fromkeys(out))[:most]


def _of_this_home(believed: Sequence[Believed], has_arm: bool) -> list[str]:
    """One task of each kind, of what is surest."""
    surest = sorted((b for b in believed if b.score >= SURE_SCORE), key=lambda b: -b.score)
    things = [b for b in surest if b.is_thing]
    surfaces = [b for b in surest if b.is_surface]
    moves = [_move(t, surfaces) for t in things] if has_arm else []
    moved = next((text for text in moves if text), None)
    return [
        *([moved] if moved else []),
        *(f"Find the {thing.name}" for thing in things[:1]),
        *(f"Go to the {surface.name}" for surface in surfaces[:1]),
    ]


def _move(thing: Believed, surfaces: Sequence[Believed]) -> str | None:
    """From where it is, where that is known, to a piece of furniture of another name."""
    start = next((s.name for s in surfaces if s.holds(thing)), None)
    goal = next((s.name for s in surfaces if s.name not in (start, thing.name)), None)
    if goal is None:
        return None
    return f"Move the {thing.name}{f' from the {start}' if start else ''} to the {goal}"
