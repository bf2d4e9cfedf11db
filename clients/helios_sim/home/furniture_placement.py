"""Furniture placement in rooms, such that the home stays passable."""

import math

import numpy as np
from numpy.typing import NDArray

from helios_sim.home import floor_plans, freespace
from helios_sim.home.color_palette import Palette
from helios_sim.home.freespace import CELL_M, Obstacle
from helios_sim.home.furnished_floor import FurnishedFloor, world_surface
from helios_sim.home.home_types import Doorway, Fixture, Receptacle, Room, Shape, Surface
from helios_sim.home.presets import HomePreset
from helios_sim.home.wall_placement import Placed, Pose, Poses

_DOOR_CLEARANCE_M = 0.95


class FurniturePlacer(FurnishedFloor):
    """Placement of furniture; holds the furniture placed so far and the remaining free space."""

    def __init__(
        self,
        rooms: tuple[Room, ...],
        doorways: tuple[Doorway, ...],
        preset: HomePreset,
        palette: Palette,
        rng: np.random.Generator,
    ) -> None:
        walls = freespace.obstacles(rooms, doorways, (), ())
        super().__init__(rooms, floor_plans.bounds_of(rooms), walls, preset, palette, rng)
        self.doorways = doorways
        self._taken: list[list[Obstacle]] = [[] for _ in rooms]
        self._keep_out = [
            Obstacle(
                door.x,
                door.y,
                _DOOR_CLEARANCE_M if door.axis == 0 else door.width_m / 2 + 0.08,
                door.width_m / 2 + 0.08 if door.axis == 0 else _DOOR_CLEARANCE_M,
                0.0,
            )
            for door in doorways
        ]

    # ---- placement

    def receptacle(
        self, class_name: str, room: Room, poses: Poses, *, beside: Placed | None = None
    ) -> Receptacle | None:
        """Place a receptacle at the first pose that fits; return None if none fits.

        It may touch the footprint of `beside`.
        """
        stem, make = self.catalog.receptacles[class_name]
        shape = make(self.rng, self.palette)
        pose = self._first_fit(shape, room, poses, with_surfaces=True, ignore=beside)
        if pose is None:
            return None
        item = Receptacle(
            self.name(stem),
            class_name,
            room.index,
            *pose,
            shape.size_m,
            tuple(world_surface(surface, pose) for surface in shape.surfaces),
            shape.color,
            shape,
        )
        self.receptacles.append(item)
        self._occupy(freespace.footprint(item), room)
        return item

    def fixture(
        self, class_name: str, room: Room, poses: Poses, *, beside: Placed | None = None
    ) -> Fixture | None:
        """Place a blocking fixture, like `receptacle`; it may touch the footprint of `beside`."""
        shape = self.catalog.fixtures[class_name](self.rng, self.palette)
        pose = self._first_fit(shape, room, poses, ignore=beside)
        return None if pose is None else self.hang(class_name, room, pose, shape, blocks=True)

    def hang(
        self,
        class_name: str,
        room: Room,
        pose: Pose,
        shape: Shape,
        *,
        z_m: float = 0.0,
        blocks: bool = False,
    ) -> Fixture:
        """Place a fixture at a pose that is known to fit."""
        item = Fixture(
            self.name(class_name.replace(" ", "_")),
            class_name,
            room.index,
            *pose,
            shape.size_m,
            blocks,
            shape.color,
            shape,
            z_m,
        )
        self.fixtures.append(item)
        if blocks:
            self._occupy(freespace.footprint(item), room)
        return item

    def lay(self, class_name: str, room: Room, pose: Pose, shape: Shape) -> None:
        """Place a flat fixture such as a rug, if it fits between the walls."""
        if _inside(_rect(shape, pose), room):
            self.hang(class_name, room, pose, shape)

    # ---- checks

    def stands_open(self, shape: Shape, room: Room, pose: Pose) -> bool:
        """True if a door leaf fits there; it may be close to doorways, but not to furniture."""
        rect = _rect(shape, pose)
        free = not any(_overlap(rect, other, 0.03) for other in self._taken[room.index])
        return _inside(rect, room) and free and self._stays_passable(rect, room, [])

    def _first_fit(
        self,
        shape: Shape,
        room: Room,
        poses: Poses,
        *,
        with_surfaces: bool = False,
        ignore: Placed | None = None,
    ) -> Pose | None:
        spared = freespace.footprint(ignore) if ignore else None
        for pose in poses(shape, room):
            rect = _rect(shape, pose)
            if not _inside(rect, room):
                continue
            others = [other for other in self._taken[room.index] if other != spared]
            if any(_overlap(rect, other, 0.03) for other in others):
                continue
            if any(_overlap(rect, keep, 0.0) for keep in self._keep_out):
                continue
            surfaces = [world_surface(s, pose) for s in shape.surfaces] if with_surfaces else []
            if self._stays_passable(rect, room, surfaces):
                return pose
        return None

    def _stays_passable(self, rect: Obstacle, room: Room, surfaces: list[Surface]) -> bool:
        clearance = np.minimum(self.clearance, freespace.distance_m(self.bounds, rect, CELL_M))
        free = clearance > self.preset.passage_radius_m
        main = freespace.largest_region(free)
        if int(free.sum()) - int(main.sum()) > 0.5 / CELL_M**2:
            return False
        for door in self.doorways:
            if not main[freespace.cell_of(door.x, door.y, self.bounds, CELL_M)]:
                return False
        reach = self.reach_map(room.index, main)
        groups = [r.surfaces for r in self.receptacles if r.room == room.index]
        if surfaces:
            groups.append(tuple(surfaces))
        return all(self.reachable(group, reach) for group in groups)

    def _occupy(self, rect: Obstacle, room: Room) -> None:
        self._taken[room.index].append(rect)
        np.minimum(
            self.clearance, freespace.distance_m(self.bounds, rect, CELL_M), out=self.clearance
        )


