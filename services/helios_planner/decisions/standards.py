"""How sure an agent must be before it acts, and when it settles for less.

The paper acts on the first candidate whose score passes one threshold. But of the many things in a
home some false one passes it too, the earlier the more places are still unseen, and a wrong pick or
place is not undone. A patient agent acts at once only on what is nearly beyond doubt. It goes on
searching for the rest, and takes the best it knows when nothing is left to search or when its share
of the steps is used up: by then what is sought is likely to be among what was seen, and the
candidates can be compared.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

# Shares of the threshold: at first, and down to what is taken when patience ends.
_OF_OBJECTS = (1.25, 1.0, 0.75, 0.5)
_OF_RECEPTACLES = (1.4, 1.2, 1.0, 0.75, 0.5)
PATIENCE = 0.6  # share of the steps that are left when the search begins
ANY_SCORE = -1.0  # below every score, and no threshold that can be set


@dataclass(frozen=True)
class Standard:
    """What a candidate must meet. anywhere: wherever it is, not only where it was said to be."""

    score: float
    anywhere: bool


@dataclass(frozen=True)
class Standards:
    """From the highest down. firm: how many of them hold until everything was searched twice.
    patience: share of the steps that are left when the search begins, after which the lowest holds,
    the others at even distances before; None: steps do not count. by_place: a candidate's score
    counts times how likely it is where it was said to be. at_last: share of the task's steps after
    which the last one holds, which patience leaves out."""

    steps: tuple[Standard, ...]
    firm: int
    patience: float | None = None
    by_place: bool = False
    at_last: float | None = None

    def least_at(self, used: float, since: float) -> int:
        """How far down to be by now. used, since: share of the task's steps, now and when the
        search began."""
        usual = len(self.steps) - (self.at_last is not None)
        if self.at_last is not None and used >= self.at_last:
            return usual
        if self.patience is None:
            return 0
        gone = max(used - since, 0.0) / max(self.patience * (1 - since), 1e-9)
        return min(int(gone * usual), usual - 1)


Rule = Callable[[float, bool], Standards]  # threshold of Table 3, whether its place is known


def paper(threshold: float, place_known: bool) -> Standards:
    """One threshold (τ of Table 3); at first only in its place, where that is known."""
    anywhere = (Standard(threshold, True),)
    steps = (Standard(threshold, False), *anywhere) if place_known else anywhere
    return Standards(steps, len(steps))


def patient(threshold: float, place_known: bool) -> Standards:
    """Sure, then the threshold, then the best there is."""
    shares = _OF_OBJECTS if place_known else _OF_RECEPTACLES
    steps = tuple(Standard(share * threshold, True) for share in shares)
    firm = sum(share >= 1 for share in shares)
    return Standards(steps, firm, PATIENCE, by_place=place_known)


def in_the_end(within: Standards, at_last: float) -> Standards:
    """The same, and after that share of the task's steps anything that may be it at all.

    The paper is silent on what to do when everything has been searched in vain, or the steps run
    out: the likeliest thing is brought, to the likeliest place, and that is said.
    """
    return replace(within, steps=(*within.steps, Standard(ANY_SCORE, True)), at_last=at_last)
