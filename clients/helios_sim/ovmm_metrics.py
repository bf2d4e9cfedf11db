"""The phases of a move task, as HomeRobot OVMM defines them. Pure: records in, progress out.

- FindObj, latched: the base is within 0.1 m geodesic of a viewpoint of a candidate object, and that
  candidate covers at least 0.001 of the image. Candidates are of the asked class on a receptacle of
  the asked class when the task begins.
- Pick, latched: FindObj, and the held object is a candidate.
- FindRec, latched: Pick, then the test of FindObj for a goal receptacle.
- Placed: a candidate was released and was at rest (below 0.005 m/s and 0.05 rad/s) for 50 control
  steps of 1/30 s without a break, all the while in contact with a goal receptacle at a height of at
  least 0.05 m. It ends when a candidate is held again.
- Place, latched: FindRec, and placed. The phases are a chain.
- SR: placed, and no collision of the robot with the scene in the whole task. As in habitat this
  takes the unchained place: who brings the object without having been at a viewpoint succeeds.
- Partial success: (FindObj + Pick + FindRec + SR) / 4.
- Collisions: contact of the robot's body with anything but movable things, at most once a step. The
  body ends 1 cm above the floor: its wheels are not modelled.
- Steps: actions carried out, whatever their kind. The limit, 1250, is the caller's.

Viewpoints stand on a grid of 0.15 m around a bounding box, up to 1.0 m beyond it, where a disc of
0.3 m fits and can get to.

Leaving the navigable area is counted apart from collisions, at most once a step. Habitat has no
contact between its base and the scene, so it must reject the whole of such a move; then a robot can
never graze anything. Here the move is carried out and the body, 0.27 m, is stopped where it touches
something: that is a collision, and the step counts as one that left the navigable area (0.3 m) too.
This is how a real robot fails, and it is stricter: habitat forgives a move into a table that it
rejects, here it spoils SR.
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
    left_navigable: bool = False  # at some time of the move


@dataclass(frozen=True)
class Targets:
    """What the task is about: names of candidates and goals, with their viewpoints [n, 2] in m.

    Viewpoints and the base stand on `ground`.
    """

    objects: Mapping[str, Points]
    goals: Mapping[str, Points]
    ground: NavigableArea

    def at(self, base_xy_m: tuple[float, float], name: str) -> bool:
        """Whether the base is within 0.1 m geodesic of a viewpoint of a candidate or goal."""
        viewpoints = self.objects[name] if name in self.objects else self.goals[name]
        return self.ground.within(base_xy_m, viewpoints, AT_VIEWPOINT_M)


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
    left_navigable: int = 0  # steps
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
    find_object = progress.find_object or _found(step, targets, targets.objects)
    pick = progress.pick or (find_object and step.held in targets.objects)
    find_receptacle = progress.find_receptacle or (pick and _found(step, targets, targets.goals))
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
        left_navigable=progress.left_navigable + step.left_navigable,
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


def viewpoints_of(
    box_min_m: tuple[float, float],
    box_max_m: tuple[float, float],
    ground: NavigableArea,
) -> Points:
    """Viewpoints [n, 2] around a box on the ground."""
    low = np.asarray(box_min_m) - VIEWPOINT_MAX_M
    high = np.asarray(box_max_m) + VIEWPOINT_MAX_M
    x = np.arange(low[0], high[0] + 1e-9, VIEWPOINT_GRID_M)
    y = np.arange(low[1], high[1] + 1e-9, VIEWPOINT_GRID_M)
    points = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    beyond = np.maximum(np.maximum(box_min_m - points, points - box_max_m), 0.0)
    points = points[np.hypot(beyond[:, 0], beyond[:, 1]) <= VIEWPOINT_MAX_M]
    return points[ground.holds(points)]


def _found(step: Step, targets: Targets, names: Iterable[str]) -> bool:
    return any(
        step.coverage.get(name, 0.0) >= MIN_COVERAGE and targets.at(step.base_xy_m, name)
        for name in names
    )