def _rect(shape: Shape, pose: Pose) -> Obstacle:
    return Obstacle(pose[0], pose[1], shape.size_m[0] / 2, shape.size_m[1] / 2, pose[2])


def _corners(rect: Obstacle, grow: float) -> NDArray[np.float64]:
    cos, sin = math.cos(rect.yaw_rad), math.sin(rect.yaw_rad)
    a = np.array([1, 1, -1, -1]) * (rect.half_x + grow)
    b = np.array([1, -1, -1, 1]) * (rect.half_y + grow)
    return np.stack([rect.x + cos * a - sin * b, rect.y + sin * a + cos * b], axis=1)


def _inside(rect: Obstacle, room: Room) -> bool:
    points = _corners(rect, 0.0)
    inset = floor_plans.WALL_HALF_M
    return bool(
        points[:, 0].min() >= room.x0 + inset
        and points[:, 0].max() <= room.x1 - inset
        and points[:, 1].min() >= room.y0 + inset
        and points[:, 1].max() <= room.y1 - inset
    )


def stays_apart(a: Obstacle, b: Obstacle, gap_m: float) -> bool:
    """True if two rotated rectangles are at least about `gap_m` apart."""
    return not _overlap(a, b, gap_m)


def _overlap(a: Obstacle, b: Obstacle, gap_m: float) -> bool:
    """True if two rotated rectangles are closer than about `gap_m` (separating axis test)."""
    ca, cb = _corners(a, gap_m / 2), _corners(b, gap_m / 2)
    for yaw in (a.yaw_rad, b.yaw_rad):
        for axis in ((math.cos(yaw), math.sin(yaw)), (-math.sin(yaw), math.cos(yaw))):
            pa, pb = ca @ np.array(axis), cb @ np.array(axis)
            if pa.max() <= pb.min() or pb.max() <= pa.min():
                return False
    return True
