"""Choice of the next place by a plug-in's scores."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.errors import Internal
from helios_core.log_location import log_place
from numpy.typing import ArrayLike, NDArray

from helios_planner.decisions import explanations
from helios_planner.decisions.acceptance import best_of, position_of
from helios_planner.decisions.decision import (
    Candidate,
    Decision,
    Do,
    FrontierOption,
    ReceptacleOption,
)

log = logging.getLogger(__name__)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """Places that a search may go to next. Every array has one row for each of n places, n >= 1."""

    sought: str  # class name of the sought object or receptacle
    layer: str  # "pick": search for the object; "place": search for the goal receptacle
    is_frontier: NDArray[np.bool_]  # [n] True for a frontier, False for a receptacle
    xy_m: Floats  # [n, 2] world
    distance_m: Floats  # [n] straight line from the robot
    bearing_rad: Floats  # [n] from the robot's heading, -pi to pi; positive is left
    value: Floats  # [n] value layer at a frontier, 0 to 1; 0 for a receptacle
    class_score: Floats  # [n] S of a receptacle, 0 to 1; 0 for a frontier
    information_gain: Floats  # [n] of looking at a receptacle (eq. 12); 0 for a frontier
    rng: np.random.Generator  # the task's generator, seeded by the setting agent_seed

    def __len__(self) -> int:
        return len(self.xy_m)


# Returns scores [n]; the highest wins, the nearer place on a tie. -inf: never go there.
ExplorationRule = Callable[[Places], ArrayLike]


def by_own_rule(
    rule: ExplorationRule,
    receptacles: Sequence[ReceptacleOption] | None,
    frontiers: Sequence[FrontierOption],
    sought: str,
    layer: str,
    rng: np.random.Generator,
) -> Decision:
    """Decision for the place with the highest score. receptacles: None if the rule chooses among
    frontiers alone. Raises Internal if the rule fails."""
    name = name_of(rule)
    why = explanations.nothing_left(receptacles=receptacles is not None)
    nothing = Decision(name, Do.NOTHING_LEFT, (), None, why)
    receptacles = receptacles or ()
    if not (receptacles or frontiers):
        return nothing
    scores = _scores(rule, name, _places(receptacles, frontiers, sought, layer, rng))
    candidates = _candidates(receptacles, frontiers, scores)
    if not candidates:
        return nothing
    k = best_of(candidates)
    place = candidates[k].kind == "receptacle"
    do = Do.SEARCH_RECEPTACLE if place else Do.GO_TO_FRONTIER
    return Decision(name, do, candidates, k, explanations.own_rule(candidates, k, name))


def name_of(rule: ExplorationRule) -> str:
    """Name of a rule in decisions and their sentences."""
    return f"rule {getattr(rule, '__name__', type(rule).__name__)}"


def _places(
    receptacles: Sequence[ReceptacleOption],
    frontiers: Sequence[FrontierOption],
    sought: str,
    layer: str,
    rng: np.random.Generator,
) -> Places:
    both = [*receptacles, *frontiers]
    centres = [position_of(r.instance)[:2] for r in receptacles]
    none, no_value = [0.0] * len(frontiers), [0.0] * len(receptacles)
    return Places(
        sought=sought,
        layer=layer,
        is_frontier=np.arange(len(both)) >= len(receptacles),
        xy_m=np.array([*centres, *(f.xy_m for f in frontiers)], float),
        distance_m=np.array([o.distance_m for o in both]),
        bearing_rad=np.array([o.bearing_rad for o in both]),
        value=np.array([*no_value, *(f.value for f in frontiers)]),
        class_score=np.array([*(r.class_score for r in receptacles), *none]),
        information_gain=np.array([*(r.information_gain for r in receptacles), *none]),
        rng=rng,
    )


def _scores(rule: ExplorationRule, name: str, places: Places) -> Floats:
    """Scores [n] of the rule, each finite or -inf. Raises Internal for anything else."""
    wanted = f"wanted {len(places)} numbers, one for each place (-inf: never go there)"
    try:
        given = rule(places)
    except Exception as error:  # plug-in code may raise anything
        log.exception("the exploration %s failed", name)
        raise Internal(
            f"the exploration {name} failed ({type(error).__name__}: {error}); the traceback is in "
            f"{log_place()}"
        ) from error
    try:
        scores = np.asarray(given, float)
    except (TypeError, ValueError) as error:
        came = f"a value of type {type(given).__name__}"
        raise Internal(f"the exploration {name} gave {came}, {wanted}") from error
    if scores.shape != (len(places),):
        raise Internal(f"the exploration {name} gave scores of shape {scores.shape}, {wanted}")
    if np.isnan(scores).any() or (scores == np.inf).any():
        raise Internal(f"the exploration {name} gave scores that are nan or inf, {wanted}")
    return scores


def _candidates(
    receptacles: Sequence[ReceptacleOption], frontiers: Sequence[FrontierOption], scores: Floats
) -> tuple[Candidate, ...]:
    rows = [
        Candidate(
            "receptacle",
            r.instance.class_name,
            position_of(r.instance),
            {
                "class_score": r.class_score,
                "information_gain": r.information_gain,
                "distance_m": r.distance_m,
                "total": float(scores[k]),
            },
            r.instance.id,
        )
        for k, r in enumerate(receptacles)
    ]
    rows += [
        Candidate(
            "frontier",
            f"frontier {f.id}",
            (*f.xy_m, 0.0),
            {"value": f.value, "distance_m": f.distance_m, "total": float(scores[k])},
            f.id,
        )
        for k, f in enumerate(frontiers, len(receptacles))
    ]
    # Places with -inf are no candidates: decisions are sent as JSON, which has no -inf.
    return tuple(c for c in rows if np.isfinite(c.terms["total"]))
