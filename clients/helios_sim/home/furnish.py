"""Puts furniture into rooms: each piece at a fitting place that keeps the home passable."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from helios_sim.home import freespace, plan
from helios_sim.home.catalog import FIXTURES, RECEPTACLES
from helios_sim.home.freespace import CELL_M, Obstacle
from helios_sim.home.palette import Palette
from helios_sim.home.presets import HomePreset
from helios_sim.home.types import Doorway, Fixture, Receptacle, Room, Shape, Surface

Pose = tuple[float, float, float]  # x, y, yaw
Placed = Receptacle | Fixture
Poses = Callable[[Shape, Room], Iterator[Pose]]  # places to try, best first

WEST, EAST, SOUTH, NORTH = range(4)
# Yaw with which furniture stands with its back (+y) to a wall.
WALL_YAW = {
    WEST: math.pi / 2,
    EAST: -math.pi / 2,
    SOUTH: math.pi,
    NORTH: 0.0,
}
_GAP_TO_WALL_M = 0.01
_DOOR_CLEARANCE_M = 0.95
_TRIES = 40
_LATTICE_M = 0.1
_REACHABLE_SHARE = 0.2


def wall_pose(room: Room, side: int, along: float, off_wall: float) -> Pose:
    """A pose `off_wall` metres in front of a wall's face, `along` it in world coordinates."""
    off = plan.WALL_HALF_M + off_wall
    yaw = WALL_YAW[side]
    if side == WEST:
        return room.x0 + off, along, yaw
    if side == EAST:
        return room.x1 - off, along, yaw
    if side == SOUTH:
        return along, room.y0 + off, yaw
    return along, room.y1 - off, yaw


def wall_range(room: Room, side: int) -> tuple[float, float]:
    """The inner extent of a wall along itself."""
    lo, hi = (room.y0, room.y1) if side in (WEST, EAST) else (room.x0, room.x1)
    return lo + plan.WALL_HALF_M, hi - plan.WALL_HALF_M


def side_of(yaw_rad: float) -> int:
    """The wall to which furniture of that yaw has its back."""
    return min(WALL_YAW, key=lambda side: abs(math.remainder(WALL_YAW[side] - yaw_rad, math.tau)))


