"""The global search objective (eq. 8, 9 and 10), and the rules that choose among frontiers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from typing import Any

import numpy as np

from helios_planner.decisions import explanations
from helios_planner.decisions.acceptance import Candidate, best_of, position_of
from helios_planner.decisions.decision import (
    Decision,
    DecisionRule,
    Do,
    FrontierOption,
    ReceptacleOption,
)
from helios_planner.decisions.gain import Gain
from helios_planner.match_radii import SAME_FRONTIER_M

KEPT_VALUE = 0.01  # fall of its value from which VLFM leaves the last frontier
FrontierRule = Callable[[Sequence[FrontierOption], str, np.random.Generator], Decision]


@dataclass(frozen=True)
class FirstSeen:
    """Terms of a candidate when it was first seen, S_a0 and IG_a0 of eq. 8, and its centre. gain:
    what IG_a0 was computed from, if known."""

    class_score: float
    information_gain: float
    center_xy_m: tuple[float, float]
    gain: Gain | None = None

    @property
    def worth(self) -> float:
        return self.class_score * self.information_gain


@dataclass(frozen=True)
class ChosenFrontier:
    """A frontier that was chosen before, and its value at that time."""

    xy_m: tuple[float, float]
    value_when_chosen: float


@dataclass
class SearchMemory:
    """Values that eq. 8 and 9 keep over one search.

    The paper stores a frontier's location and current score when it chooses it, and F' is a set. So
    a frontier that is chosen again stands once in it, with the location and the value of the last
    time. Its centre moves as ground is seen: within `SAME_FRONTIER_M` it is the same.
    """

    first_seen: dict[int, FirstSeen] = field(default_factory=dict)
    chosen: list[ChosenFrontier] = field(default_factory=list)

    def note(self, id: int, seen: FirstSeen) -> None:
        """Store a candidate the first time only."""
        self.first_seen.setdefault(id, seen)

    def choose(self, frontier: ChosenFrontier) -> None:
        """Store a chosen frontier; it replaces the nearest stored one that is the same."""
        apart_m, same = min(
            ((math.dist(f.xy_m, frontier.xy_m), k) for k, f in enumerate(self.chosen)),
            default=(math.inf, -1),
        )
        if apart_m <= SAME_FRONTIER_M:
            del self.chosen[same]
        self.chosen.append(frontier)

    def as_json(self) -> dict[str, Any]:
        return {
            "first_seen": [
                [
                    id,
                    s.class_score,
                    s.information_gain,
                    *s.center_xy_m,
                    *(astuple(s.gain) if s.gain else ()),
                ]
                for id, s in self.first_seen.items()
            ],
            "chosen": [[*f.xy_m, f.value_when_chosen] for f in self.chosen],
        }

    @staticmethod
    def of_json(memory: Mapping[str, Any]) -> SearchMemory:
        """Inverse of `as_json`."""
        seen = {
            int(id): FirstSeen(s, ig, (x, y), Gain(*gain) if gain else None)
            for id, s, ig, x, y, *gain in memory["first_seen"]
        }
        return SearchMemory(seen, [ChosenFrontier((x, y), v) for x, y, v in memory["chosen"]])


def estimated_value(
    frontier_xy_m: tuple[float, float], seen: Mapping[int, FirstSeen], alpha_d: float
) -> float:
    """Estimated value V_0 of a previously chosen frontier (eq. 8); `seen` must not be empty."""
    return max(  # eq. 8
        s.worth - alpha_d * math.dist(s.center_xy_m, frontier_xy_m) for s in seen.values()
    )


def frontier_scale(memory: SearchMemory, alpha_d: float) -> float:
    """Scale F_0, which turns a frontier's value into a candidate's worth (eq. 9).

    1 where F_0 is undefined: no chosen frontier, no candidate, or a value of zero or so small that
    the ratio is infinite. Also 1 if the mean ratio is not above 0, since a negative scale would
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
    """Value V of a candidate receptacle (eq. 10, first case)."""
    return class_score * information_gain - alpha_d * distance_m  # eq. 10


def frontier_value(value: float, scale: float, distance_m: float, alpha_d: float) -> float:
    """Value V of a frontier (eq. 10, second case)."""
    return value * scale - alpha_d * distance_m  # eq. 10


@dataclass(frozen=True)
class ExplorationOption:
    """A frontier of an exploration task: its length and the length of the path to it, in metres."""

    id: int
    xy_m: tuple[float, float]
    size_m: float
    way_m: float
    distance_m: float


