"""Alignment of the present map with a stored one, and the rule that accepts it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from helios_map2d.relocalisation.correlation import APART_M, APART_RAD, candidates
from helios_map2d.relocalisation.grid_fields import (
    OccupancyGrid,
    PresentPoints,
    StoredFields,
    present_points,
    stored_fields,
)
from helios_map2d.relocalisation.landmarks import Landmark, landmark_score_m
from helios_map2d.relocalisation.poses import Transform2
from helios_map2d.relocalisation.refinement import Fit, fit_of, refined

_MODES = 24  # coarse transforms that are refined
_LEAST_POINTS = 20


@dataclass(frozen=True)
class Gate:
    """What an alignment must reach to count; see `docs/how-to/saved-places.md`."""

    overlap_m: float = 4.0  # least surface on known cells of the stored map
    free_overlap_m2: float = 3.0  # least free floor on known cells
    overlap: float = 0.5  # least share of the surface on known cells
    agreement: float = 0.7  # least share of that surface which agrees
    contradiction: float = 0.02  # largest share of floor inside stored obstacles
    margin_m: float = 2.0  # least lead over the second-best transform
    ratio: float = 0.7  # largest score of the second-best transform, in shares of the best


@dataclass(frozen=True)
class StoredMap:
    """Stored map, prepared for alignment."""

    fields: StoredFields
    landmarks: tuple[Landmark, ...] = ()


@dataclass(frozen=True)
class Alignment:
    """Best transform from the present map to the stored one, and how sure it is."""

    fit: Fit
    landmark_m: float  # evidence of objects, in metres of surface
    score_m: float  # of surfaces and objects together
    second_m: float  # score of the second-best distinct transform, 0 without one
    reason: str  # why the alignment does not count; "" if it does

    @property
    def T_stored_present(self) -> Transform2:
        return self.fit.T_stored_present

    @property
    def ratio(self) -> float:
        """Score of the second-best transform in shares of the best, 0 to 1."""
        return min(max(self.second_m, 0.0) / self.score_m, 1.0) if self.score_m > 0 else 1.0


def prepared(grid: OccupancyGrid, landmarks: Sequence[Landmark] = ()) -> StoredMap | None:
    """Stored map for `align`; None if it has no surfaces."""
    fields = stored_fields(grid)
    return None if fields is None else StoredMap(fields, tuple(landmarks))


def align(
    stored: StoredMap,
    present: OccupancyGrid,
    landmarks: Sequence[Landmark] = (),
    gate: Gate | None = None,
) -> Alignment | None:
    """Best alignment of the present map; None while it is too small to compare.

    The two maps may differ in origin, turn and extent, and the present one may be partial.
    landmarks: objects of the present map.
    """
    points = present_points(present)
    if len(points.surface_m) < _LEAST_POINTS:
        return None
    scored = sorted(
        (
            (fit.score_m + landmark_score_m(stored.landmarks, landmarks, fit.T_stored_present), fit)
            for fit in _fits(stored.fields, points)
        ),
        key=lambda pair: -pair[0],
    )
    if not scored:
        return None
    score_m, best = scored[0]
    second_m = next(
        (
            s
            for s, fit in scored[1:]
            if _is_apart(fit.T_stored_present, best.T_stored_present, points)
        ),
        0.0,
    )
    found = Alignment(best, score_m - best.score_m, score_m, second_m, "")
    reason = _refusal(found, gate or Gate())
    return Alignment(best, found.landmark_m, score_m, second_m, reason)


def _fits(stored: StoredFields, points: PresentPoints) -> list[Fit]:
    return [
        fit_of(stored, points, refined(stored, points, one.T_stored_present))
        for one in candidates(stored, points, _MODES)
    ]


def _is_apart(a: Transform2, b: Transform2, points: PresentPoints) -> bool:
    away_m, turned_rad = a.difference(b, np.asarray(points.centre_m))
    return away_m > APART_M or turned_rad > APART_RAD


def _refusal(found: Alignment, gate: Gate) -> str:
    """Why an alignment does not count; "" if it does."""
    fit = found.fit
    if fit.overlap_m < gate.overlap_m or fit.free_overlap_m2 < gate.free_overlap_m2:
        return (
            f"too little to compare: {fit.overlap_m:.1f} m of walls and furniture and "
            f"{fit.free_overlap_m2:.1f} m² of floor, wanted {gate.overlap_m:g} m and "
            f"{gate.free_overlap_m2:g} m²"
        )
    if fit.overlap < gate.overlap:
        return f"only {fit.overlap:.0%} of the present map lies on the saved one"
    if fit.agreement < gate.agreement:
        return f"only {fit.agreement:.0%} of the walls and furniture agree"
    if fit.contradiction > gate.contradiction:
        return f"{fit.contradiction:.1%} of the free floor lies inside saved obstacles"
    if found.score_m - found.second_m < gate.margin_m or found.ratio > gate.ratio:
        return f"another place fits almost as well ({found.ratio:.0%} of the best)"
    return ""
