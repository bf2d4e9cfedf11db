"""Record of a decision: its candidates with every term, the winner, and the rule that chose it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from helios_core.types import ObjectInstance

from helios_planner.decisions.gain import Gain

# Threshold that every score reaches. It marks the last resort in stored decisions: no other
# threshold is as low, since `Settings` has a lower limit for τ.
ANY_SCORE = -1.0


class DecisionRule(StrEnum):
    """Names of the decision rules, as stored, published and shown.

    A rule for frontiers by value has the layer in its name ("frontier by pick value", "keep the
    frontier by pick value"), and a plug-in's rule has its own name: `Decision.rule` is any text.
    """

    PICK = "pick (eq. 7, 11)"
    PLACE = "place (eq. 7, 11)"
    STOP = "stop (eq. 7, 11)"
    BY_OBJECTIVE = "global search (eq. 8-10)"
    RECEPTACLES_FIRST = "receptacles first"
    BEST_VIEW = "best view (eq. 11)"
    IN_HAND = "look at what is held"
    UNNAMED = "unnamed things"
    GAZE_POINTS_FIRST = "gaze points first"
    TRUST = "trust the detector"
    GIVEN_UP = "given up"
    ABSENT = "not here"
    NEAREST_FRONTIER = "nearest frontier"
    NEAREST_RECEPTACLE = "nearest start receptacle"
    NEAREST_BY_WAY = "nearest frontier by way"
    RANDOM_FRONTIER = "random frontier"
    WAY_THROUGH_UNKNOWN = "way through unknown ground"


class Act(StrEnum):
    """Action on an accepted candidate, and the rule that decides about it."""

    PICK = "pick"
    PLACE = "place"
    STOP = "stop"

    @property
    def rule(self) -> DecisionRule:
        return DecisionRule[self.name]


@dataclass(frozen=True)
class ReceptacleOption:
    """A receptacle that may be searched. information_gain: normalised for eq. 10; bearing_rad: from
    the robot's heading, positive left; gain: what information_gain was computed from, if known."""

    instance: ObjectInstance
    class_score: float
    information_gain: float
    distance_m: float
    bearing_rad: float = 0.0
    gain: Gain | None = None


@dataclass(frozen=True)
class FrontierOption:
    """A frontier that may be driven to. value: of the value layer for the sought class;
    bearing_rad: from the robot's heading, positive left; way_m: length of the path, if known."""

    id: int
    xy_m: tuple[float, float]
    value: float
    distance_m: float
    bearing_rad: float = 0.0
    way_m: float | None = None


@dataclass(frozen=True)
class ViewOption:
    """A candidate with the best score that one more view could bring (eq. 11).

    best_score: None if no new gaze point is left. in_place: False if it does not lie where the
    instruction says, for example not on a start receptacle. place: relative probability, in (0, 1],
    that it lies there, 1 for the most likely receptacle and where it does not count. in_hand:
    probability of its class by an earlier look at it in the hand, 1 without one. Scores are
    multiplied by both.
    """

    instance: ObjectInstance
    score: float
    best_score: float | None
    distance_m: float
    in_place: bool = True
    place: float = 1.0
    in_hand: float = 1.0

    @property
    def factor(self) -> float:
        """Factor of all scores of the candidate."""
        return self.place * self.in_hand

    @property
    def total(self) -> float:
        """Score that decides about the candidate."""
        return self.score * self.factor


@dataclass(frozen=True)
class CompleteSearch:
    """A search of everything in reach. number: of complete searches so far, at least 1. floor_m2:
    area that was searched. start: class of the start receptacle, empty if none is named.
    start_score: highest Ψ of one. tried: unnamed things that were looked at in the hand.
    set_aside: probability of each thing that was put back and may be brought at the end."""

    number: int
    floor_m2: float
    start: str = ""
    start_score: float = 0.0
    tried: int = 0
    set_aside: tuple[float, ...] = ()


class Do(StrEnum):
    """Action that a decision orders."""

    SEARCH_RECEPTACLE = "search_receptacle"
    GO_TO_FRONTIER = "go_to_frontier"
    ACT = "act"  # on an accepted candidate: pick, place, or stop there
    LOOK = "look"  # take one more view
    SEARCH_ON = "search_on"
    NOTHING_LEFT = "nothing_left"


@dataclass(frozen=True)
class Decision:
    """One decision with its candidates and its reason.

    rule: a `DecisionRule` or another name; winner: an index into candidates, or None; settings: the
    values that the rule used; memory: values of earlier steps that the rule used (eq. 8, 9), and
    the gains of the receptacles before they were normalised.
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
        """The winner. Raises LookupError if there is none."""
        if self.winner is None:
            raise LookupError(f"the decision {self.rule} has no winner: {self.why}")
        return self.candidates[self.winner]


@dataclass(frozen=True)
class Candidate:
    """One option of a decision with its terms. kind: object, receptacle, frontier or gaze; in a
    decision's memory: first_seen, chosen_frontier or gain."""

    kind: str
    name: str
    position_m: tuple[float, float, float]
    terms: dict[str, float]
    id: int = 0
