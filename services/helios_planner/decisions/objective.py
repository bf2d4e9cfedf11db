"""The global search objective (eq. 8, 9 and 10).

Units: the paper multiplies a class score by an information gain that is summed over all Gaussians
of a candidate and subtracts metres times alpha_d. With thousands of Gaussians the distance hardly
counts and the largest receptacle always wins, so by default the gain is divided by the number of
Gaussians (`per_gaussian`: nats a Gaussian, roughly 0 to 3); `sum` is the paper's rule.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

GainNorm = Literal["per_gaussian", "sum"]


def normalised_gain(gain_nats: float, gaussians: int, norm: GainNorm) -> float:
    """Information gain of a candidate in the units of eq. 10; never below 0."""
    gain = max(gain_nats, 0.0)
    return gain / max(gaussians, 1) if norm == "per_gaussian" else gain


@dataclass(frozen=True)
class FirstSeen:
    """What a candidate was worth when it was first seen: S_a0 * IG_a0, and its centre."""

    class_score: float
    information_gain: float
    center_xy_m: tuple[float, float]

    @property
    def worth(self) -> float:
        return self.class_score * self.information_gain


@dataclass(frozen=True)
class ChosenFrontier:
    """A frontier that was once chosen, and its value at that time."""

    xy_m: tuple[float, float]
    value_when_chosen: float


@dataclass
class SearchMemory:
    """What eq. 8 and 9 remember over one search."""

    first_seen: dict[int, FirstSeen] = field(default_factory=dict)
    chosen: list[ChosenFrontier] = field(default_factory=list)

    def note(self, id: int, seen: FirstSeen) -> None:
        """Store a candidate the first time only."""
        self.first_seen.setdefault(id, seen)

    def as_json(self) -> dict[str, Any]:
        return {
            "first_seen": [
                [id, s.class_score, s.information_gain, *s.center_xy_m]
                for id, s in self.first_seen.items()
            ],
            "chosen": [[*f.xy_m, f.value_when_chosen] for f in self.chosen],
        }

    @staticmethod
    def of_json(memory: Mapping[str, Any]) -> SearchMemory:
        """What `as_json` wrote."""
        seen = {int(id): FirstSeen(s, ig, (x, y)) for id, s, ig, x, y in memory["first_seen"]}
        return SearchMemory(seen, [ChosenFrontier((x, y), v) for x, y, v in memory["chosen"]])


def estimated_value(
    frontier_xy_m: tuple[float, float], seen: Mapping[int, FirstSeen], alpha_d: float
) -> float:
    """V_0 of a frontier that was chosen before (eq. 8); `seen` must not be empty."""
    return max(  # eq. 8
        s.worth - alpha_d * math.dist(s.center_xy_m, frontier_xy_m) for s in seen.values()
    )


def frontier_scale(memory: SearchMemory, alpha_d: float) -> float:
    """F_0, which turns a frontier's value into a candidate's worth (eq. 9).

    1 where it is not defined: no chosen frontier, no candidate, a value of zero or so small that
    the ratio is infinite; and where the mean ratio is not above 0, since a negative scale would
    reverse the order of the frontiers.
    """
    usable: Sequence[ChosenFrontier] = [f for f in memory.chosen if f.value_when_chosen > 0]
    if not usable or len(usable) < len(memory.chosen) or not memory.first_seen:
        return 1.0
    ratios = [  # eq. 9
        estimated_value(f.xy_m, memory.first_seen, alpha_d) / f.value_when_chosen for f in usable
    ]
    mean = sum(ratios) / len(ratios)
    return mean if 0 < mean < math.inf else 1.0


def candidate_value(
    class_score: float, information_gain: float, distance_m: float, alpha_d: float
) -> float:
    """V of a candidate receptacle (eq. 10, first case)."""
    return class_score * information_gain - alpha_d * distance_m  # eq. 10


def frontier_value(value: float, scale: float, distance_m: float, alpha_d: float) -> float:
    """V of a frontier (eq. 10, second case)."""
    return value * scale - alpha_d * distance_m  # eq. 10
