"""Builds the home of a plan: structure and furniture once per file, household things per seed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from helios_core.errors import InvalidInput, Unavailable
from numpy.typing import NDArray

from helios_sim.home import freespace
from helios_sim.home.catalog import FurnitureModels
from helios_sim.home.catalogs import CATALOGS
from helios_sim.home.color_palette import Palette, draw_palette
from helios_sim.home.freespace import CELL_M, Obstacle
from helios_sim.home.furnished_floor import FurnishedFloor
from helios_sim.home.furniture_placement import stays_apart
from helios_sim.home.home_generator import floor_style, scattered, start_pose
from helios_sim.home.home_types import Fixture, Room, RoomStyle, Shape
from helios_sim.home.presets import OVMM_V1, HomePreset
from helios_sim.home.wall_placement import Pose
from helios_sim.plans import household_file, plan_openings
from helios_sim.plans.floor_area import FloorArea, corners_of, floor_area, outside_obstacles
from helios_sim.plans.furniture_classes import room_kind
from helios_sim.plans.piece_shapes import PieceShapes
from helios_sim.plans.plan_archive import PlanArchive
from helios_sim.plans.plan_furniture import Furnishing, furnish, placed_pieces, room_of
from helios_sim.plans.plan_home import PlanHome, wall_obstacles
from helios_sim.plans.plan_openings import Doors
from helios_sim.plans.plan_reader import read_plan
from helios_sim.plans.plan_source import PlanSource, file_sha256
from helios_sim.plans.plan_types import DrawnRoom, Opening, Plan
from helios_sim.plans.wall_blocks import WallBlock, cut, wall_of, whole_blocks

MOST_SIDE_M = 100.0
_THINGS_PER_HOST = 1.6
_THINGS = (4, 30)
_CLASSES = 12
_FEWER = 0.75
_LEAF_GAP_M = 0.02
_LEAF_TAKES_M2 = 1.2  # most free floor that an open leaf may take
# By the furniture of a room whose name says nothing, in this order.
_KIND_OF = (
    ("toilet", "bathroom"), ("bathtub", "bathroom"), ("shower", "bathroom"), ("bed", "bedroom"),
    ("cooker", "kitchen"), ("kitchen counter", "kitchen"), ("fridge", "kitchen"),
    ("sofa", "living room"), ("TV stand", "living room"), ("dining table", "dining room"),
    ("desk", "office"), ("washing machine", "laundry room"),
)  # fmt: skip

Bounds = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class DrawnHome:
    """Home of a plan without household things. `clearance` [rows, columns] as of `FurnishedFloor`.

    `home` has the start pose of seed 0.
    """

    plan: Plan
    home: PlanHome
    palette: Palette
    clearance: NDArray[np.float64]
    doors: Doors
    furnishing: Furnishing
    area: FloorArea
    model_failures: dict[str, str]

    def floor(self, seed: int) -> FurnishedFloor:
        """Furnished floor on which the things of a seed are placed."""
        home = self.home
        rng = np.random.default_rng([int(self.plan.sha256[:8], 16), seed])
        floor = FurnishedFloor(home.rooms, home.bounds, (), home.preset, self.palette, rng)
        floor.clearance = self.clearance.copy()
        floor.receptacles = list(home.receptacles)
        return floor

    def unreachable_rooms(self) -> list[Room]:
        """Rooms in which the robot cannot stand."""
        passable = self.floor(0).passable()
        masks = (freespace.room_mask(room, self.home.bounds, CELL_M) for room in self.home.rooms)
        return [
            room
            for room, mask in zip(self.home.rooms, masks, strict=True)
            if not (mask & passable).any()
        ]


def home_of_plan(
    source: PlanSource, seed: int, furniture_models: FurnitureModels | None = None
) -> PlanHome:
    """Home of a plan with the household things and the start pose of a seed.

    Raises InvalidInput if the plan cannot be used, and Unavailable if it is not the file it was.
    """
    if seed < 0:
        raise InvalidInput(f"seed {seed} came; a seed of 0 or more is wanted")
    drawn = drawn_home(source, furniture_models)
    floor = drawn.floor(seed)
    start = start_pose(floor)
    assert start is not None  # `drawn_home` found one
    empty = replace(drawn.home, seed=seed, start_pose=start)
    if source.things_sha256:
        beside = household_file.path_beside(source.path)
        things = household_file.read_things(beside)
        if file_sha256(beside) != source.things_sha256:
            raise Unavailable(f"{beside} has changed since the run began; begin another run")
        return household_file.laid(empty, floor, things)
    return _with_things(drawn, empty, seed)


def _with_things(drawn: DrawnHome, empty: PlanHome, seed: int) -> PlanHome:
    """The home with as many household things as its furniture carries."""
    hosts = len(empty.receptacles)
    count = min(_THINGS[1], max(_THINGS[0], round(_THINGS_PER_HOST * hosts)))
    while hosts and count >= 1:
        preset = replace(
            empty.preset, objects=(count, count), min_object_classes=min(_CLASSES, (count + 1) // 2)
        )
        floor = drawn.floor(seed)
        floor.preset = preset
        full = scattered(floor, replace(empty, preset=preset), count)
        if full is not None:
            assert isinstance(full, PlanHome)
            return full
        count = math.floor(count * _FEWER)
    return empty


@lru_cache(maxsize=4)
def drawn_home(source: PlanSource, furniture_models: FurnitureModels | None = None) -> DrawnHome:
    """Home of a plan without household things; the last ones are kept.

    Raises InvalidInput if the plan cannot be used, and Unavailable if it is not the file it was.
    """
    with PlanArchive(source.path) as archive:
        now = PlanSource.of(source.path, source.level)
        _check_same(source.path, source.sha256, archive.sha256)
        beside = household_file.path_beside(source.path)
        _check_same(beside, source.things_sha256, now.things_sha256)
        plan = read_plan(archive, source.level)
        catalog = CATALOGS[OVMM_V1.catalog]
        if furniture_models is not None:
            catalog = furniture_models.applied_to(catalog)
        rng = np.random.default_rng(int(plan.sha256[:8], 16))
        palette = draw_palette(rng)
        return _Builder(plan, preset_of(source), palette, rng).build(
            PieceShapes(archive, catalog, palette)
        )


def _check_same(path: Path, then: str, now: str) -> None:
    """Compare the digests of a file, empty without it. Raises Unavailable if they differ."""
    if then != now:
        raise Unavailable(
            f"{path} is no longer the file it was ({then[:12] or 'none'}, now "
            f"{now[:12] or 'none'}); start again with the new file"
        )


def preset_of(source: PlanSource) -> HomePreset:
    """Preset that stands for the homes of a plan: the benchmark's, with narrower passages."""
    return replace(
        OVMM_V1,
        name=source.kind,
        clearance_margin_m=0.05,
        hidden_objects=0,
        objects=(0, _THINGS[1]),
        min_object_classes=0,
    )


