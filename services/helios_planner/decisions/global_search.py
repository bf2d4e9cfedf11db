"""Which receptacle to search or which frontier to explore next, while the object is sought."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from helios_planner.decisions import sentences
from helios_planner.decisions.decide import (
    Candidate,
    Decision,
    Do,
    FrontierOption,
    ReceptacleOption,
    best_of,
    position_of,
)
from helios_planner.decisions.objective import (
    ChosenFrontier,
    FirstSeen,
    SearchMemory,
    candidate_value,
    frontier_scale,
    frontier_value,
)

BY_OBJECTIVE, RECEPTACLES_FIRST = "global search (eq. 8-10)", "receptacles first"

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
    candidates, settings = _weighed(receptacles, frontiers, memory, alpha_d)
    remembered = as_candidates(memory)
    if not candidates:
        why = sentences.nothing_left(receptacles=True)
        return Decision(BY_OBJECTIVE, Do.NOTHING_LEFT, (), None, why, settings, remembered)
    k = best_of(candidates)
    if candidates[k].kind == "receptacle":
        do, why = Do.SEARCH_RECEPTACLE, sentences.search_receptacle(candidates, k, alpha_d)
    else:
        do, why = Do.GO_TO_FRONTIER, sentences.go_to_frontier(candidates, k, alpha_d)
    return Decision(BY_OBJECTIVE, do, candidates, k, why, settings, remembered)


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
    why = sentences.nearest_receptacle(candidates, k)
    return Decision(RECEPTACLES_FIRST, Do.SEARCH_RECEPTACLE, candidates, k, why, settings,
                    as_candidates(memory))  # fmt: skip


# --- what eq. 8 and 9 remember, as it is kept with a decision -----------------------------------
def as_candidates(memory: SearchMemory) -> tuple[Candidate, ...]:
    """Candidates as first seen and frontiers once chosen."""
    seen = [
        Candidate(
            "first_seen", "", (*s.center_xy_m, 0.0),
            {"class_score": s.class_score, "information_gain": s.information_gain}, id,
        )
        for id, s in memory.first_seen.items()
    ]  # fmt: skip
    chosen = [
        Candidate("chosen_frontier", "", (*f.xy_m, 0.0), {"value": f.value_when_chosen})
        for f in memory.chosen
    ]
    return (*seen, *chosen)


def as_memory(candidates: Sequence[Candidate]) -> SearchMemory:
    """What `as_candidates` wrote."""
    memory = SearchMemory()
    for c in candidates:
        xy = c.position_m[0], c.position_m[1]
        if c.kind == "first_seen":
            seen = FirstSeen(c.terms["class_score"], c.terms["information_gain"], xy)
            memory.note(c.id, seen)
        else:
            memory.chosen.append(ChosenFrontier(xy, c.terms["value"]))
    return memory


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
