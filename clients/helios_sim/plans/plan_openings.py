"""Doors and windows of a plan: which doors stand open, and how all of them look."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from helios_sim.home.color_palette import Palette, darker
from helios_sim.home.doors import door_leaf
from helios_sim.home.home_types import Material, Room, Shape
from helios_sim.home.shape_builder import ShapeBuilder
from helios_sim.home.wall_placement import Pose
from helios_sim.plans.floor_area import FloorArea
from helios_sim.plans.piece_shapes import fitted
from helios_sim.plans.plan_structure import PlanDoor
from helios_sim.plans.plan_types import Opening
from helios_sim.plans.wall_blocks import WallBlock, wall_of

_BEYOND_M = (0.12, 0.25, 0.4)
_PROUD_M = 0.02
_HINGE_ASIDE_M, _HINGE_BEFORE_M = 0.035, 0.045
_OPEN_RAD = (math.radians(98), math.radians(165))
_GLASS = Material((0.74, 0.84, 0.90), "", 0.5, 0.6)
_WHITE = Material((0.95, 0.95, 0.93), "", 0.15, 0.3)


@dataclass(frozen=True)
class Doors:
    """Doors of a plan. `open_doors` and `opened` belong together, one by one."""

    open_doors: tuple[PlanDoor, ...]
    opened: tuple[Opening, ...]
    shut: tuple[tuple[Opening, PlanDoor], ...]  # lead outdoors or to nothing
    nowhere: tuple[Opening, ...]  # in no wall


def sorted_doors(
    openings: Sequence[Opening],
    blocks: Sequence[WallBlock],
    area: FloorArea,
    rooms: Sequence[Room],
) -> Doors:
    """Doors between two indoor floors stand open; a door to anywhere else stays shut."""
    open_doors: list[PlanDoor] = []
    opened: list[Opening] = []
    shut: list[tuple[Opening, PlanDoor]] = []
    nowhere: list[Opening] = []
    for opening in openings:
        if opening.kind != "door":
            continue
        wall = wall_of(opening, blocks)
        if wall is None:
            nowhere.append(opening)
            continue
        sides = [_beyond(opening, wall, side, area) for side in (-1, 1)]
        indices = tuple(r.index for p in sides if p for r in rooms if r.contains(*p))
        door = PlanDoor(
            opening.name,
            wall[0],
            wall[1],
            opening.yaw_rad,
            opening.width_m,
            opening.z_m + opening.height_m,
            wall[2],
            indices,
        )
        if None in sides:
            shut.append((opening, door))
        else:
            open_doors.append(door)
            opened.append(opening)
    return Doors(tuple(open_doors), tuple(opened), tuple(shut), tuple(nowhere))


def _beyond(
    opening: Opening, wall: tuple[float, float, float], side: int, area: FloorArea
) -> tuple[float, float] | None:
    """Point on indoor floor on a side of the wall; None if there is none."""
    x, y, thick = wall
    for past in _BEYOND_M:
        away = side * (thick / 2 + past)
        point = x - math.sin(opening.yaw_rad) * away, y + math.cos(opening.yaw_rad) * away
        if area.is_floor(*point):
            return point
    return None


def shut_door_shape(door: PlanDoor, palette: Palette, rng: np.random.Generator) -> Shape:
    """Closed door that covers its wall on both sides."""
    leaf = door_leaf(rng, palette, door.width_m)
    return fitted(leaf, (door.width_m, door.wall_m + 2 * _PROUD_M, door.height_m))


def window_shape(opening: Opening, wall_m: float) -> Shape:
    """Window that covers its wall on both sides; its origin is at its lower edge.

    Glass is drawn opaque, so that images and depth agree with the collision shape.
    """
    width, height, depth = opening.width_m, opening.height_m, wall_m + 2 * _PROUD_M
    b = ShapeBuilder()
    b.box((0.0, 0.0, height / 2), (width, depth, height), _WHITE, solid=True)
    rim = min(0.06, width / 6, height / 6)
    panes = max(1, round(width / 0.9))
    pane = (width - rim) / panes - rim
    for k in range(panes):
        x = -width / 2 + rim + pane / 2 + k * (pane + rim)
        b.box((x, 0.0, height / 2), (pane, depth + 0.006, height - 2 * rim), _GLASS)
    return b.finish((width, depth, height), darker(_GLASS, 1.0))


def open_leaf(
    door: PlanDoor,
    opening: Opening,
    palette: Palette,
    rng: np.random.Generator,
    fits: Callable[[Shape, Pose], bool],
) -> tuple[Shape, Pose] | None:
    """Open leaf of a door and its pose, as its plan swings it if it fits there.

    None for an opening without a leaf in the plan, and where no pose fits.
    """
    if opening.hinge == 0:
        return None
    shape = fitted(
        door_leaf(rng, palette, opening.width_m),
        (opening.width_m - 0.02, 0.04, max(0.5, opening.height_m - 0.03)),
    )
    return next(((shape, pose) for pose in _leaf_poses(door, opening) if fits(shape, pose)), None)


def _leaf_poses(door: PlanDoor, opening: Opening) -> Iterator[Pose]:
    ways = [(opening.hinge, opening.swing or 1), (opening.hinge, -(opening.swing or 1))]
    ways += [(-s, t) for s, t in ways]
    half = opening.width_m / 2 - 0.01
    for s, t in ways:
        for angle in _OPEN_RAD[::-1]:
            along = s * (door.width_m / 2 + _HINGE_ASIDE_M)
            across = t * (door.wall_m / 2 + _HINGE_BEFORE_M)
            du, dv = -s * math.cos(angle), t * math.sin(angle)
            u, v = along + du * half, across + dv * half
            cos, sin = math.cos(door.yaw_rad), math.sin(door.yaw_rad)
            yield (
                door.x + cos * u - sin * v,
                door.y + sin * u + cos * v,
                door.yaw_rad + math.atan2(dv, du),
            )
