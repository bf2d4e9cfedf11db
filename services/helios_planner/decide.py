"""Decisions of the flow (section 3.2, appendix 6.1): which receptacle or frontier, whether to act.

Each function is given what is known and returns a Decision: the candidates with all terms, the
winner, what to do and one sentence of why. Nothing here asks a map or moves a robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from helios_core.types import ObjectInstance

from helios_planner.objective import (
    SearchMemory,
    candidate_value,
    frontier_scale,
    frontier_value,
)


class Do(StrEnum):
    """What a decision says to do."""

    SEARCH_RECEPTACLE = "search_receptacle"
    GO_TO_FRONTIER = "go_to_frontier"
    ACT = "act"  # sure enough: pick, place, or stop there
    LOOK = "look"  # one more view
    SEARCH_ON = "search_on"
    NOTHING_LEFT = "nothing_left"


@dataclass(frozen=True)
class Candidate:
    """One option with its terms. kind: object, receptacle, frontier or gaze."""

    kind: str
    name: str
    position_m: tuple[float, float, float]
    terms: dict[str, float]
    id: int = 0


@dataclass(frozen=True)
class Decision:
    """What was decided, among what, why. `winner` is an index into candidates, or None."""

    rule: str
    do: Do
    candidates: tuple[Candidate, ...]
    winner: int | None
    why: str
    settings: dict[str, float] = field(default_factory=dict)

    @property
    def chosen(self) -> Candidate:
        """The winner; only where there is one."""
        if self.winner is None:
            raise LookupError(f"the decision {self.rule} has no winner: {self.why}")
        return self.candidates[self.winner]


@dataclass(frozen=True)
class ReceptacleOption:
    """A receptacle that may be searched. information_gain as normalised for eq. 10."""

    instance: ObjectInstance
    class_score: float
    information_gain: float
    distance_m: float


@dataclass(frozen=True)
class FrontierOption:
    """A frontier that may be driven to, and its value for what is sought."""

    id: int
    xy_m: tuple[float, float]
    value: float
    distance_m: float


@dataclass(frozen=True)
class ViewOption:
    """A candidate thing with the best score that one more view could bring (eq. 11).

    best_score is None where no new gaze point is left."""

    instance: ObjectInstance
    score: float
    best_score: float | None
    distance_m: float
    preferred: bool = False  # where it should be, for example on the start receptacle


def global_search(
    receptacles: Sequence[ReceptacleOption],
    frontiers: Sequence[FrontierOption],
    memory: SearchMemory,
    alpha_d: float,
) -> Decision:
    """Candidate start receptacles and frontiers by eq. 10."""
    scale = frontier_scale(memory, alpha_d)
    candidates = [
        Candidate(
            "receptacle", r.instance.class_name, _position(r.instance),
            {
                "class_score": r.class_score,
                "information_gain": r.information_gain,
                "distance_m": r.distance_m,
                "total": candidate_value(
                    r.class_score, r.information_gain, r.distance_m, alpha_d
                ),
            },
            r.instance.id,
        )
        for r in receptacles
    ]  # fmt: skip
    candidates += [
        Candidate(
            "frontier", f"frontier {f.id}", (*f.xy_m, 0.0),
            {
                "value": f.value,
                "frontier_scale": scale,
                "distance_m": f.distance_m,
                "total": frontier_value(f.value, scale, f.distance_m, alpha_d),
            },
            f.id,
        )
        for f in frontiers
    ]  # fmt: skip
    settings = {"alpha_d": alpha_d, "frontier_scale": scale}
    rule = "global search (eq. 8-10)"
    if not candidates:
        why = "no receptacle is left to search and no frontier to explore"
        return Decision(rule, Do.NOTHING_LEFT, (), None, why, settings)
    k = _best(candidates)
    best = candidates[k]
    total = best.terms["total"]
    if best.kind == "receptacle":
        why = (
            f"search the {best.name}: class score {best.terms['class_score']:.2f} times gain "
            f"{best.terms['information_gain']:.2f} at {best.terms['distance_m']:.1f} m gives "
            f"{total:.3f}, the best of {len(candidates)}"
        )
        return Decision(rule, Do.SEARCH_RECEPTACLE, tuple(candidates), k, why, settings)
    why = (
        f"explore {best.name}: value {best.terms['value']:.2f} times {scale:.2f} at "
        f"{best.terms['distance_m']:.1f} m gives {total:.3f}, the best of {len(candidates)}"
    )
    return Decision(rule, Do.GO_TO_FRONTIER, tuple(candidates), k, why, settings)


def frontier_by_value(frontiers: Sequence[FrontierOption], layer: str) -> Decision:
    """The frontier with the highest value of a layer; the nearer one on a tie."""
    candidates = tuple(
        Candidate("frontier", f"frontier {f.id}", (*f.xy_m, 0.0),
                  {"value": f.value, "distance_m": f.distance_m, "total": f.value}, f.id)
        for f in frontiers
    )  # fmt: skip
    rule = f"frontier by {layer} value"
    if not candidates:
        return Decision(rule, Do.NOTHING_LEFT, (), None, "no frontier is left to explore")
    k = _best(candidates)
    best = candidates[k].terms
    why = (
        f"explore {candidates[k].name}: its {layer} value {best['value']:.2f} is the highest of "
        f"{len(candidates)}, {best['distance_m']:.1f} m away"
    )
    return Decision(rule, Do.GO_TO_FRONTIER, candidates, k, why)


def act_or_look(
    things: Sequence[ViewOption], threshold: float, tau_inc: float, kind: str, what: str
) -> Decision:
    """Pick and place decisions: act at score >= threshold, else one more view where
    Psi' >= min(threshold, Psi + tau_inc), else search on (eq. 11 and the text below it)."""
    candidates = tuple(
        Candidate(
            kind, t.instance.class_name, _position(t.instance),
            {
                "class_score": t.instance.class_score,
                "uncertainty": t.instance.uncertainty,
                "score": t.score,
                "views": float(t.instance.views),
                "distance_m": t.distance_m,
                "preferred": float(t.preferred),
                "total": t.score,
            }
            | ({} if t.best_score is None else {"score_after_view": t.best_score}),
            t.instance.id,
        )
        for t in things
    )  # fmt: skip
    rule = f"{what} (eq. 7, 11)"
    settings = {"threshold": threshold, "tau_inc": tau_inc}
    sure = [k for k, t in enumerate(things) if t.score >= threshold]
    if sure:
        k = max(sure, key=lambda k: (things[k].preferred, things[k].score, -things[k].distance_m))
        why = (
            f"{what} the {candidates[k].name}: its score {things[k].score:.2f} is at least "
            f"{threshold:.2f} after {things[k].instance.views} views"
        )
        return Decision(rule, Do.ACT, candidates, k, why, settings)
    worth: list[tuple[float, int]] = []
    for k, t in enumerate(things):
        after = t.best_score
        if after is not None and after >= min(threshold, t.score + tau_inc):  # below eq. 11
            worth.append((after, k))
    if worth:
        after, k = max(worth, key=lambda pair: (pair[0], -pair[1]))
        why = (
            f"look again at the {candidates[k].name}: one more view could raise its score from "
            f"{things[k].score:.2f} to {after:.2f}"
        )
        return Decision(rule, Do.LOOK, candidates, k, why, settings)
    why = (
        f"search on: no candidate to {what} reaches {threshold:.2f} and no view would help"
        if things
        else f"search on: no candidate to {what} yet"
    )
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
    k = _best(candidates)
    why = f"of {len(scores)} views, this one would raise the score most, to {scores[k]:.2f}"
    return Decision("best view (eq. 11)", Do.LOOK, candidates, k, why)


def _best(candidates: Sequence[Candidate]) -> int:
    """Highest total; the nearer on a tie, then the first, so that replays decide alike."""
    return max(
        range(len(candidates)),
        key=lambda k: (
            candidates[k].terms["total"], -candidates[k].terms.get("distance_m", 0.0), -k,
        ),
    )  # fmt: skip


def _position(instance: ObjectInstance) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in instance.center_m)
    return x, y, z
