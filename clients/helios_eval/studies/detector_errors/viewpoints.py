"""Viewpoints around the objects of a simulated home: sides, distances, and frames of one view."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from helios_sim.home import Home
from helios_sim.home.home_types import Fixture, Receptacle, SceneObject
from numpy.typing import NDArray

CELL_M = 0.05
SIDES = 12
OBJECT_DISTANCES_M = (1.0, 1.6, 2.5)
FURNITURE_DISTANCES_M = (2.0, 3.0)
FRAMES = 2  # of each view
SLIP_M = 0.2  # largest distance from the wanted place to free floor
SHAKE_M, AIM_SHAKE_M = 0.03, 0.06  # between frames of one view: camera and point looked at

Item = Receptacle | Fixture | SceneObject


@dataclass(frozen=True)
class Viewpoint:
    """A place from which the camera looks at an object."""

    target: str  # name of the object
    view: int  # frames of one view have one number
    eye_xy: tuple[float, float]
    at_m: tuple[float, float, float]


def viewpoints(home: Home, classes: Collection[str], most: int) -> Iterator[Viewpoint]:
    """Viewpoints around up to `most` objects of these classes, the same for one home.

    Of each object: the 12 sides, every distance, and two frames of each view, where there is free
    floor of the same room. The sides begin at a direction that is drawn for each object.
    """
    rng = np.random.default_rng([home.seed, 27])
    things = [t for t in items(home) if t.class_name in classes]
    chosen = [things[k] for k in sorted(rng.permutation(len(things))[:most])]
    floor, room_of = _floor(home), {r.name: r.room for r in home.receptacles}
    view = 0
    for thing in chosen:
        at_m = middle_m(thing)
        small = isinstance(thing, SceneObject)
        room = home.rooms[room_of[thing.receptacle] if small else thing.room]
        x, y = floor.T
        inside = floor[(x > room.x0) & (x < room.x1) & (y > room.y0) & (y < room.y1)]
        first_rad = rng.uniform(0, math.tau)
        for side in range(SIDES):
            angle_rad = first_rad + side * math.tau / SIDES
            ahead = np.array([math.cos(angle_rad), math.sin(angle_rad)])
            for distance_m in OBJECT_DISTANCES_M if small else FURNITURE_DISTANCES_M:
                offset_m = np.hypot(*(inside - at_m[:2] - distance_m * ahead).T)
                if not len(offset_m) or offset_m.min() > SLIP_M:
                    continue
                eye_m = inside[int(np.argmin(offset_m))]
                for _ in range(FRAMES):
                    shaken = eye_m + rng.uniform(-SHAKE_M, SHAKE_M, 2)
                    aim = np.array(at_m) + rng.uniform(-AIM_SHAKE_M, AIM_SHAKE_M, 3)
                    yield Viewpoint(
                        thing.name,
                        view,
                        (float(shaken[0]), float(shaken[1])),
                        (float(aim[0]), float(aim[1]), float(aim[2])),
                    )
                view += 1


def items(home: Home) -> tuple[Item, ...]:
    """Furniture, fixtures and objects of a home."""
    return (*home.receptacles, *home.fixtures, *home.objects)


def middle_m(thing: Item) -> tuple[float, float, float]:
    """Middle of an object, world."""
    if isinstance(thing, SceneObject):
        return thing.position_m
    low_m = thing.z_m if isinstance(thing, Fixture) else 0.0
    return thing.x, thing.y, low_m + thing.size_m[2] / 2


def _floor(home: Home) -> NDArray[np.float64]:
    """Middles [n, 2] of the cells on which a robot may stand."""
    free, origin = home.free_space(home.preset.robot_radius_m, CELL_M)
    rows, columns = np.nonzero(free)
    cells = np.stack([columns, rows], -1).astype(np.float64)
    return np.asarray(origin, np.float64) + (cells + 0.5) * CELL_M
