"""Which frontier to explore next, where no candidate receptacle is weighed against it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from helios_planner.decisions import sentences
from helios_planner.decisions.decide import Candidate, Decision, Do, FrontierOption, best_of
from helios_planner.decisions.objective import ChosenFrontier

KEPT_M = 0.5  # a frontier this near to the last one is the same (VLFM)
KEPT_VALUE = 0.01  # and kept while its value has not fallen by so much (VLFM)

NEAREST_BY_WAY = "nearest frontier by way"

FrontierRule = Callable[[Sequence[FrontierOption], str, np.random.Generator], Decision]


@dataclass(frozen=True)
class WayOption:
    """A frontier that may be explored for its own sake: its length and the way to it, metres."""

    id: int
    xy_m: tuple[float, float]
    size_m: float
    way_m: float
    distance_m: float


def nearest_by_way(frontiers: Sequence[WayOption]) -> Decision:
    """The frontier with the shortest way to it, for who explores and seeks nothing."""
    candidates = tuple(
        Candidate("frontier", f"frontier {f.id}", (*f.xy_m, 0.0),
                  {"way_m": f.way_m, "size_m": f.size_m, "distance_m": f.distance_m,
                   "total": -f.way_m}, f.id)
        for f in frontiers
    )  # fmt: skip
    if not candidates:
        return _nothing(NEAREST_BY_WAY)
    k = best_of(candidates)
    why = sentences.nearest_way(candidates, k)
    return Decision(NEAREST_BY_WAY, Do.GO_TO_FRONTIER, candidates, k, why)


def highest_value(
    frontiers: Sequence[FrontierOption], layer: str, _: np.random.Generator
) -> Decision:
    """The frontier with the highest value of a layer; the nearer one on a tie."""
    return _highest(frontiers, layer)


def nearest(frontiers: Sequence[FrontierOption], layer: str, _: np.random.Generator) -> Decision:
    """The nearest frontier, whatever its value."""
    candidates = _listed(frontiers, [-f.distance_m for f in frontiers])
    if not candidates:
        return _nothing("nearest frontier")
    k = best_of(candidates)
    why = sentences.nearest_frontier(candidates, k)
    return Decision("nearest frontier", Do.GO_TO_FRONTIER, candidates, k, why)


def kept(frontiers: Sequence[FrontierOption], layer: str, last: ChosenFrontier | None) -> Decision:
    """VLFM: the frontier that was gone to last while its value has not fallen since, else the one
    with the highest value of a layer."""
    decision = _highest(frontiers, layer)
    if last is None or decision.winner is None:
        return decision
    near = [
        (math.dist(f.xy_m, last.xy_m), k) for k, f in enumerate(frontiers)
        if math.dist(f.xy_m, last.xy_m) <= KEPT_M
    ]  # fmt: skip
    if not near:
        return decision
    _, k = min(near)
    if frontiers[k].value + KEPT_VALUE <= last.value_when_chosen:
        return decision
    why = sentences.kept_frontier(decision.candidates, k, layer, last.value_when_chosen)
    return replace(decision, rule=f"keep the frontier by {layer} value", winner=k, why=why)


def drawn(frontiers: Sequence[FrontierOption], layer: str, rng: np.random.Generator) -> Decision:
    """Any frontier with the same chance."""
    candidates = _listed(frontiers, [0.0 for _ in frontiers])
    if not candidates:
        return _nothing("random frontier")
    k = int(rng.integers(len(candidates)))
    why = sentences.drawn_frontier(candidates, k)
    return Decision("random frontier", Do.GO_TO_FRONTIER, candidates, k, why)


def _highest(frontiers: Sequence[FrontierOption], layer: str) -> Decision:
    candidates = _listed(frontiers, [f.value for f in frontiers])
    rule = f"frontier by {layer} value"
    if not candidates:
        return _nothing(rule)
    k = best_of(candidates)
    why = sentences.highest_frontier(candidates, k, layer)
    return Decision(rule, Do.GO_TO_FRONTIER, candidates, k, why)


def _listed(frontiers: Sequence[FrontierOption], totals: Sequence[float]) -> tuple[Candidate, ...]:
    return tuple(
        Candidate("frontier", f"frontier {f.id}", (*f.xy_m, 0.0),
                  {"value": f.value, "distance_m": f.distance_m, "total": total}, f.id)
        for f, total in zip(frontiers, totals, strict=True)
    )  # fmt: skip


def _nothing(rule: str) -> Decision:
    return Decision(rule, Do.NOTHING_LEFT, (), None, sentences.nothing_left(receptacles=False))