class _Builder:
    """Builds the drawn home of one plan."""

    def __init__(
        self, plan: Plan, preset: HomePreset, palette: Palette, rng: np.random.Generator
    ) -> None:
        self._plan, self._preset, self._palette, self._rng = plan, preset, palette, rng

    def build(self, shapes: PieceShapes) -> DrawnHome:
        plan = self._plan
        whole = whole_blocks(plan.walls)
        _check_extent(plan, whole)
        area = floor_area(plan.rooms, whole)
        if not area.rooms:
            raise InvalidInput(
                f"{_where(plan)} has no closed room: draw walls all around a room, or the room "
                f"itself with the tool Create rooms{_other_levels(plan)}"
            )
        rooms = tuple(_room(k, room) for k, room in enumerate(area.rooms))
        furnishing = placed_pieces(plan.pieces, area, rooms, shapes)
        rooms = tuple(_with_kind(room, furnishing) for room in rooms)
        whole = [block for block in whole if _beside(block, area)]
        doors = plan_openings.sorted_doors(plan.openings, whole, area, rooms)
        walls = (*cut(whole, doors.opened), *area.closing)
        bounds = _bounds(rooms, walls)
        outside = tuple(outside_obstacles(area, bounds))
        floor = FurnishedFloor(
            rooms,
            bounds,
            [*wall_obstacles(walls), *outside],
            self._preset,
            self._palette,
            self._rng,
        )
        floor.catalog = shapes.catalog
        furnish(floor, furnishing)
        self._add_openings(floor, doors, whole, area, furnishing)
        start = start_pose(floor)
        if start is None or not floor.passable().any():
            raise InvalidInput(
                f"{_where(plan)} has no free floor where the robot, 0.6 m wide, can stand and "
                "turn; draw larger rooms or less furniture"
            )
        home = PlanHome(
            seed=0, preset=self._preset, rooms=rooms, doorways=(),
            receptacles=tuple(floor.receptacles), objects=(), fixtures=tuple(floor.fixtures),
            start_pose=start, bounds=bounds, styles=self._styles(area.rooms, rooms), walls=walls,
            doors=doors.open_doors, outside=outside,
        )  # fmt: skip
        return DrawnHome(
            plan, home, self._palette, floor.clearance, doors, furnishing, area, shapes.failures
        )

    def _styles(self, drawn: Sequence[DrawnRoom], rooms: Sequence[Room]) -> tuple[RoomStyle, ...]:
        styles = []
        for room, kept in zip(rooms, drawn, strict=True):
            style = floor_style(self._rng, room, self._palette)
            rgb = kept.floor_rgb or style.floor_rgb
            styles.append(replace(style, floor_rgb=rgb))
        return tuple(styles)

    def _add_openings(
        self,
        floor: FurnishedFloor,
        doors: Doors,
        whole: Sequence[WallBlock],
        area: FloorArea,
        furnishing: Furnishing,
    ) -> None:
        """Hang windows and shut doors, and open leaves where they fit."""
        rooms = floor.rooms
        for opening, door in doors.shut:
            shape = plan_openings.shut_door_shape(door, self._palette, self._rng)
            pose = (door.x, door.y, door.yaw_rad)
            self._hang(floor, "door", pose, shape, 0.0, self._nearest(opening, rooms, area))
        for opening in self._plan.openings:
            wall = wall_of(opening, whole) if opening.kind == "window" else None
            if wall is not None:
                shape = plan_openings.window_shape(opening, wall[2])
                pose = (wall[0], wall[1], opening.yaw_rad)
                room = self._nearest(opening, rooms, area)
                self._hang(floor, "window", pose, shape, max(opening.z_m, 0.0), room)
        self._open_leaves(floor, doors, area, furnishing)

    def _open_leaves(
        self, floor: FurnishedFloor, doors: Doors, area: FloorArea, furnishing: Furnishing
    ) -> None:
        """Hang the open leaf of each door where it neither touches furniture nor blocks a way."""
        taken = [placed.footprint for placed in furnishing.pieces if placed.blocks]
        for door, opening in zip(doors.open_doors, doors.opened, strict=True):

            def fits(shape: Shape, pose: Pose) -> bool:
                rect = _rect(shape, pose)
                free = all(stays_apart(rect, other, _LEAF_GAP_M) for other in taken)
                return free and _on_floor(rect, area) and self._stays_passable(floor, rect)

            leaf = plan_openings.open_leaf(door, opening, self._palette, self._rng, fits)
            if leaf is not None:
                shape, pose = leaf
                room = room_of(pose[0], pose[1], floor.rooms, area) or 0
                item = self._hang(floor, "door", pose, shape, 0.0, room, blocks=True)
                taken.append(freespace.footprint(item))
                away = freespace.distance_m(floor.bounds, taken[-1], CELL_M)
                np.minimum(floor.clearance, away, out=floor.clearance)

    def _stays_passable(self, floor: FurnishedFloor, rect: Obstacle) -> bool:
        away = freespace.distance_m(floor.bounds, rect, CELL_M)
        left = freespace.largest_region(
            np.minimum(floor.clearance, away) > self._preset.passage_radius_m
        )
        lost = int(floor.passable().sum()) - int(left.sum())
        return lost < _LEAF_TAKES_M2 / CELL_M**2 and self._still_reached(floor, left)

    @staticmethod
    def _still_reached(floor: FurnishedFloor, passable: NDArray[np.bool_]) -> bool:
        reach = {room.index: floor.reach_map(room.index, passable) for room in floor.rooms}
        return all(floor.reachable(host.surfaces, reach[host.room]) for host in floor.receptacles)

    @staticmethod
    def _nearest(opening: Opening, rooms: Sequence[Room], area: FloorArea) -> int:
        found = room_of(opening.x, opening.y, rooms, area)
        if found is not None:
            return found
        return min(rooms, key=lambda r: math.dist(r.center_xy, (opening.x, opening.y))).index

    @staticmethod
    def _hang(
        floor: FurnishedFloor,
        class_name: str,
        pose: Pose,
        shape: Shape,
        z_m: float,
        room: int,
        *,
        blocks: bool = False,
    ) -> Fixture:
        item = Fixture(
            floor.name(class_name),
            class_name,
            room,
            *pose,
            shape.size_m,
            blocks,
            shape.color,
            shape,
            z_m,
        )
        floor.fixtures.append(item)
        return item


