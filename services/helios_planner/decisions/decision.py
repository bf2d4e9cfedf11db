"""A decision as data: its candidates with every term, the winner, and the rule that chose it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from helios_core.types import ObjectInstance

ANY_SCORE = -1.0  # below every score, and no threshold that can be set


class DecisionRule(StrEnum):
    """The rules that take decisions, as they are kept, sent and shown.

    A frontier by its value is named with its layer ("frontier by pick value"), and a rule of a
    plug-in by its own name: `Decision.rule` is any text.
    """

    PICK = "pick (eq. 7, 11)"
    PLACE = "place (eq. 7, 11)"
    STOP = "stop (eq. 7, 11)"
    BY_OBJECTIVE = "global search (eq. 8-10)"
    RECEPTACLES_FIRST = "receptacles first"
    BEST_VIEW = "best view (eq. 11)"
    GIVEN_UP = "given up"
    NEAREST_FRONTIER = "nearest frontier"
    NEAREST_BY_WAY = "nearest frontier by way"
    RANDOM_FRONTIER = "random frontier"
    WAY_THROUGH_UNKNOWN = "way through unknown ground"


class Act(StrEnum):
    """What is done with a candidate that is good enough, and the rule that decides about it."""

    PICK = "pick"
    PLACE = "place"
    STOP = "stop"

    @property
    def rule(self) -> DecisionRule:
        return DecisionRule[self.name]


@dataclass(frozen=True)
class ReceptacleOption:
    """A receptacle that may be searched. information_gain as normalised for eq. 10; bearing_rad
    from the robot's heading, positive left."""

    instance: ObjectInstance
    class_score: float
    information_gain: float
    distance_m: float
    bearing_rad: float = 0.0


@dataclass(frozen=True)
class FrontierOption:
    """A frontier that may be driven to, and its value for what is sought; bearing_rad from the
    robot's heading, positive left."""

    id: int
    xy_m: tuple[float, float]
    value: float
    distance_m: float
    bearing_rad: float = 0.0


@dataclass(frozen=True)
class ViewOption:
    """A candidate thing with the best score that one more view could bring (eq. 11).

    best_score is None where no new gaze point is left; one that is not `in_place` is not where it
    was said to be, for example not on a start receptacle. Scores count times `place`: how likely it
    is where it was said to be, beside the likeliest place; 1 where that does not count."""

    instance: ObjectInstance
    score: float
    best_score: float | None
    distance_m: float
    in_place: bool = True
    place: float = 1.0

    @property
    def total(self) -> float:
        """What the thing is judged by."""
        return self.score * self.place


class Do(StrEnum):
    """What a decision says to do."""

    SEARCH_RECEPTACLE = "search_receptacle"
    GO_TO_FRONTIER = "go_to_frontier"
    ACT = "act"  # sure enough: pick, place, or stop there
    LOOK = "look"  # one more view
    SEARCH_ON = "search_on"
    NOTHING_LEFT = "nothing_left"


@dataclass(frozen=True)
class Decision:
    """What was decided, among what, why.

    rule: a `DecisionRule` or another name; winner: an index into candidates, or None; settings: the
    values that the rule used; memory: what it remembered of earlier steps (eq. 8, 9).
    """

    rule: str
    do: Do
    candidates: tuple[Candidate, ...]
    winner: int | None
    why: str
    settings: dict[str, float] = field(default_factory=dict)
    memory: tuple[Candidate, ...] = ()

    @property
    def chosen(self) -> Candidate:
        """The winner; only where there is one."""
        if self.winner is None:
            raise LookupError(f"the decision {self.rule} has no winner: {self.why}")
        return self.candidates[self.winner]


@dataclass(frozen=True)
class Candidate:
    """One option with its terms. kind: object, receptacle, frontier or gaze; of what a decision
    remembers: first_seen or chosen_frontier."""

    kind: str
    name: str
    position_m: tuple[float, float, float]
    terms: dict[str, float]
    id: int = 0