def nearest_by_way(frontiers: Sequence[ExplorationOption]) -> Decision:
    """Decision for the frontier with the shortest path, for exploration tasks."""
    candidates = tuple(
        Candidate(
            "frontier",
            f"frontier {f.id}",
            (*f.xy_m, 0.0),
            {"way_m": f.way_m, "size_m": f.size_m, "distance_m": f.distance_m, "total": -f.way_m},
            f.id,
        )
        for f in frontiers
    )
    if not candidates:
        return _nothing(DecisionRule.NEAREST_BY_WAY)
    k = best_of(candidates)
    why = explanations.nearest_way(candidates, k)
    return Decision(DecisionRule.NEAREST_BY_WAY, Do.GO_TO_FRONTIER, candidates, k, why)


def highest_value(
    frontiers: Sequence[FrontierOption], layer: str, _: np.random.Generator
) -> Decision:
    """Decision for the frontier with the highest value of a layer; the nearer one on a tie."""
    return _highest(frontiers, layer)


def nearest(frontiers: Sequence[FrontierOption], layer: str, _: np.random.Generator) -> Decision:
    """Decision for the frontier with the shortest path, whatever its value. A frontier whose path
    is unknown counts by its distance."""
    return _nearest(frontiers)


def _nearest(frontiers: Sequence[FrontierOption]) -> Decision:
    ways = [f.distance_m if f.way_m is None else f.way_m for f in frontiers]
    candidates = tuple(
        replace(c, terms=c.terms | {"way_m": way_m, "total": -way_m})
        for c, way_m in zip(_listed(frontiers, ways), ways, strict=True)
    )
    if not candidates:
        return _nothing(DecisionRule.NEAREST_FRONTIER)
    k = best_of(candidates)
    why = explanations.nearest_frontier(candidates, k)
    return Decision(DecisionRule.NEAREST_FRONTIER, Do.GO_TO_FRONTIER, candidates, k, why)


def kept(frontiers: Sequence[FrontierOption], layer: str, last: ChosenFrontier | None) -> Decision:
    """VLFM's decision: the last chosen frontier while its value has not fallen since, else the one
    with the highest value of a layer."""
    decision = _highest(frontiers, layer)
    if last is None or decision.winner is None:
        return decision
    near = [
        (math.dist(f.xy_m, last.xy_m), k)
        for k, f in enumerate(frontiers)
        if math.dist(f.xy_m, last.xy_m) <= SAME_FRONTIER_M
    ]
    if not near:
        return decision
    _, k = min(near)
    if frontiers[k].value + KEPT_VALUE <= last.value_when_chosen:
        return decision
    why = explanations.kept_frontier(decision.candidates, k, layer, last.value_when_chosen)
    return replace(decision, rule=f"keep the frontier by {layer} value", winner=k, why=why)


def drawn(frontiers: Sequence[FrontierOption], layer: str, rng: np.random.Generator) -> Decision:
    """Decision for a random frontier, all with equal probability."""
    candidates = _listed(frontiers, [0.0 for _ in frontiers])
    if not candidates:
        return _nothing(DecisionRule.RANDOM_FRONTIER)
    k = int(rng.integers(len(candidates)))
    why = explanations.drawn_frontier(candidates, k)
    return Decision(DecisionRule.RANDOM_FRONTIER, Do.GO_TO_FRONTIER, candidates, k, why)


def _highest(frontiers: Sequence[FrontierOption], layer: str) -> Decision:
    candidates = _listed(frontiers, [f.value for f in frontiers])
    rule = f"frontier by {layer} value"
    if not candidates:
        return _nothing(rule)
    k = best_of(candidates)
    why = explanations.highest_frontier(candidates, k, layer)
    return Decision(rule, Do.GO_TO_FRONTIER, candidates, k, why)


def _listed(frontiers: Sequence[FrontierOption], totals: Sequence[float]) -> tuple[Candidate, ...]:
    return tuple(
        Candidate(
            "frontier",
            f"frontier {f.id}",
            (*f.xy_m, 0.0),
            {"value": f.value, "distance_m": f.distance_m, "total": total},
            f.id,
        )
        for f, total in zip(frontiers, totals, strict=True)
    )


def _nothing(rule: str) -> Decision:
    return Decision(rule, Do.NOTHING_LEFT, (), None, explanations.nothing_left(receptacles=False))


SearchRule = Callable[
    [Sequence[ReceptacleOption], Sequence[FrontierOption], SearchMemory, float], Decision
]


