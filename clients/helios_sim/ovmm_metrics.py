"""Metrics of a move task by the rules of HomeRobot OVMM. Pure functions.

- FindObj, latched: the base is within 0.1 m geodesic of a viewpoint of a candidate object, and that
  candidate covers at least 0.001 of the image and is not in the hand. Candidates are objects of the
  requested class that lie on a receptacle of the requested class when the task begins.
- Pick, latched: FindObj, and the held object is a candidate.
- FindRec, latched: Pick, then the test of FindObj for a goal receptacle.
- Placed: a candidate was released and was at rest (below 0.005 m/s and 0.05 rad/s) for 50
  consecutive control steps of 1/30 s, in contact with a goal receptacle at a height of at least
  0.05 m in all of them. One that trembles within 1 mm and 1° for as long counts as at rest, too,
  on what it touches at the end. It ends when a candidate is held again.
- Place, latched: FindRec, and placed. The phases form a chain.
- SR: placed, and no collision of the robot with the scene in the whole task. As in Habitat, SR uses
  the unchained place: an agent that never was at a viewpoint can succeed.
- Partial success: (FindObj + Pick + FindRec + SR) / 4.
- Collisions: contact of the robot's body with anything but movable objects, at most one per step.
  The body ends 1 cm above the floor: the wheels are not modelled.
- Steps: executed actions of any kind. The caller applies the limit of 1250.

Viewpoints lie on a grid of 0.15 m around a bounding box, up to 1.0 m from it, where a disc of
0.3 m fits and which it can reach.

Habitat has no contact between base and scene, and rejects a move out of the navigable area. Here
the move is executed, and the body (radius 0.27 m) stops at the contact: a collision. This rule is
stricter: a move into a table, which Habitat only rejects, makes SR false here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from helios_sim.navigable_area import NavigableArea, Points

VIEWPOINT_GRID_M = 0.15
VIEWPOINT_MAX_M = 1.0
AT_VIEWPOINT_M = 0.1
MIN_COVERAGE = 1e-3
MIN_PLACE_HEIGHT_M = 0.05


@dataclass(frozen=True)
class ReleaseResult:
    """Result of a release."""

    name: str
    at_rest: bool  # or trembles in place, for 50 control steps
    on: Mapping[str, float]  # bodies touched in all of them -> height of the highest contact, m
    height_m: float  # of the object's centre
    met: frozenset[str] = frozenset()  # bodies touched at any time


@dataclass(frozen=True)
class Step:
    """Ground truth after one action. `coverage`: candidate or goal name -> share of the image."""

    base_xy_m: tuple[float, float]
    coverage: Mapping[str, float] = field(default_factory=dict)
    held: str = ""  # name of the held object
    released: ReleaseResult | None = None
    collided_with: frozenset[str] = frozenset()
    moved_m: float = 0.0


@dataclass(frozen=True)
class Targets:
    """Candidates and goals of a task: name -> viewpoints [n, 2] in m.

    Viewpoints and the base lie on `ground`.
    """

    objects: Mapping[str, Points]
    goals: Mapping[str, Points]
    ground: NavigableArea

    def at(self, base_xy_m: tuple[float, float], name: str) -> bool:
        """True if the base is within 0.1 m geodesic of a viewpoint of the candidate or goal."""
        viewpoints = self.objects[name] if name in self.objects else self.goals[name]
        return self.ground.within(base_xy_m, viewpoints, AT_VIEWPOINT_M)


@dataclass(frozen=True)
class Progress:
    """Metrics after the actions executed so far."""

    find_object: bool = False
    pick: bool = False
    find_receptacle: bool = False
    place: bool = False
    placed: bool = False  # a candidate rests on a goal receptacle, regardless of earlier phases
    collisions: int = 0
    collided_with: tuple[str, ...] = ()
    steps: int = 0
    path_m: float = 0.0
    find_object_steps: int = 0  # steps and path until FindObj; 0 before it
    find_object_path_m: float = 0.0

    @property
    def success(self) -> bool:
        """Success (SR)."""
        return self.placed and self.collisions == 0

    @property
    def partial_success(self) -> float:
        """Partial success, 0 to 1."""
        return (self.find_object + self.pick + self.find_receptacle + self.success) / 4


def advance(progress: Progress, step: Step, targets: Targets) -> Progress:
    """Progress after one more action."""
    find_object = progress.find_object or _found(step, targets, targets.objects)
    pick = progress.pick or (find_object and step.held in targets.objects)
    find_receptacle = progress.find_receptacle or (pick and _found(step, targets, targets.goals))
    rests = step.held not in targets.objects and (progress.placed or placed(step.released, targets))
    place = progress.place or (find_receptacle and rests)
    new = sorted(step.collided_with.difference(progress.collided_with))
    steps, path_m = progress.steps + 1, progress.path_m + step.moved_m
    if find_object and not progress.find_object:
        progress = replace(progress, find_object_steps=steps, find_object_path_m=path_m)
    return replace(
        progress,
        find_object=find_object,
        pick=pick,
        find_receptacle=find_receptacle,
        place=place,
        placed=rests,
        collisions=progress.collisions + bool(step.collided_with),
        collided_with=(*progress.collided_with, *new),
        steps=steps,
        path_m=path_m,
    )


def placed(released: ReleaseResult | None, targets: Targets) -> bool:
    """True if a released candidate rests on a goal receptacle."""
    return (
        released is not None
        and released.name in targets.objects
        and released.at_rest
        and any(released.on.get(goal, 0.0) >= MIN_PLACE_HEIGHT_M for goal in targets.goals)
    )


def viewpoints_of(
    box_min_m: tuple[float, float],
    box_max_m: tuple[float, float],
    ground: NavigableArea,
) -> Points:
    """Viewpoints [n, 2] on the navigable area around a box."""
    low = np.asarray(box_min_m) - VIEWPOINT_MAX_M
    high = np.asarray(box_max_m) + VIEWPOINT_MAX_M
    x = np.arange(low[0], high[0] + 1e-9, VIEWPOINT_GRID_M)
    y = np.arange(low[1], high[1] + 1e-9, VIEWPOINT_GRID_M)
    points = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    beyond = np.maximum(np.maximum(box_min_m - points, points - box_max_m), 0.0)
    points = points[np.hypot(beyond[:, 0], beyond[:, 1]) <= VIEWPOINT_MAX_M]
    return points[ground.contains(points)]


def _found(step: Step, targets: Targets, names: Iterable[str]) -> bool:
    return any(
        step.coverage.get(name, 0.0) >= MIN_COVERAGE and targets.at(step.base_xy_m, name)
        for name in names
    )
