"""Candidate poses for furniture: along walls, beside or in front of furniture, under a table."""

import math
from collections.abc import Callable, Iterator

import numpy as np

from helios_sim.home import floor_plans
from helios_sim.home.home_types import Fixture, Receptacle, Room, Shape

Pose = tuple[float, float, float]  # x, y, yaw
Placed = Receptacle | Fixture
Poses = Callable[[Shape, Room], Iterator[Pose]]  # candidate poses, best first

WEST, EAST, SOUTH, NORTH = range(4)
# Yaw of furniture whose back (+y) is at the wall.
WALL_YAW = {
    WEST: math.pi / 2,
    EAST: -math.pi / 2,
    SOUTH: math.pi,
    NORTH: 0.0,
}
_GAP_TO_WALL_M = 0.01
_TRIES = 40


def wall_pose(room: Room, side: int, along: float, off_wall: float) -> Pose:
    """Pose `off_wall` metres from a wall face, at world coordinate `along` on the wall axis."""
    off = floor_plans.WALL_HALF_M + off_wall
    yaw = WALL_YAW[side]
    if side == WEST:
        return room.x0 + off, along, yaw
    if side == EAST:
        return room.x1 - off, along, yaw
    if side == SOUTH:
        return along, room.y0 + off, yaw
    return along, room.y1 - off, yaw


def wall_range(room: Room, side: int) -> tuple[float, float]:
    """Inner extent (lo, hi) of a wall along its axis."""
    lo, hi = (room.y0, room.y1) if side in (WEST, EAST) else (room.x0, room.x1)
    return lo + floor_plans.WALL_HALF_M, hi - floor_plans.WALL_HALF_M


def side_of(yaw_rad: float) -> int:
    """Wall at the back of furniture with that yaw."""
    return min(WALL_YAW, key=lambda side: abs(math.remainder(WALL_YAW[side] - yaw_rad, math.tau)))


def along_walls(rng: np.random.Generator) -> Poses:
    """Poses with the back to a wall, anywhere along it."""

    def poses(shape: Shape, room: Room) -> Iterator[Pose]:
        for _ in range(_TRIES):
            side = int(rng.integers(4))
            lo, hi = wall_range(room, side)
            half = shape.size_m[0] / 2 + 0.02
            if hi - lo <= 2 * half:
                continue
            along = float(rng.uniform(lo + half, hi - half))
            # Furniture close to a corner is moved into the corner.
            if along - half - lo < 0.35:
                along = lo + half
            elif hi - along - half < 0.35:
                along = hi - half
            yield wall_pose(room, side, along, shape.size_m[1] / 2 + _GAP_TO_WALL_M)

    return poses


def corners(rng: np.random.Generator) -> Poses:
    """Poses with the back to a wall, in a corner."""

    def poses(shape: Shape, room: Room) -> Iterator[Pose]:
        for k in rng.permutation(8):
            side = int(k) // 2
            lo, hi = wall_range(room, side)
            half = shape.size_m[0] / 2 + 0.03
            along = lo + half if k % 2 else hi - half
            yield wall_pose(room, side, along, shape.size_m[1] / 2 + 0.03)

    return poses


def opposite(rng: np.random.Generator, anchor: Placed) -> Poses:
    """Poses with the back to the wall that the anchor faces."""
    facing = {WEST: EAST, EAST: WEST, SOUTH: NORTH, NORTH: SOUTH}[side_of(anchor.yaw_rad)]
    center = anchor.y if facing in (WEST, EAST) else anchor.x

    def poses(shape: Shape, room: Room) -> Iterator[Pose]:
        for k in range(_TRIES):
            along = center + float(rng.normal(0, 0.04 * k))
            yield wall_pose(room, facing, along, shape.size_m[1] / 2 + _GAP_TO_WALL_M)

    return poses


def in_front_of(rng: np.random.Generator, anchor: Placed, gap_m: tuple[float, float]) -> Poses:
    """Poses in front of the anchor, aligned with it."""

    def poses(shape: Shape, room: Room) -> Iterator[Pose]:
        del room
        for k in range(_TRIES):
            gap = float(rng.uniform(*gap_m))
            ahead = anchor.size_m[1] / 2 + gap + shape.size_m[1] / 2
            yield _shifted(anchor, float(rng.normal(0, 0.01 * k)), -ahead)

    return poses


