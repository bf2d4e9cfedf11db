"""What a decision is, and those whether to act, to look again or to search on (section 3.2).

Each function here, in `global_search` and in `frontier_rules` is given what is known and returns a
Decision: the candidates with all terms, the winner, what to do and one sentence of why. Nothing
there asks a map or moves a robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from helios_core.types import ObjectInstance

from helios_planner.decisions import sentences
from helios_planner.decisions.candidate import Candidate

BEST_VIEW = "best view (eq. 11)"
GIVEN_UP = "given up"


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
    """What was decided, among what, why. `winner` is an index into candidates, or None; settings
    are the values that the rule used, memory what it remembered of earlier steps (eq. 8, 9)."""

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


def act_or_look(
    things: Sequence[ViewOption],
    threshold: float,
    tau_inc: float,
    kind: str,
    what: str,
    anywhere: bool = True,
) -> Decision:
    """Pick and place decisions: act at score >= threshold, else one more view where
    Psi' >= min(threshold, Psi + tau_inc), else search on (eq. 11 and the text below it). Unless
    `anywhere`, only what is in its place counts; the rest is remembered."""
    candidates = tuple(
        Candidate(
            kind, t.instance.class_name, position_of(t.instance),
            {
                "class_score": t.instance.class_score,
                "uncertainty": t.instance.uncertainty,
                "score": t.score,
                "views": float(t.instance.views),
                "distance_m": t.distance_m,
                "in_place": float(t.in_place),
                "total": t.total,
            }
            | ({} if t.place == 1 else {"place": t.place})
            | ({} if t.best_score is None else {"score_after_view": t.best_score}),
            t.instance.id,
        )
        for t in things
    )  # fmt: skip
    rule = f"{what} (eq. 7, 11)"
    settings = {"threshold": threshold, "tau_inc": tau_inc, "anywhere": float(anywhere)}
    sure = [  # eq. 7 against tau
        k for k, t in enumerate(things) if t.total >= threshold and (anywhere or t.in_place)
    ]
    if sure:
        k = max(sure, key=lambda k: (things[k].in_place, things[k].total, -things[k].distance_m))
        why = sentences.act(what, candidates[k], threshold, len(sure))
        return Decision(rule, Do.ACT, candidates, k, why, settings)
    worth: list[tuple[float, int]] = []
    for k, t in enumerate(things):
        after = t.best_score if anywhere or t.in_place else None
        if after is not None and after * t.place >= min(threshold, t.total + tau_inc):  # eq. 11
            worth.append((after * t.place, k))
    if worth:
        _, k = max(worth, key=lambda pair: (pair[0], -pair[1]))
        why = sentences.look(candidates[k], threshold, tau_inc)
        return Decision(rule, Do.LOOK, candidates, k, why, settings)
    why = sentences.search_on(what, candidates, threshold, tau_inc, anywhere)
    return Decision(rule, Do.SEARCH_ON, candidates, None, why, settings)


def best_view(
    instance: ObjectInstance, scores: Sequence[float], poses: Sequence[tuple[float, float]]
) -> Decision:
    """The gaze point from which the score would be highest (section 3.2)."""
    candidates = tuple(
        Candidate("gaze", f"view {k + 1} of {instance.class_name}", (*xy, 0.0),
                  {"score_after_view": s, "total": s}, k)
        for k, (s, xy) in enumerate(zip(scores, poses, strict=True))
    )  # fmt: skip
    k = best_of(candidates)
    why = sentences.best_view(instance.class_name, instance.score, candidates, k)
    return Decision(BEST_VIEW, Do.LOOK, candidates, k, why)


def give_up(what: str, thing: ObjectInstance, kind: str, reason: str) -> Decision:
    """What was chosen is not acted on after all, or was in vain. thing: as it was chosen."""
    terms = {
        "class_score": thing.class_score, "uncertainty": thing.uncertainty,
        "score": thing.score, "views": float(thing.views),
    }  # fmt: skip
    left = Candidate(kind, thing.class_name, position_of(thing), terms, thing.id)
    why = sentences.give_up(what, thing.class_name, reason)
    return Decision(GIVEN_UP, Do.SEARCH_ON, (left,), None, why)


def best_of(candidates: Sequence[Candidate]) -> int:
    """Highest total; the nearer on a tie, then the first, so that replays decide alike."""
    return max(
        range(len(candidates)),
        key=lambda k: (
            candidates[k].terms["total"], -candidates[k].terms.get("distance_m", 0.0), -k,
        ),
    )  # fmt: skip


def position_of(instance: ObjectInstance) -> tuple[float, float, float]:
    """Its centre: x, y, z in the world, m."""
    x, y, z = (float(v) for v in instance.center_m)
    return x, y, z
