"""Which receptacle to search or which frontier to explore next, while the object is sought."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from helios_planner.decide import (
    Candidate,
    Decision,
    Do,
    FrontierOption,
    ReceptacleOption,
    best_of,
    position_of,
)
from helios_planner.objective import (
    SearchMemory,
    candidate_value,
    frontier_scale,
    frontier_value,
)

SearchRule = Callable[
    [Sequence[ReceptacleOption], Sequence[FrontierOption], SearchMemory, float], Decision
]


def by_objective(
    receptacles: Sequence[ReceptacleOption],
    frontiers: Sequence[FrontierOption],
    memory: SearchMemory,
    alpha_d: float,
) -> Decision:
    """Candidate start receptacles and frontiers by one objective (eq. 10)."""
    rule = "global search (eq. 8-10)"
    candidates, settings = _weighed(receptacles, frontiers, memory, alpha_d)
    if not candidates:
        return _nothing(rule, settings)
    k = best_of(candidates)
    best, count = candidates[k].terms, len(candidates)
    if candidates[k].kind == "receptacle":
        why = (
            f"search the {candidates[k].name}: class score {best['class_score']:.2f} times gain "
            f"{best['information_gain']:.2f} at {best['distance_m']:.1f} m gives "
            f"{best['total']:.3f}, the best of {count}"
        )
        return Decision(rule, Do.SEARCH_RECEPTACLE, candidates, k, why, settings)
    why = (
        f"explore {candidates[k].name}: value {best['value']:.2f} times "
        f"{best['frontier_scale']:.2f} at {best['distance_m']:.1f} m gives {best['total']:.3f}, "
        f"the best of {count}"
    )
    return Decision(rule, Do.GO_TO_FRONTIER, candidates, k, why, settings)


def receptacles_first(
    receptacles: Sequence[ReceptacleOption],
    frontiers: Sequence[FrontierOption],
    memory: SearchMemory,
    alpha_d: float,
) -> Decision:
    """Without the objective: any candidate receptacle before every frontier, the nearest first;
    frontiers by eq. 10 (section 4, ablation)."""
    if not receptacles:
        return by_objective((), frontiers, memory, alpha_d)
    candidates, settings = _weighed(receptacles, frontiers, memory, alpha_d)
    k = min(range(len(receptacles)), key=lambda k: (receptacles[k].distance_m, k))
    why = (
        f"search the {candidates[k].name}: {receptacles[k].distance_m:.1f} m away, the nearest of "
        f"{len(receptacles)} receptacles, which come before {len(frontiers)} frontiers"
    )
    return Decision("receptacles first", Do.SEARCH_RECEPTACLE, candidates, k, why, settings)


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
            "receptacle", r.instance.class_name, position_of(r.instance),
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
    borders = [
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
    return (*places, *borders), {"alpha_d": alpha_d, "frontier_scale": scale}


def _nothing(rule: str, settings: dict[str, float]) -> Decision:
    why = "no receptacle is left to search and no frontier to explore"
    return Decision(rule, Do.NOTHING_LEFT, (), None, why, settings)
