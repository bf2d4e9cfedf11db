"""Structure of a plan in MuJoCo: walls in their colours, floors, ceiling and door frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_sim.home import mesh_primitives, textures, wall_meshes
from helios_sim.home.freespace import Obstacle
from helios_sim.home.home_types import (
    CollisionPrimitive,
    Material,
    Mesh,
    Outline,
    Rgb,
    Room,
    RoomStyle,
    Visual,
)
from helios_sim.home.mujoco_model import GROUP_CEILING, GROUP_STRUCTURE, ModelBuilder
from helios_sim.home.shape_builder import ShapeBuilder
from helios_sim.plans.wall_blocks import WallBlock

Bounds = tuple[float, float, float, float]

_MOST_PX, _PX_PER_M = 2048, 96
_CELL_M = 0.65
_BASE_RGB = (0.62, 0.58, 0.53)
_FRAME_M, _PROUD_M = 0.05, 0.015


@dataclass(frozen=True)
class PlanDoor:
    """Doorway at (x, y) in a wall of that thickness; its x axis runs along the wall."""

    name: str
    x: float
    y: float
    yaw_rad: float
    width_m: float
    height_m: float
    wall_m: float
    rooms: tuple[int, ...]  # on its two sides; a room may lack where the floor belongs to none


def classes_of(doors: Sequence[PlanDoor]) -> dict[str, str]:
    """Class of each structural body of a plan."""
    classes = {"walls": "wall", "ceiling": "ceiling", "floor": "floor"}
    return classes | {f"doorway_{k}": "door frame" for k in range(len(doors))}


def add_structure(
    model: ModelBuilder,
    bounds: Bounds,
    rooms: Sequence[Room],
    styles: Sequence[RoomStyle],
    walls: Sequence[WallBlock],
    doors: Sequence[PlanDoor],
    blocked: Sequence[Obstacle],
) -> None:
    """Add walls, floor, ceiling and door frames. blocked: what shades the floor."""
    body = model.body("walls")
    for k, block in enumerate(walls):
        half = (block.length_m / 2, block.thickness_m / 2, (block.z1_m - block.z0_m) / 2)
        center = (block.x, block.y, (block.z0_m + block.z1_m) / 2)
        turn = block.yaw_rad / 2
        quat = (math.cos(turn), 0.0, 0.0, math.sin(turn))
        model.solid(body, CollisionPrimitive("box", half, center, quat), f"wall_piece_{k}")
    x0, y0, x1, y1 = bounds
    center, half = ((x0 + x1) / 2, (y0 + y1) / 2), ((x1 - x0) / 2, (y1 - y0) / 2)
    floor, ceiling = model.body("floor"), model.body("ceiling")
    model.solid(floor, CollisionPrimitive("box", (*half, 0.05), (*center, -0.05)), "")
    frames = [model.body(f"doorway_{k}") for k in range(len(doors))]
    if not model.visuals:
        return
    default = styles[0].wall_rgb
    model.draw(body, wall_visuals(walls, default), GROUP_STRUCTURE)
    picture = model.picture("floor", floor_picture(bounds, rooms, styles, blocked))
    model.mesh(floor, _sheet(bounds, 0.0, up=True), picture, GROUP_STRUCTURE)
    top = max((block.z1_m for block in walls), default=2.5)
    lid = Visual(_sheet(bounds, top, up=False), wall_meshes.CEILING)
    model.draw(ceiling, [lid], GROUP_CEILING)
    for frame, door in zip(frames, doors, strict=True):
        model.draw(frame, frame_visuals(door), GROUP_STRUCTURE)


def wall_visuals(walls: Sequence[WallBlock], default: Rgb) -> list[Visual]:
    """Painted faces of walls by colour, and their dark tops."""
    faces: dict[Material, list[Mesh]] = {}
    for block in walls:
        left = _paint(block.left_rgb or default)
        right = _paint(block.right_rgb or default)
        hx, hy = block.length_m / 2, block.thickness_m / 2
        z, tall = block.z0_m, block.z1_m - block.z0_m
        long, thick, up = 2 * hx, 2 * hy, (0.0, 0.0, tall)
        along, high = _cells(long), _cells(tall)
        for material, corner, edge, cells in (
            (left, (hx, hy, z), (-long, 0.0, 0.0), along),
            (right, (-hx, -hy, z), (long, 0.0, 0.0), along),
            (left, (hx, -hy, z), (0.0, thick, 0.0), 1),
            (right, (-hx, hy, z), (0.0, -thick, 0.0), 1),
        ):
            mesh = mesh_primitives.quad(corner, edge, up, cells, high)
            faces.setdefault(material, []).append(_placed(mesh, block))
        lids = [(wall_meshes.CAP, (-hx, -hy, block.z1_m), (long, 0.0, 0.0), (0.0, thick, 0.0))]
        if z > 0:
            lids.append((left, (-hx, -hy, z), (0.0, thick, 0.0), (long, 0.0, 0.0)))
        for material, corner, edge_u, edge_v in lids:
            mesh = mesh_primitives.quad(corner, edge_u, edge_v)
            faces.setdefault(material, []).append(_placed(mesh, block))
    return [Visual(mesh_primitives.merge(meshes), paint) for paint, meshes in faces.items()]


def _paint(rgb: Rgb) -> Material:
    return Material(rgb, "plaster", 0.02, 0.1)


def _cells(length_m: float) -> int:
    return min(40, max(1, math.ceil(length_m / _CELL_M)))


def _placed(mesh: Mesh, block: WallBlock) -> Mesh:
    turn = mesh_primitives.rotation_xyz(0.0, 0.0, block.yaw_rad)
    return mesh_primitives.transformed(mesh, turn, (block.x, block.y, 0.0))


def _sheet(bounds: Bounds, z: float, *, up: bool) -> Mesh:
    """Horizontal sheet over the bounds that its texture covers once; seen from above or below."""
    x0, y0, x1, y1 = bounds
    size = (x1 - x0, y1 - y0)
    along_x, along_y = (size[0], 0.0, 0.0), (0.0, size[1], 0.0)
    nx, ny = _cells(size[0]), _cells(size[1])
    if not up:
        return mesh_primitives.quad((x0, y0, z), along_y, along_x, ny, nx)
    mesh = mesh_primitives.quad((x0, y0, z), along_x, along_y, nx, ny)
    return mesh_primitives.covered_once(mesh, size)


def floor_picture(
    bounds: Bounds,
    rooms: Sequence[Room],
    styles: Sequence[RoomStyle],
    blocked: Sequence[Obstacle],
) -> NDArray[np.uint8]:
    """Image [h, w, 3] of the whole floor, darkened under furniture; row 0 at low y."""
    x0, y0, x1, y1 = bounds
    px_per_m = min(_PX_PER_M, _MOST_PX / max(x1 - x0, y1 - y0))
    width = max(4, round((x1 - x0) * px_per_m / 4) * 4)
    height = max(4, round((y1 - y0) * px_per_m / 4) * 4)
    scale = np.array([width / (x1 - x0), height / (y1 - y0)])
    image = np.full((height, width, 3), np.array(_BASE_RGB), dtype=np.float32)
    for room, style in zip(rooms, styles, strict=True):
        _lay(image, room, style, (x0, y0), scale)
    shade = np.zeros((height, width), dtype=np.float32)
    for rect in blocked:
        corners = cv2.boxPoints(
            ((rect.x, rect.y), (2 * rect.half_x, 2 * rect.half_y), math.degrees(rect.yaw_rad))
        )
        cv2.fillConvexPoly(shade, np.round((corners - [x0, y0]) * scale).astype(np.int32), 1.0)
    soft = cv2.GaussianBlur(shade, (0, 0), max(0.3, 0.12 * px_per_m))
    return np.clip(image * (1 - 0.4 * soft)[..., None] * 255, 0, 255).astype(np.uint8)


def _lay(
    image: NDArray[np.float32],
    room: Room,
    style: RoomStyle,
    origin: tuple[float, float],
    scale: NDArray[np.float64],
) -> None:
    """Draw the floor of a room into the image."""
    low = np.floor((np.array([room.x0, room.y0]) - origin) * scale).astype(int)
    high = np.ceil((np.array([room.x1, room.y1]) - origin) * scale).astype(int)
    low, high = np.maximum(low, 0), np.minimum(high, image.shape[1::-1])
    if (high - low < 2).any():
        return
    columns, rows = (high - low).tolist()
    rng = np.random.default_rng([12, room.index])
    px = float(scale[0])
    made = textures.floor(rng, style.floor_pattern, style.floor_rgb, (columns / px, rows / px), px)
    made = cv2.resize(made, (columns, rows), interpolation=cv2.INTER_AREA)
    mask = np.zeros((rows, columns), np.uint8)
    cv2.fillPoly(mask, [_pixels(room.outline, origin, scale, low)], 1)
    part = image[low[1] : high[1], low[0] : high[0]]
    part[mask == 1] = made[mask == 1]


def _pixels(
    outline: Outline,
    origin: tuple[float, float],
    scale: NDArray[np.float64],
    low: NDArray[np.int_],
) -> NDArray[np.int32]:
    return np.round((np.array(outline) - origin) * scale - low).astype(np.int32)


def frame_visuals(door: PlanDoor) -> tuple[Visual, ...]:
    """Door frame around an opening, in the world frame."""
    b = ShapeBuilder()
    cos, sin = math.cos(door.yaw_rad), math.sin(door.yaw_rad)
    half, height = door.width_m / 2, door.height_m
    deep = door.wall_m + 2 * _PROUD_M

    def part(u: float, z: float, size: tuple[float, float, float]) -> None:
        center = (door.x + cos * u, door.y + sin * u, z)
        b.box(center, size, wall_meshes.TRIM, tilt_rad=(0.0, 0.0, door.yaw_rad))

    for s in (-1, 1):
        part(s * (half + _FRAME_M / 2), height / 2, (_FRAME_M, deep, height))
        part(s * (half + 0.001), height / 2, (0.006, door.wall_m + 0.002, height))
    part(0.0, height + _FRAME_M / 2, (door.width_m + 2 * _FRAME_M, deep, _FRAME_M))
    return b.finish((1, 1, 1), wall_meshes.TRIM).visuals