def _room(index: int, drawn: DrawnRoom) -> Room:
    x, y = np.array(drawn.outline).T
    return Room(
        index,
        room_kind(drawn.name),
        float(x.min()),
        float(y.min()),
        float(x.max()),
        float(y.max()),
        drawn.outline,
    )


def _with_kind(room: Room, furnishing: Furnishing) -> Room:
    """The room with a kind: that of its name, else by its furniture, else "room"."""
    if room.kind:
        return room
    there = {placed.class_name for placed in furnishing.pieces if placed.room == room.index}
    return replace(room, kind=next((kind for name, kind in _KIND_OF if name in there), "room"))


def _check_extent(plan: Plan, blocks: Sequence[WallBlock]) -> None:
    points = [p for room in plan.rooms for p in room.outline]
    points += [p for wall in plan.walls for p in (wall.start, wall.end)]
    if not points:
        raise InvalidInput(
            f"{_where(plan)} has neither walls nor rooms; draw them{_other_levels(plan)}"
        )
    points += [corner for block in blocks for corner in corners_of(block.footprint)]
    side = float(np.ptp(np.array(points), axis=0).max())
    if side > MOST_SIDE_M:
        raise InvalidInput(
            f"{_where(plan)} is {side:.0f} m wide; up to {MOST_SIDE_M:.0f} m are read: delete what "
            "is far from the home, or check the unit of the drawing"
        )