def world_surface(surface: Surface, pose: Pose) -> Surface:
    """A surface of a shape whose frame stands at `pose`."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    cx, cy = surface.center_xy
    return replace(
        surface,
        center_xy=(pose[0] + cos * cx - sin * cy, pose[1] + sin * cx + cos * cy),
        yaw_rad=surface.yaw_rad + pose[2],
    )


def surface_points(surface: Surface, inset_m: float = 0.06) -> NDArray[np.float64]:
    """A lattice of points [n, 2] on a surface (world), `inset_m` off its edges."""
    axes = []
    for half in surface.half_extent_xy:
        reach = max(half - inset_m, 0.0)
        axes.append(np.linspace(-reach, reach, max(2, round(2 * reach / _LATTICE_M) + 1)))
    u, v = (grid.ravel() for grid in np.meshgrid(*axes))
    cos, sin = math.cos(surface.yaw_rad), math.sin(surface.yaw_rad)
    return np.stack(
        [surface.center_xy[0] + cos * u - sin * v, surface.center_xy[1] + sin * u + cos * v], axis=1
    )


class Furnisher:
    """Furniture placed so far, and the free space that is left."""

    def __init__(
        self,
        rooms: tuple[Room, ...],
        doorways: tuple[Doorway, ...],
        preset: HomePreset,
        palette: Palette,
        rng: np.random.Generator,
    ) -> None:
        self.rooms, self.doorways, self.preset = rooms, doorways, preset
        self.palette, self.rng = palette, rng
        self.bounds = plan.bounds_of(rooms)
        self.receptacles: list[Receptacle] = []
        self.fixtures: list[Fixture] = []
        walls = freespace.obstacles(rooms, doorways, (), ())
        self.clearance = freespace.clearance_m(self.bounds, walls, CELL_M)
        self._taken: list[list[Obstacle]] = [[] for _ in rooms]
        self._counts: dict[str, int] = {}
        self._masks = [freespace.room_mask(room, self.bounds, CELL_M) for room in rooms]
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

    # ---- what can be placed

    def receptacle(self, class_name: str, room: Room, poses: Poses) -> Receptacle | None:
        """A receptacle at the first of the poses that fits; None if none does."""
        stem, make = RECEPTACLES[class_name]
        shape = make(self.rng, self.palette)
        pose = self._first_fit(shape, room, poses, with_surfaces=True)
        if pose is None:
            return None
        item = Receptacle(
            self._name(stem),
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
        """Furniture that is no receptacle; it may touch the footprint of `beside`."""
        shape = FIXTURES[class_name](self.rng, self.palette)
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
        """A fixture at a pose that is known to fit."""
        item = Fixture(
            self._name(class_name.replace(" ", "_")),
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

    # ---- where it fits

    def passable(self) -> NDArray[np.bool_]:
        """Cells from which the robot, with its margin, reaches everything."""
        return freespace.largest_region(self.clearance > self.preset.passage_radius_m)

    def reach_map(self, room: int, passable: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Distance of each cell to the nearest passable cell of that room."""
        return freespace.distance_to_cells_m(passable & self._masks[room], CELL_M)

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
            rect = Obstacle(pose[0], pose[1], shape.size_m[0] / 2, shape.size_m[1] / 2, pose[2])
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
        clearance = np.minimum(
            self.clearance, freespace.distance_m(self.bounds, rect, CELL_M)
        )
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
        return all(self._reachable(group, reach) for group in groups)

    def _reachable(self, surfaces: tuple[Surface, ...], reach: NDArray[np.float32]) -> bool:
        points = np.concatenate([surface_points(surface) for surface in surfaces])
        near = self.distances(points, reach) <= self.preset.reach_m - 0.1
        return int(near.sum()) >= max(2, math.ceil(_REACHABLE_SHARE * len(points)))

    def distances(
        self, points: NDArray[np.float64], reach: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Values of a reach map at points [n, 2]."""
        columns = ((points[:, 0] - self.bounds[0]) / CELL_M).astype(int)
        rows = ((points[:, 1] - self.bounds[1]) / CELL_M).astype(int)
        return reach[
            np.clip(rows, 0, reach.shape[0] - 1), np.clip(columns, 0, reach.shape[1] - 1)
        ]

    def _occupy(self, rect: Obstacle, room: Room) -> None:
        self._taken[room.index].append(rect)
        np.minimum(
            self.clearance, freespace.distance_m(self.bounds, rect, CELL_M), out=self.clearance
        )

    def _name(self, stem: str) -> str:
        number = self._counts.get(stem, 0)
        self._counts[stem] = number + 1
        return f"{stem}_{number}"

    # ---- ways to choose a place

    def along_walls(self, sides: tuple[int, ...] = (WEST, EAST, SOUTH, NORTH)) -> Poses:
        """Back to a wall, anywhere along it."""

        def poses(shape: Shape, room: Room) -> Iterator[Pose]:
            for _ in range(_TRIES):
                side = sides[int(self.rng.integers(len(sides)))]
                lo, hi = wall_range(room, side)
                half = shape.size_m[0] / 2 + 0.02
                if hi - lo <= 2 * half:
                    continue
                along = float(self.rng.uniform(lo + half, hi - half))
                # Furniture that nearly fills a corner goes right into it.
                if along - half - lo < 0.35:
                    along = lo + half
                elif hi - along - half < 0.35:
                    along = hi - half
                yield wall_pose(room, side, along, shape.size_m[1] / 2 + _GAP_TO_WALL_M)

        return poses

    def corners(self) -> Poses:
        """Back to a wall in a corner."""

        def poses(shape: Shape, room: Room) -> Iterator[Pose]:
            for k in self.rng.permutation(8):
                side = int(k) // 2
                lo, hi = wall_range(room, side)
                half = shape.size_m[0] / 2 + 0.03
                along = lo + half if k % 2 else hi - half
                yield wall_pose(room, side, along, shape.size_m[1] / 2 + 0.03)

        return poses

    def opposite(self, anchor: Placed) -> Poses:
        """Back to the wall that the anchor faces."""
        facing = {WEST: EAST, EAST: WEST, SOUTH: NORTH, NORTH: SOUTH}[side_of(anchor.yaw_rad)]
        center = anchor.y if facing in (WEST, EAST) else anchor.x

        def poses(shape: Shape, room: Room) -> Iterator[Pose]:
            for k in range(_TRIES):
                along = center + float(self.rng.normal(0, 0.04 * k))
                yield wall_pose(room, facing, along, shape.size_m[1] / 2 + _GAP_TO_WALL_M)

        return poses

    def in_front_of(self, anchor: Placed, gap_m: tuple[float, float]) -> Poses:
        """Before the anchor's front, in line with it."""

        def poses(shape: Shape, room: Room) -> Iterator[Pose]:
            del room
            for k in range(_TRIES):
                gap = float(self.rng.uniform(*gap_m))
                ahead = anchor.size_m[1] / 2 + gap + shape.size_m[1] / 2
                yield _shifted(anchor, float(self.rng.normal(0, 0.01 * k)), -ahead)

        return poses

    def beside(self, anchor: Placed) -> Poses:
        """At the anchor's left or right, backs in line."""

        def poses(shape: Shape, room: Room) -> Iterator[Pose]:
            del room
            order = (-1, 1) if self.rng.random() < 0.5 else (1, -1)
            back = (anchor.size_m[1] - shape.size_m[1]) / 2
            for gap in (0.05, 0.1, 0.2, 0.35):
                for side in order:
                    sideways = side * (anchor.size_m[0] / 2 + gap + shape.size_m[0] / 2)
                    yield _shifted(anchor, sideways, back)

        return poses

    def in_the_middle(self) -> Poses:
        """Free in the room, along one of its axes, by preference near its middle."""

        def poses(shape: Shape, room: Room) -> Iterator[Pose]:
            del shape
            cx, cy = room.center_xy
            for k in range(_TRIES):
                yaw = float(self.rng.choice([0.0, math.pi / 2]))
                spread = 0.1 + 0.02 * k
                yield (
                    cx + float(self.rng.normal(0, spread)),
                    cy + float(self.rng.normal(0, spread)),
                    yaw,
                )

        return poses

    def tucked_under(self, table: Placed) -> Poses:
        """Chairs pushed under a table's long sides or ends, backs outward."""

        def poses(shape: Shape, room: Room) -> Iterator[Pose]:
            del room
            seats = []
            w, d = table.size_m[0] / 2, table.size_m[1] / 2
            out = shape.size_m[1] / 2 - 0.2
            for x in (-w * 0.45, w * 0.45) if w > 0.55 else (0.0,):
                seats += [(x, d + out, 0.0), (x, -d - out, math.pi)]
            seats += [(w + out, 0.0, -math.pi / 2), (-w - out, 0.0, math.pi / 2)]
            for k in self.rng.permutation(len(seats)):
                x, y, turn = seats[int(k)]
                px, py, yaw = _shifted(table, x, y)
                yield px, py, yaw + turn + float(self.rng.normal(0, 0.05))

        return poses

    def at_desk(self, desk: Placed) -> Poses:
        """A chair at a desk's front, its back to the room."""

        def poses(shape: Shape, room: Room) -> Iterator[Pose]:
            del room
            for _ in range(6):
                x = float(self.rng.uniform(-0.2, 0.2))
                px, py, yaw = _shifted(desk, x, -desk.size_m[1] / 2 - shape.size_m[1] / 2 + 0.06)
                yield px, py, yaw + math.pi + float(self.rng.normal(0, 0.12))

        return poses


def _shifted(anchor: Placed, dx: float, dy: float) -> Pose:
    cos, sin = math.cos(anchor.yaw_rad), math.sin(anchor.yaw_rad)
    return anchor.x + cos * dx - sin * dy, anchor.y + sin * dx + cos * dy, anchor.yaw_rad


def _corners(rect: Obstacle, grow: float) -> NDArray[np.float64]:
    cos, sin = math.cos(rect.yaw_rad), math.sin(rect.yaw_rad)
    a = np.array([1, 1, -1, -1]) * (rect.half_x + grow)
    b = np.array([1, -1, -1, 1]) * (rect.half_y + grow)
    return np.stack([rect.x + cos * a - sin * b, rect.y + sin * a + cos * b], axis=1)


def _inside(rect: Obstacle, room: Room) -> bool:
    points = _corners(rect, 0.0)
    inset = plan.WALL_HALF_M
    return bool(
        points[:, 0].min() >= room.x0 + inset
        and points[:, 0].max() <= room.x1 - inset
        and points[:, 1].min() >= room.y0 + inset
        and points[:, 1].max() <= room.y1 - inset
    )


def _overlap(a: Obstacle, b: Obstacle, gap_m: float) -> bool:
    """Whether two turned rectangles come closer than about `gap_m` (separating axes)."""
    ca, cb = _corners(a, gap_m / 2), _corners(b, gap_m / 2)
    for yaw in (a.yaw_rad, b.yaw_rad):
        for axis in ((math.cos(yaw), math.sin(yaw)), (-math.sin(yaw), math.cos(yaw))):
            pa, pb = ca @ np.array(axis), cb @ np.array(axis)
            if pa.max() <= pb.min() or pb.max() <= pa.min():
                return False
    return True
