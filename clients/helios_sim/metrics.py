"""The phases of a move task, as HomeRobot OVMM defines them. Pure: records in, progress out.

- FindObj, latched: the base is within 0.1 m of a viewpoint of a candidate object, and that
  candidate covers at least 0.001 of the image. Candidates are of the asked class on a receptacle of
  the asked class when the task begins.
- Pick, latched: FindObj, and the held object is a candidate.
- FindRec, latched: Pick, then the test of FindObj for a goal receptacle.
- Place, latched: Pick, and a candidate was released and rests for 50 steps of the physics in
  contact with a goal receptacle, its middle at least 0.05 m high.
- SR: Place, and no collision of the robot with the scene in the whole task. Contact with movable
  objects is no collision; collisions count at most once a step.
- Partial success: (FindObj + Pick + FindRec + SR) / 4.
- Steps: actions carried out, whatever their kind.

Viewpoints stand on a grid of 0.15 m around a bounding box, up to 1.0 m beyond it, where the robot
fits and can get to. "Within 0.1 m" is measured straight: between two places where a disc of 0.3 m
fits that are 0.1 m apart, there is no room for an obstacle, so that the geodesic is the line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

VIEWPOINT_GRID_M = 0.15
VIEWPOINT_MAX_M = 1.0
AT_VIEWPOINT_M = 0.1
MIN_COVERAGE = 1e-3
MIN_PLACE_HEIGHT_M = 0.05

Points = NDArray[np.float64]


@dataclass(frozen=True)
class Released:
    """What came of a release."""

    name: str
    at_rest: bool  # for 50 steps
    on: Mapping[str, float]  # bodies touched in all of them -> height of the highest contact, m
    height_m: float  # of its middle
    met: frozenset[str] = frozenset()  # bodies touched at any time


@dataclass(frozen=True)
class Step:
    """What is true after one action. `coverage`: share of the image by candidate or goal name."""

    base_xy_m: tuple[float, float]
    coverage: Mapping[str, float] = field(default_factory=dict)
    held: str = ""  # name of the held object
    released: Released | None = None
    collided_with: frozenset[str] = frozenset()
    moved_m: float = 0.0


@dataclass(frozen=True)
class Targets:
    """What the task is about: names of candidates and goals, with their viewpoints [n, 2] in m."""

    objects: Mapping[str, Points]
    goals: Mapping[str, Points]


@dataclass(frozen=True)
class Progress:
    """The metrics so far."""

    find_object: bool = False
    pick: bool = False
    find_receptacle: bool = False
    place: bool = False
    placed: bool = False  # a candidate rests on a goal receptacle, whatever came before
    collisions: int = 0
    collided_with: tuple[str, ...] = ()
    steps: int = 0
    path_m: float = 0.0

    @property
    def success(self) -> bool:
        """SR"""
        return self.placed and self.collisions == 0

    @property
    def partial_success(self) -> float:
        """0 to 1"""
        return (self.find_object + self.pick + self.find_receptacle + self.success) / 4


def advance(progress: Progress, step: Step, targets: Targets) -> Progress:
    """The progress after one more action."""
    find_object = progress.find_object or any(_found(step, targets.objects))
    pick = progress.pick or (find_object and step.held in targets.objects)
    find_receptacle = progress.find_receptacle or (pick and any(_found(step, targets.goals)))
    rests = step.held not in targets.objects and (progress.placed or placed(step.released, targets))
    place = progress.place or (find_receptacle and rests)
    new = sorted(step.collided_with.difference(progress.collided_with))
    return replace(
        progress,
        find_object=find_object,
        pick=pick,
        find_receptacle=find_receptacle,
        place=place,
        placed=rests,
        collisions=progress.collisions + bool(step.collided_with),
        collided_with=(*progress.collided_with, *new),
        steps=progress.steps + 1,
        path_m=progress.path_m + step.moved_m,
    )


def placed(released: Released | None, targets: Targets) -> bool:
    """Whether a candidate rests on a goal receptacle."""
    return (
        released is not None
        and released.name in targets.objects
        and released.at_rest
        and any(released.on.get(goal, 0.0) >= MIN_PLACE_HEIGHT_M for goal in targets.goals)
    )


def at_viewpoint(base_xy_m: tuple[float, float], viewpoints: Points) -> bool:
    """Whether the base is within 0.1 m of one of the viewpoints [n, 2]."""
    if len(viewpoints) == 0:
        return False
    return bool(np.hypot(*(viewpoints - base_xy_m).T).min() <= AT_VIEWPOINT_M)


def viewpoints_of(
    box_min_m: tuple[float, float],
    box_max_m: tuple[float, float],
    free: NDArray[np.bool_],
    origin_m: tuple[float, float],
    cell_m: float,
) -> Points:
    """Viewpoints [n, 2] around a box on the ground.

    free: cells [row, column] where the robot fits and can get to; cell (0, 0) begins at the origin.
    """
    low = np.asarray(box_min_m) - VIEWPOINT_MAX_M
    high = np.asarray(box_max_m) + VIEWPOINT_MAX_M
    x = np.arange(low[0], high[0] + 1e-9, VIEWPOINT_GRID_M)
    y = np.arange(low[1], high[1] + 1e-9, VIEWPOINT_GRID_M)
    points = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    beyond = np.maximum(np.maximum(box_min_m - points, points - box_max_m), 0.0)
    points = points[np.hypot(beyond[:, 0], beyond[:, 1]) <= VIEWPOINT_MAX_M]
    column, row = np.floor((points - origin_m) / cell_m).astype(int).T
    inside = (row >= 0) & (row < free.shape[0]) & (column >= 0) & (column < free.shape[1])
    inside[inside] = free[row[inside], column[inside]]
    return points[inside]


def _found(step: Step, candidates: Mapping[str, Points]) -> list[bool]:
    return [
        step.coverage.get(name, 0.0) >= MIN_COVERAGE and at_viewpoint(step.base_xy_m, viewpoints)
        for name, viewpoints in candidates.items()
    ]