def _where(plan: Plan) -> str:
    return f"{plan.file_name}, level {plan.level}," if plan.level else plan.file_name


def _other_levels(plan: Plan) -> str:
    others = ", ".join(name for name in plan.other_levels if name)
    return f", or give another level with --level: {others}" if others else ""


def _beside(block: WallBlock, area: FloorArea) -> bool:
    """True if a wall is less than 0.6 m from indoor floor."""
    steps = max(2, math.ceil(block.length_m / 0.3))
    cos, sin = math.cos(block.yaw_rad), math.sin(block.yaw_rad)
    for u in np.linspace(-block.length_m / 2, block.length_m / 2, steps):
        for v in (-1, 1):
            off = v * (block.thickness_m / 2 + 0.1)
            if area.is_floor(block.x + cos * u - sin * off, block.y + sin * u + cos * off):
                return True
    return False


def _bounds(rooms: Sequence[Room], walls: Sequence[WallBlock]) -> Bounds:
    x, y = [], []
    for block in walls:
        cos, sin = abs(math.cos(block.yaw_rad)), abs(math.sin(block.yaw_rad))
        hx = (cos * block.length_m + sin * block.thickness_m) / 2
        hy = (sin * block.length_m + cos * block.thickness_m) / 2
        x += [block.x - hx, block.x + hx]
        y += [block.y - hy, block.y + hy]
    x += [v for room in rooms for v in (room.x0, room.x1)]
    y += [v for room in rooms for v in (room.y0, room.y1)]
    return min(x), min(y), max(x), max(y)


def _rect(shape: Shape, pose: Pose) -> Obstacle:
    return Obstacle(pose[0], pose[1], shape.size_m[0] / 2, shape.size_m[1] / 2, pose[2])


def _on_floor(rect: Obstacle, area: FloorArea) -> bool:
    cos, sin = math.cos(rect.yaw_rad), math.sin(rect.yaw_rad)
    return all(
        area.is_floor(rect.x + cos * u, rect.y + sin * u)
        for u in np.linspace(-rect.half_x, rect.half_x, 9)
    )
