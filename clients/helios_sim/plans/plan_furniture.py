"""Furniture of a plan: what carries household things, what only stands there, what is left out."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from helios_sim.home import freespace
from helios_sim.home.freespace import Obstacle
from helios_sim.home.furnished_floor import FurnishedFloor, surface_points, world_surface
from helios_sim.home.home_types import Fixture, Receptacle, Room, Shape, Surface
from helios_sim.home.wall_placement import Pose
from helios_sim.plans.floor_area import FloorArea
from helios_sim.plans.furniture_classes import IGNORED, SMALL, class_of
from helios_sim.plans.piece_shapes import PieceShapes, Source, raised
from helios_sim.plans.plan_home import PASSES_BELOW_M
from helios_sim.plans.plan_types import Piece

_FLAT_M = 0.03  # what is no higher lies on the floor, such as a rug
_NEAR_ROOM_M = 0.4
_ROOM_ABOVE_M = 0.25  # headroom that a surface needs
_FREE_SHARE = 0.5
_NEVER_BLOCK = frozenset({"rug", "curtain", "ceiling lamp"})


@dataclass(frozen=True, eq=False)
class PlacedPiece:
    """A piece with its class, its shape and the room it stands in."""

    piece: Piece
    class_name: str
    shape: Shape
    source: Source
    room: int

    @property
    def pose(self) -> Pose:
        return self.piece.x, self.piece.y, self.piece.yaw_rad

    @property
    def top_m(self) -> float:
        return self.piece.z_m + self.piece.size_m[2]

    @property
    def blocks(self) -> bool:
        """True if the robot cannot drive where the piece stands."""
        low = self.piece.z_m < PASSES_BELOW_M and self.top_m > _FLAT_M
        return low and self.class_name not in _NEVER_BLOCK

    @property
    def footprint(self) -> Obstacle:
        width, depth, _ = self.piece.size_m
        return Obstacle(self.piece.x, self.piece.y, width / 2, depth / 2, self.piece.yaw_rad)


@dataclass
class Furnishing:
    """Furniture of a plan. `out_of_reach`: furniture that could carry things elsewhere."""

    pieces: list[PlacedPiece] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    out_of_reach: Counter[str] = field(default_factory=Counter)


def placed_pieces(
    pieces: Sequence[Piece], area: FloorArea, rooms: Sequence[Room], shapes: PieceShapes
) -> Furnishing:
    """Pieces that stand indoors, with their shapes."""
    out = Furnishing()
    small, outdoors = 0, 0
    for piece in pieces:
        class_name = (
            "stairs"
            if piece.stairs
            else class_of(piece.catalog_id, piece.name, piece.size_m, piece.z_m)
        )
        room = room_of(piece.x, piece.y, rooms, area)
        if room is None:
            outdoors += 1
        elif class_name in (SMALL, IGNORED) and max(piece.size_m) < 2.5:
            small += class_name == SMALL
        elif class_name == "curtain":
            out.left_out.append(f"{piece.name}: it is cloth, which HELIOS does not simulate")
        elif class_name != IGNORED:
            shape, source = shapes.shape(piece, class_name)
            out.pieces.append(PlacedPiece(piece, class_name, shape, source, room))
    if small:
        out.left_out.append(
            f"{small} small thing{'s' * (small > 1)} of the plan, as HELIOS adds its own"
        )
    if outdoors:
        out.left_out.append(f"{outdoors} piece{'s' * (outdoors > 1)} outside every room")
    return out


def room_of(x: float, y: float, rooms: Sequence[Room], area: FloorArea) -> int | None:
    """Index of the room at a point, or of the nearest one indoors within 0.4 m; None outdoors."""
    inside = next((room.index for room in rooms if room.contains(x, y)), None)
    if inside is not None:
        return inside
    if not area.indoor[area.grid.at(x, y)]:
        return None
    turns = np.linspace(0, math.tau, 16, endpoint=False)
    for away in (0.1, 0.2, 0.3, _NEAR_ROOM_M):
        for turn in turns:
            px, py = x + away * math.cos(turn), y + away * math.sin(turn)
            for room in rooms:
                if room.contains(px, py):
                    return room.index
    return None


def furnish(floor: FurnishedFloor, furnishing: Furnishing) -> None:
    """Put the pieces on the floor: as receptacles where the robot reaches their surfaces."""
    blocking = [placed for placed in furnishing.pieces if placed.blocks]
    for placed in blocking:
        away = freespace.distance_m(floor.bounds, placed.footprint, freespace.CELL_M)
        np.minimum(floor.clearance, away, out=floor.clearance)
    passable = floor.passable()
    reach = {room.index: floor.reach_map(room.index, passable) for room in floor.rooms}
    lo, hi = floor.preset.surface_height_m
    for placed in furnishing.pieces:
        shape, pose = placed.shape, placed.pose
        carries = placed.class_name in floor.catalog.receptacles and placed.blocks
        if carries:
            lifted = raised(shape, placed.piece.z_m)
            kept = tuple(
                free
                for surface in lifted.surfaces
                if lo <= surface.height_m <= hi
                and (free := _free_surface(surface, placed, furnishing.pieces)) is not None
            )
            in_world = tuple(world_surface(surface, pose) for surface in kept)
            if in_world and floor.reachable(in_world, reach[placed.room]):
                _add_receptacle(floor, placed, replace(lifted, surfaces=kept), in_world)
                continue
            furnishing.out_of_reach[placed.class_name] += 1
        floor.fixtures.append(_fixture(floor, placed))


def _add_receptacle(
    floor: FurnishedFloor, placed: PlacedPiece, shape: Shape, surfaces: tuple[Surface, ...]
) -> None:
    stem = floor.catalog.receptacles[placed.class_name][0]
    floor.receptacles.append(
        Receptacle(
            floor.name(stem),
            placed.class_name,
            placed.room,
            *placed.pose,
            shape.size_m,
            surfaces,
            shape.color,
            shape,
        )
    )


def _fixture(floor: FurnishedFloor, placed: PlacedPiece) -> Fixture:
    shape = placed.shape
    if not placed.blocks:  # the robot drives over it, or below it
        shape = replace(shape, collision_primitives=())
    # Its body may need a name that no receptacle of the class has.
    stem = placed.class_name.replace(" ", "_")
    return Fixture(
        floor.name(stem),
        placed.class_name,
        placed.room,
        *placed.pose,
        shape.size_m,
        placed.blocks,
        shape.color,
        shape,
        max(placed.piece.z_m, 0.0),
    )


def _free_surface(
    surface: Surface, own: PlacedPiece, pieces: Sequence[PlacedPiece]
) -> Surface | None:
    """The surface with the headroom below other pieces; None if they stand on most of it.

    surface: in the frame of its piece, with its height above the floor.
    """
    points = surface_points(world_surface(surface, own.pose))
    taken = np.zeros(len(points), bool)
    clear = surface.clear_m
    for other in pieces:
        if other is own or other.top_m < surface.height_m + 0.02:
            continue
        over = _inside(points, other.footprint)
        if not over.any():
            continue
        gap = other.piece.z_m - surface.height_m
        if gap < _ROOM_ABOVE_M:
            taken |= over
        else:
            clear = min(clear, gap)
    return replace(surface, clear_m=clear) if 1 - taken.mean() >= _FREE_SHARE else None


def _inside(points: np.ndarray, rect: Obstacle) -> np.ndarray:
    cos, sin = math.cos(rect.yaw_rad), math.sin(rect.yaw_rad)
    dx, dy = points[:, 0] - rect.x, points[:, 1] - rect.y
    return (np.abs(cos * dx + sin * dy) < rect.half_x) & (np.abs(cos * dy - sin * dx) < rect.half_y)