def by_objective(
    receptacles: Sequence[ReceptacleOption],
    frontiers: Sequence[FrontierOption],
    memory: SearchMemory,
    alpha_d: float,
) -> Decision:
    """Decision among candidate start receptacles and frontiers by one objective (eq. 10)."""
    candidates, settings = _weighed(receptacles, frontiers, memory, alpha_d)
    remembered = (*as_candidates(memory), *gains_as_candidates(receptacles))
    if not candidates:
        why = explanations.nothing_left(receptacles=True)
        return Decision(
            DecisionRule.BY_OBJECTIVE, Do.NOTHING_LEFT, (), None, why, settings, remembered
        )
    k = best_of(candidates)
    if candidates[k].kind == "receptacle":
        do, why = Do.SEARCH_RECEPTACLE, explanations.search_receptacle(candidates, k, alpha_d)
    else:
        do, why = Do.GO_TO_FRONTIER, explanations.go_to_frontier(candidates, k, alpha_d)
    return Decision(DecisionRule.BY_OBJECTIVE, do, candidates, k, why, settings, remembered)


def receptacles_first(
    receptacles: Sequence[ReceptacleOption],
    frontiers: Sequence[FrontierOption],
    memory: SearchMemory,
    alpha_d: float,
) -> Decision:
    """Decision without the objective: the nearest candidate receptacle before every frontier;
    frontiers by eq. 10 (section 4, ablation)."""
    if not receptacles:
        return by_objective((), frontiers, memory, alpha_d)
    candidates, settings = _weighed(receptacles, frontiers, memory, alpha_d)
    k = min(range(len(receptacles)), key=lambda k: (receptacles[k].distance_m, k))
    why = explanations.nearest_receptacle(candidates, k)
    return Decision(
        DecisionRule.RECEPTACLES_FIRST,
        Do.SEARCH_RECEPTACLE,
        candidates,
        k,
        why,
        settings,
        (*as_candidates(memory), *gains_as_candidates(receptacles)),
    )


def by_distance(
    receptacles: Sequence[ReceptacleOption],
    frontiers: Sequence[FrontierOption],
    memory: SearchMemory,
    alpha_d: float,
) -> Decision:
    """Decision by distance alone: the nearest candidate receptacle before every frontier, then the
    frontier with the shortest path."""
    if not receptacles:
        return _nearest(frontiers)
    return receptacles_first(receptacles, frontiers, memory, alpha_d)


# --- memory of eq. 8 and 9, as stored with a decision -------------------------------------------
def as_candidates(memory: SearchMemory) -> tuple[Candidate, ...]:
    """The memory as candidates: those first seen, and the frontiers chosen before."""
    seen = [
        Candidate(
            "first_seen",
            "",
            (*s.center_xy_m, 0.0),
            {"class_score": s.class_score, "information_gain": s.information_gain}
            | (s.gain.as_terms() if s.gain else {}),
            id,
        )
        for id, s in memory.first_seen.items()
    ]
    chosen = [
        Candidate("chosen_frontier", "", (*f.xy_m, 0.0), {"value": f.value_when_chosen})
        for f in memory.chosen
    ]
    return (*seen, *chosen)


def as_memory(candidates: Sequence[Candidate]) -> SearchMemory:
    """Inverse of `as_candidates`."""
    memory = SearchMemory()
    for c in candidates:
        xy = c.position_m[0], c.position_m[1]
        if c.kind == "first_seen":
            seen = FirstSeen(
                c.terms["class_score"], c.terms["information_gain"], xy, Gain.of_terms(c.terms)
            )
            memory.note(c.id, seen)
        elif c.kind == "chosen_frontier":
            memory.chosen.append(ChosenFrontier(xy, c.terms["value"]))
    return memory


def gains_as_candidates(receptacles: Sequence[ReceptacleOption]) -> tuple[Candidate, ...]:
    """Gains of receptacles before they were normalised, as candidates of the kind "gain"."""
    return tuple(
        Candidate("gain", "", position_of(r.instance), r.gain.as_terms(), r.instance.id)
        for r in receptacles
        if r.gain is not None
    )


def _weighed(
    receptacles: Sequence[ReceptacleOption],
    frontiers: Sequence[FrontierOption],
    memory: SearchMemory,
    alpha_d: float,
) -> tuple[tuple[Candidate, ...], dict[str, float]]:
    """All options with their terms, receptacles first, and the values used."""
    scale = frontier_scale(memory, alpha_d)
    places = [
        Candidate(
            "receptacle",
            r.instance.class_name,
            position_of(r.instance),
            {
                "class_score": r.class_score,
                "information_gain": r.information_gain,
                "distance_m": r.distance_m,
                "total": candidate_value(r.class_score, r.information_gain, r.distance_m, alpha_d),
            },
            r.instance.id,
        )
        for r in receptacles
    ]
    borders = [
        Candidate(
            "frontier",
            f"frontier {f.id}",
            (*f.xy_m, 0.0),
            {
                "value": f.value,
                "frontier_scale": scale,
                "distance_m": f.distance_m,
                "total": frontier_value(f.value, scale, f.distance_m, alpha_d),
            },
            f.id,
        )
        for f in frontiers
    ]
    return (*places, *borders), {"alpha_d": alpha_d, "frontier_scale": scale}
