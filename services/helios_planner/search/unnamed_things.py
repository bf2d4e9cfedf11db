"""Things on a believed start receptacle that are no accepted candidate (not in the paper).

The task says where the object lies. The detector may miss it, or give it another name. Size and
names tell which thing to pick first; a look at it in the hand decides whether it is the object.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from helios_core.types import AlignedBox, ObjectInstance
from helios_core.usual_sizes import agreement
from numpy.typing import NDArray

from helios_planner.motion_planning.costmap import GroundMap
from helios_planner.motion_planning.things_on_top import RaisedSpot, raised_spots

BELIEVED_FROM = 0.5  # Ψ of a receptacle whose things are tried
LEAST_AGREEMENT = 0.2  # of the size with the class
LEAST_PROBABILITY = 0.01  # by other names
SEEN_WHOLE = 100.0  # views after which a small size counts
FIRST_ID = 10**9  # the object map gives no such ids


def unnamed_things(
    class_name: str,
    starts: Sequence[ObjectInstance],
    ground: GroundMap,
    probability_at: Callable[[str, Sequence[AlignedBox]], Sequence[float]],
) -> list[ObjectInstance]:
    """Things on the believed start receptacles, likeliest first. Their score is the product of the
    receptacle's Ψ, the agreement of their size with the class, and the probability of the class by
    the names of detections there.

    probability_at: that probability for each box, 0.5 without a detection
    (`RobotInterface.probability_at`).
    """
    found = [
        (spot, start.score * fits)
        for start in starts
        if start.score >= BELIEVED_FROM
        for spot, fits in _that_fit(class_name, raised_spots(start, ground))
    ]
    if not found:
        return []
    by_name = probability_at(class_name, [(spot.center_m, spot.size_m) for spot, _ in found])
    things = [
        _instance(class_name, spot, score * probability)
        for (spot, score), probability in zip(found, by_name, strict=True)
        if probability >= LEAST_PROBABILITY
    ]
    rising = sorted(things, key=lambda thing: thing.score)
    best = {thing.id: thing for thing in rising}  # one receptacle may be two instances of the map
    return sorted(best.values(), key=lambda thing: -thing.score)


def is_unnamed(thing: ObjectInstance) -> bool:
    """True for a thing that `unnamed_things` found."""
    return thing.id >= FIRST_ID


def _that_fit(class_name: str, spots: Sequence[RaisedSpot]) -> Iterator[tuple[RaisedSpot, float]]:
    for spot in spots:
        long_m, short_m = sorted(spot.size_m[:2].tolist(), reverse=True)
        extents_m = np.array([long_m, short_m, float(spot.size_m[2])])
        fits = agreement(class_name, extents_m, SEEN_WHOLE)
        if fits >= LEAST_AGREEMENT:
            yield spot, fits


def _instance(class_name: str, spot: RaisedSpot, score: float) -> ObjectInstance:
    half = spot.size_m[:2] / 2
    corners: NDArray[np.float64] = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    x_cm, y_cm = (round(100 * float(v)) % 10_000 for v in spot.center_m[:2])
    return ObjectInstance(
        id=FIRST_ID + 10_000 * x_cm + y_cm, class_name=class_name, center_m=spot.center_m,
        size_m=spot.size_m, score=score, class_score=score, uncertainty=0.0, views=0, gaussians=0,
        probabilities={}, top_m=float(spot.center_m[2] + spot.size_m[2] / 2),
        outline_m=spot.center_m[:2] + corners * half,
    )  # fmt: skip
