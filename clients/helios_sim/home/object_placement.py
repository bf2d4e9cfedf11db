"""Object placement in homes of the "demo" catalog: within reach, apart, with space for one more.

`distractor_placement.py` places the objects of the benchmark homes.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_sim.home.catalog import OBJECTS
from helios_sim.home.furnished_floor import FurnishedFloor, surface_points
from helios_sim.home.home_types import Receptacle, SceneObject, Shape, Surface

_EDGE_M = 0.02
_APART_M = 0.04
_SPARE_RADIUS_M = 0.13
_REACH_SLACK_M = 0.08
_DROP_M = 0.002
_TRIES = 25


@dataclass(frozen=True)
class _Disc:
    x: float
    y: float
    radius: float


class ObjectPlacer:
    """Placement of objects on the furniture of a home; holds the objects placed so far."""

    def __init__(self, furnisher: FurnishedFloor) -> None:
        self._f = furnisher
        self._rng = furnisher.rng
        passable = furnisher.passable()
        self._reach = {
            room.index: furnisher.reach_map(room.index, passable) for room in furnisher.rooms
        }
        self._discs: dict[str, list[_Disc]] = {r.name: [] for r in furnisher.receptacles}
        self._counts: dict[str, int] = {}
        self.objects: list[SceneObject] = []

    def fill(self) -> None:
        """Place a number of objects in the preset's range: one per class, then duplicates."""
        preset = self._f.preset
        count = int(self._rng.integers(preset.objects[0] + 1, preset.objects[1] + 1))
        classes = list(OBJECTS)
        distinct = min(len(classes), max(preset.min_object_classes + 1, round(0.8 * count)))
        order = [classes[int(k)] for k in self._rng.permutation(len(classes))]
        for class_name in order:
            if len(self._counts) < distinct:
                self._place(class_name)
        for _ in range(3 * count):
            if len(self.objects) >= count:
                break
            self._place(order[int(self._rng.integers(distinct))])

    def _place(self, class_name: str) -> bool:
        make, likely = OBJECTS[class_name]
        shape = make(self._rng, self._f.palette)
        hosts = [r for r in self._f.receptacles if r.class_name in likely]
        for k in self._rng.permutation(len(hosts)):
            host = hosts[int(k)]
            spot = self._spot(host, shape)
            if spot is None:
                continue
            x, y, z, yaw = spot
            number = self._counts.get(class_name, 0)
            self._counts[class_name] = number + 1
            self._discs[host.name].append(_Disc(x, y, _radius(shape)))
            self.objects.append(
                SceneObject(
                    f"{class_name.replace(' ', '_')}_{number}",
                    class_name,
                    host.name,
                    (x, y, z),
                    yaw,
                    shape.size_m,
                    shape.color,
                    shape,
                )
            )
            return True
        return False

    def _spot(self, host: Receptacle, shape: Shape) -> tuple[float, float, float, float] | None:
        lo, hi = self._f.preset.surface_height_m
        surfaces = [s for s in host.surfaces if lo <= s.height_m <= hi]
        radius = _radius(shape)
        for _ in range(_TRIES if surfaces else 0):
            surface = surfaces[int(self._rng.integers(len(surfaces)))]
            point = self._draw(surface, radius)
            if point is None or not self._free(host, point, radius):
                continue
            if not self._spare_spot(host, _Disc(*point, radius)):
                continue
            z = surface.height_m + shape.size_m[2] / 2 + _DROP_M
            return *point, z, self._yaw(shape, surface)
        return None

    def _draw(self, surface: Surface, radius: float) -> tuple[float, float] | None:
        reach = [half - radius - _EDGE_M for half in surface.half_extent_xy]
        if min(reach) < 0:
            return None
        u, v = (float(self._rng.uniform(-r, r)) for r in reach)
        cos, sin = math.cos(surface.yaw_rad), math.sin(surface.yaw_rad)
        return (
            surface.center_xy[0] + cos * u - sin * v,
            surface.center_xy[1] + sin * u + cos * v,
        )

    def _yaw(self, shape: Shape, surface: Surface) -> float:
        # An object with a front (drawn towards -y) faces roughly the same way as its furniture.
        spread = 0.5 if shape.size_m[0] != shape.size_m[1] else math.pi
        turned = surface.yaw_rad + float(self._rng.uniform(-spread, spread))
        return math.remainder(turned, math.tau)

    def _free(self, host: Receptacle, point: tuple[float, float], radius: float) -> bool:
        near = self._within_reach(host, np.array([point]))[0]
        return bool(near) and all(
            math.hypot(point[0] - d.x, point[1] - d.y) > radius + d.radius + _APART_M
            for d in self._discs[host.name]
        )

    def _spare_spot(self, host: Receptacle, added: _Disc) -> bool:
        points = np.concatenate([surface_points(surface) for surface in host.surfaces])
        points = points[self._within_reach(host, points)]
        free = np.ones(len(points), dtype=bool)
        for disc in (*self._discs[host.name], added):
            gap = np.hypot(points[:, 0] - disc.x, points[:, 1] - disc.y) - disc.radius
            free &= gap > _SPARE_RADIUS_M
        return bool(free.any())

    def _within_reach(self, host: Receptacle, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        distances = self._f.distances(points, self._reach[host.room])
        return distances <= self._f.preset.reach_m - _REACH_SLACK_M


def _radius(shape: Shape) -> float:
    return (
        math.hypot(shape.size_m[0], shape.size_m[1]) / 2
        if not _round(shape)
        else shape.size_m[0] / 2
    )


def _round(shape: Shape) -> bool:
    return shape.size_m[0] == shape.size_m[1]
