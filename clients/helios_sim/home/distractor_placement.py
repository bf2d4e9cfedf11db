"""Object placement in the benchmark homes: duplicates, look-alikes and hidden objects.

Every object stays within reach of a free robot position, and each receptacle keeps space for one
more object. The physics (`physics_settling`) checks that an object is at rest and visible;
otherwise another one is placed.

With the preset's `room_preference`, that share of the objects is in a room that suits the class
(`room_affinity.py`), and the others are in rooms that do not.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_sim.home import freespace
from helios_sim.home.furnished_floor import FurnishedFloor, surface_points
from helios_sim.home.home_types import Receptacle, SceneObject, Shape, Surface, Vec3
from helios_sim.home.room_affinity import suits

_EDGE_M = 0.012
_APART_M = 0.015
_SPARE_RADIUS_M = 0.12
_REACH_SLACK_M = 0.06
_DROP_M = 0.002
_TRIES = 16
_LIKELY = 0.75  # probability of a receptacle that is usual for the class
_LOOK_ALIKE, _BEHIND = 0.5, 0.6  # probabilities: look-alike class; position behind a neighbour
_CROWD = 5  # largest number of objects on one surface
_HIDDEN = 4  # number of objects placed behind taller ones
_TALL_M, _AROUND_M = 0.13, 2.5
_ANCHORS = 12  # anchors tried for one look-alike

Point = tuple[float, float]


@dataclass(frozen=True)
class _Disc:
    level: int  # index of the surface
    x: float
    y: float
    radius: float
    name: str


class DistractorPlacer:
    """Placement of objects on the furniture of a home; holds the objects placed so far."""

    def __init__(self, furnisher: FurnishedFloor) -> None:
        self._f, self._rng = furnisher, furnisher.rng
        passable = furnisher.passable()
        self._reach = {
            room.index: furnisher.reach_map(room.index, passable) for room in furnisher.rooms
        }
        x_of, y_of = freespace.cell_centers(furnisher.bounds, freespace.CELL_M)
        self._floor: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
        for room in furnisher.rooms:
            mask = freespace.room_mask(room, furnisher.bounds, freespace.CELL_M)
            rows, columns = np.nonzero(passable & mask)
            self._floor[room.index] = (x_of[columns], y_of[rows])
        self._hosts = {host.name: host for host in furnisher.receptacles}
        self._discs: dict[str, list[_Disc]] = {name: [] for name in self._hosts}
        # Random weights make some furniture crowded and leave some empty.
        self._drawn_to = {name: float(self._rng.gamma(0.7)) + 0.02 for name in self._hosts}
        self._made = self._hidden = 0
        classes = list(furnisher.catalog.objects)
        self._order = [classes[int(k)] for k in self._rng.permutation(len(classes))]
        spread = int(self._rng.integers(1, 4))
        self._distinct = min(len(classes), furnisher.preset.min_object_classes + spread)
        self.objects: list[SceneObject] = []

    def top_up(self, count: int) -> None:
        """Place objects up to `count`: one per class, hidden ones, duplicates and look-alikes."""
        for class_name in self._order:
            if len({thing.class_name for thing in self.objects}) >= self._distinct:
                break
            if all(thing.class_name != class_name for thing in self.objects):
                self._place(class_name)
        if not self.objects:  # nothing fits
            return
        hidden = max(_HIDDEN, self._f.preset.hidden_objects + 1)
        for _ in range(6 * hidden):
            if self._hidden >= hidden or len(self.objects) >= count:
                break
            self._hidden += self._hide()
        for _ in range(6 * count):
            if len(self.objects) >= count:
                break
            anchor = self.objects[int(self._rng.integers(len(self.objects)))]
            if self._rng.random() < _LOOK_ALIKE:
                self._look_alike(anchor)
            else:
                self._place(anchor.class_name)

    def put_on(self, class_name: str, shape: Shape, host: Receptacle) -> SceneObject | None:
        """Place an object at a random free spot of a receptacle; None if there is none."""
        return self.objects[-1] if self._anywhere(class_name, shape, host) else None

    def keep(self, settled: Sequence[SceneObject]) -> None:
        """Replace the objects by `settled`, a subset of them at their rest poses."""
        names = {thing.name for thing in settled}
        self.objects = list(settled)
        for host, discs in self._discs.items():
            self._discs[host] = [disc for disc in discs if disc.name in names]

    def hide_more(self, hidden: NDArray[np.bool_]) -> None:
        """Remove some duplicates that are not hidden, so that `top_up` can place hidden ones.

        hidden: mask [n] over the objects.
        """
        away: list[SceneObject] = []
        counts = Counter(thing.class_name for thing in self.objects)
        for thing, is_hidden in reversed(list(zip(self.objects, hidden, strict=True))):
            if not is_hidden and counts[thing.class_name] > 1 and len(away) < _HIDDEN:
                counts[thing.class_name] -= 1
                away.append(thing)
        self.keep([thing for thing in self.objects if thing not in away])
        self._hidden = 0

    def _like(self, class_name: str) -> str:
        """Random look-alike class of this one; the class itself if there is none."""
        groups = [g for g in self._f.catalog.look_alikes if class_name in g]
        if not groups:
            return class_name
        others = [
            name for name in groups[int(self._rng.integers(len(groups)))] if name != class_name
        ]
        return others[int(self._rng.integers(len(others)))]

    def _look_alike(self, anchor: SceneObject) -> None:
        """Place a look-alike next to the anchor, or next to another object whose room is right."""
        class_name, wanted = self._like(anchor.class_name), self._draw_room_fit()
        for _ in range(_ANCHORS):
            if wanted is None or self._suits(class_name, anchor.receptacle) == wanted:
                self._beside(class_name, anchor)
                return
            anchor = self.objects[int(self._rng.integers(len(self.objects)))]
            class_name = self._like(anchor.class_name)

    def _draw_room_fit(self) -> bool | None:
        """Random: True for a room that suits the class, False for another; None: no preference."""
        share = self._f.preset.room_preference
        return bool(self._rng.random() < share) if share > 0 else None

    def _suits(self, class_name: str, host: str) -> bool:
        return suits(class_name, self._f.rooms[self._hosts[host].room].kind)

    def _place(self, class_name: str) -> bool:
        make, likely = self._f.catalog.objects[class_name]
        shape = make(self._rng, self._f.palette)
        hosts, wanted = list(self._hosts.values()), self._draw_room_fit()
        if wanted is not None:
            hosts = [host for host in hosts if self._suits(class_name, host.name) == wanted]
        usual = [host for host in hosts if host.class_name in likely]
        if usual and self._rng.random() < _LIKELY:
            hosts = usual
        waits = [float(self._rng.exponential()) / self._drawn_to[host.name] for host in hosts]
        for k in np.argsort(waits)[:8]:
            host = hosts[int(k)]
            company = self._discs[host.name]
            if company and self._rng.random() < _BEHIND:
                anchor = company[int(self._rng.integers(len(company)))]
                if self._near(class_name, shape, host, anchor, behind=1):
                    return True
            if self._anywhere(class_name, shape, host):
                return True
        return False

    def _hide(self) -> bool:
        """Place a tall and wide object before a small one, or a small one behind a tall one."""
        thing = self.objects[int(self._rng.integers(len(self.objects)))]
        in_front = bool(self._rng.random() < 0.5)
        classes = sorted({other.class_name for other in self.objects})
        wanted = self._draw_room_fit()
        if wanted is not None:
            classes = [n for n in classes if self._suits(n, thing.receptacle) == wanted]
            if not classes:
                return False
        host = self._hosts[thing.receptacle]
        anchor = next(disc for disc in self._discs[host.name] if disc.name == thing.name)
        for _ in range(5):
            class_name = classes[int(self._rng.integers(len(classes)))]
            shape = self._f.catalog.objects[class_name][0](self._rng, self._f.palette)
            small, screen = (thing, shape) if in_front else (shape, thing)
            if _hides(screen.size_m, small.size_m):
                side = -1 if in_front else 1
                return self._near(class_name, shape, host, anchor, behind=side)
        return False

    def _away_from_floor(self, host: Receptacle, anchor: _Disc) -> float:
        """Direction (rad) from the centre of the free floor around an object to the object."""
        x, y = self._floor[host.room]
        near = np.hypot(x - anchor.x, y - anchor.y) < _AROUND_M
        if not near.any():
            return host.yaw_rad + math.pi / 2
        return math.atan2(anchor.y - float(y[near].mean()), anchor.x - float(x[near].mean()))

    def _beside(self, class_name: str, thing: SceneObject) -> bool:
        """Place an object of that class next to another one."""
        host = self._hosts[thing.receptacle]
        anchor = next(disc for disc in self._discs[host.name] if disc.name == thing.name)
        shape = self._f.catalog.objects[class_name][0](self._rng, self._f.palette)
        behind = int(self._rng.random() < _BEHIND)
        return self._near(class_name, shape, host, anchor, behind=behind)

    def _anywhere(self, class_name: str, shape: Shape, host: Receptacle) -> bool:
        radius = _radius(shape)
        for _ in range(_TRIES):
            level = int(self._rng.integers(len(host.surfaces)))
            surface = host.surfaces[level]
            reach = [half - radius - _EDGE_M for half in surface.half_extent_xy]
            if min(reach) < 0:
                continue
            u, v = (float(self._rng.uniform(-r, r)) for r in reach)
            if self._put(class_name, shape, host, level, _world(surface, u, v)):
                return True
        return False

    def _near(
        self, class_name: str, shape: Shape, host: Receptacle, anchor: _Disc, *, behind: int
    ) -> bool:
        """Place an object close to `anchor`.

        behind: 1 on the side away from the free floor, -1 on the opposite side, 0 on any side.
        """
        radius = _radius(shape)
        surface = host.surfaces[anchor.level]
        away, spread = self._away_from_floor(host, anchor), 0.35 if behind else math.pi
        if behind < 0:
            away += math.pi
        for _ in range(_TRIES):
            gap = radius + anchor.radius + float(self._rng.uniform(0.016, 0.035 if behind else 0.2))
            turn = away + float(self._rng.uniform(-spread, spread))
            point = anchor.x + gap * math.cos(turn), anchor.y + gap * math.sin(turn)
            if _to_edge(surface, point) < radius + _EDGE_M:
                continue
            if self._put(class_name, shape, host, anchor.level, point):
                return True
        return False

    def _put(
        self, class_name: str, shape: Shape, host: Receptacle, level: int, point: Point
    ) -> bool:
        surface, radius = host.surfaces[level], _radius(shape)
        lo, hi = self._f.preset.surface_height_m
        fits = lo <= surface.height_m <= hi and shape.size_m[2] < surface.clear_m
        added = _Disc(level, *point, radius, f"thing_{self._made}")
        if not fits or not self._free(host, added) or not self._spare_spot(host, added):
            return False
        self._made += 1
        self._discs[host.name].append(added)
        z = surface.height_m + shape.size_m[2] / 2 + _DROP_M
        # An object with a front (drawn towards -y) faces roughly the same way as its furniture.
        spread = 0.6 if shape.size_m[0] != shape.size_m[1] else math.pi
        turned = surface.yaw_rad + float(self._rng.uniform(-spread, spread))
        yaw = math.remainder(turned, math.tau)
        self.objects.append(
            SceneObject(
                added.name,
                class_name,
                host.name,
                (*point, z),
                yaw,
                shape.size_m,
                shape.color,
                shape,
            )
        )
        return True

    def _free(self, host: Receptacle, added: _Disc) -> bool:
        others = [disc for disc in self._discs[host.name] if disc.level == added.level]
        near = self._within_reach(host, np.array([(added.x, added.y)]))[0]
        return (
            len(others) < _CROWD
            and bool(near)
            and all(
                math.hypot(added.x - d.x, added.y - d.y) > added.radius + d.radius + _APART_M
                for d in others
            )
        )

    def _spare_spot(self, host: Receptacle, added: _Disc) -> bool:
        """True if one more object fits within reach on a surface with enough headroom."""
        for level, surface in enumerate(host.surfaces):
            if surface.clear_m < 0.2:
                continue
            points = surface_points(surface)
            points = points[self._within_reach(host, points)]
            free = np.ones(len(points), dtype=bool)
            for disc in (*self._discs[host.name], added):
                if disc.level == level:
                    gap = np.hypot(points[:, 0] - disc.x, points[:, 1] - disc.y) - disc.radius
                    free &= gap > _SPARE_RADIUS_M
            if free.any():
                return True
        return False

    def _within_reach(self, host: Receptacle, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        distances = self._f.distances(points, self._reach[host.room])
        return distances <= self._f.preset.reach_m - _REACH_SLACK_M


def _hides(screen_m: Vec3, small_m: Vec3) -> bool:
    """True if an object of size `screen_m` can hide most of an object of size `small_m`."""
    tall = screen_m[2] >= max(_TALL_M, 1.25 * small_m[2])
    return tall and 1.3 * min(screen_m[:2]) >= max(small_m[:2])


def _world(surface: Surface, u: float, v: float) -> Point:
    cos, sin = math.cos(surface.yaw_rad), math.sin(surface.yaw_rad)
    cx, cy = surface.center_xy
    return cx + cos * u - sin * v, cy + sin * u + cos * v


def _to_edge(surface: Surface, point: Point) -> float:
    """Distance to the nearest edge of the surface; negative outside."""
    dx, dy = point[0] - surface.center_xy[0], point[1] - surface.center_xy[1]
    cos, sin = math.cos(surface.yaw_rad), math.sin(surface.yaw_rad)
    half_x, half_y = surface.half_extent_xy
    return min(half_x - abs(cos * dx + sin * dy), half_y - abs(cos * dy - sin * dx))


def _radius(shape: Shape) -> float:
    x, y, _ = shape.size_m
    return (
        x / 2
        if x == y and len(shape.collision_primitives) > 0 and _is_round(shape)
        else math.hypot(x, y) / 2
    )


def _is_round(shape: Shape) -> bool:
    return (
        all(solid.kind in ("cylinder", "sphere") for solid in shape.collision_primitives)
        and not shape.rolls
    )