def beside(rng: np.random.Generator, anchor: Placed) -> Poses:
    """Poses to the left or right of the anchor, backs aligned."""

    def poses(shape: Shape, room: Room) -> Iterator[Pose]:
        del room
        order = (-1, 1) if rng.random() < 0.5 else (1, -1)
        back = (anchor.size_m[1] - shape.size_m[1]) / 2
        for gap in (0.05, 0.1, 0.2, 0.35):
            for side in order:
                sideways = side * (anchor.size_m[0] / 2 + gap + shape.size_m[0] / 2)
                yield _shifted(anchor, sideways, back)

    return poses


def in_the_middle(rng: np.random.Generator) -> Poses:
    """Free-standing poses parallel to a room axis, preferably near the room centre."""

    def poses(shape: Shape, room: Room) -> Iterator[Pose]:
        del shape
        cx, cy = room.center_xy
        for k in range(_TRIES):
            yaw = float(rng.choice([0.0, math.pi / 2]))
            spread = 0.1 + 0.02 * k
            yield (
                cx + float(rng.normal(0, spread)),
                cy + float(rng.normal(0, spread)),
                yaw,
            )

    return poses


def tucked_under(rng: np.random.Generator, table: Placed) -> Poses:
    """Poses of chairs pushed under the long sides or ends of a table, backs outward."""

    def poses(shape: Shape, room: Room) -> Iterator[Pose]:
        del room
        seats = []
        w, d = table.size_m[0] / 2, table.size_m[1] / 2
        out = shape.size_m[1] / 2 - 0.2
        for x in (-w * 0.45, w * 0.45) if w > 0.55 else (0.0,):
            seats += [(x, d + out, 0.0), (x, -d - out, math.pi)]
        seats += [(w + out, 0.0, -math.pi / 2), (-w - out, 0.0, math.pi / 2)]
        for k in rng.permutation(len(seats)):
            x, y, turn = seats[int(k)]
            px, py, yaw = _shifted(table, x, y)
            yield px, py, yaw + turn + float(rng.normal(0, 0.05))

    return poses


def at_desk(rng: np.random.Generator, desk: Placed) -> Poses:
    """Poses of a chair at the front of a desk, its back to the room."""

    def poses(shape: Shape, room: Room) -> Iterator[Pose]:
        del room
        for _ in range(6):
            x = float(rng.uniform(-0.2, 0.2))
            px, py, yaw = _shifted(desk, x, -desk.size_m[1] / 2 - shape.size_m[1] / 2 + 0.06)
            yield px, py, yaw + math.pi + float(rng.normal(0, 0.12))

    return poses


def pulled_out(rng: np.random.Generator, table: Placed, *, front_only: bool = False) -> Poses:
    """Poses of chairs around a table, seats mostly outside its edge, backs outward."""

    def poses(shape: Shape, room: Room) -> Iterator[Pose]:
        del room
        w, d = table.size_m[0] / 2, table.size_m[1] / 2
        seats = []
        for x in (-w * 0.5, w * 0.5) if w > 0.55 else (0.0,):
            seats += [(x, -d, math.pi)] if front_only else [(x, d, 0.0), (x, -d, math.pi)]
        if not front_only:
            seats += [(w, 0.0, -math.pi / 2), (-w, 0.0, math.pi / 2)]
        for k in rng.permutation(len(seats)):
            x, y, turn = seats[int(k)]
            out = shape.size_m[1] / 2 - float(rng.uniform(0.03, 0.12))
            x, y = x - out * math.sin(turn), y + out * math.cos(turn)
            px, py, yaw = _shifted(table, x, y)
            yield px, py, yaw + turn + float(rng.normal(0, 0.12))

    return poses


def _shifted(anchor: Placed, dx: float, dy: float) -> Pose:
    cos, sin = math.cos(anchor.yaw_rad), math.sin(anchor.yaw_rad)
    return anchor.x + cos * dx - sin * dy, anchor.y + sin * dx + cos * dy, anchor.yaw_rad
