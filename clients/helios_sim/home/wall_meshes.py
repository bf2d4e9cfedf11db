"""Visual meshes of a home's structure: floors with soft shadows, painted walls, door frames."""

import math
from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_sim.home import floor_plans, mesh_primitives, textures
from helios_sim.home.freespace import Obstacle
from helios_sim.home.home_types import Doorway, Material, Mesh, Room, RoomStyle, Visual
from helios_sim.home.shape_builder import ShapeBuilder

TRIM = Material((0.95, 0.95, 0.93), "", 0.15, 0.3)
CAP = Material((0.30, 0.31, 0.33), "", 0.0, 0.0)
CEILING = Material((0.96, 0.96, 0.95), "", 0.0, 0.0, 0.12)

_FLOOR_PX_PER_M = 96
_WALL_CELL_M = 0.65
_BOARD_M = 0.09


def inner(room: Room) -> floor_plans.Rect:
    """Rectangle of the room between the faces of its walls."""
    t = floor_plans.WALL_HALF_M
    return room.x0 + t, room.y0 + t, room.x1 - t, room.y1 - t


def floor_mesh(room: Room) -> Mesh:
    """Floor mesh, which its texture covers once."""
    x0, y0, x1, y1 = inner(room)
    cells = (math.ceil((x1 - x0) / _WALL_CELL_M), math.ceil((y1 - y0) / _WALL_CELL_M))
    mesh = mesh_primitives.quad((x0, y0, 0), (x1 - x0, 0, 0), (0, y1 - y0, 0), *cells)
    return Mesh(
        mesh.vertices,
        mesh.normals,
        mesh.uv / np.array([x1 - x0, y1 - y0], dtype=np.float32),
        mesh.faces,
    )


def floor_texture(
    rng: np.random.Generator, room: Room, style: RoomStyle, blocked: Iterable[Obstacle]
) -> NDArray[np.uint8]:
    """Floor image [h, w, 3], darkened along walls and under furniture; row 0 at low y."""
    x0, y0, x1, y1 = inner(room)
    size = (x1 - x0, y1 - y0)
    image = textures.floor(rng, style.floor_pattern, style.floor_rgb, size, _FLOOR_PX_PER_M)
    height, width = image.shape[:2]
    shade = np.zeros((height, width), dtype=np.float32)
    for rect in blocked:
        corners = cv2.boxPoints(
            ((rect.x, rect.y), (2 * rect.half_x, 2 * rect.half_y), math.degrees(rect.yaw_rad))
        )
        pixels = np.round((corners - [x0, y0]) * [width / size[0], height / size[1]])
        cv2.fillConvexPoly(shade, pixels.astype(np.int32), 1.0)
    wide = cv2.GaussianBlur(shade, (0, 0), 0.16 * _FLOOR_PX_PER_M)
    tight = cv2.GaussianBlur(shade, (0, 0), 0.05 * _FLOOR_PX_PER_M)
    y, x = np.mgrid[0:height, 0:width] / _FLOOR_PX_PER_M
    edge = np.minimum(np.minimum(x, size[0] - x), np.minimum(y, size[1] - y))
    light = (1 - 0.32 * wide - 0.22 * tight) * (1 - 0.2 * np.exp(-edge / 0.16))
    shaded = image * light[..., None] * 255
    # Multiples of four pixels keep every row aligned for OpenGL.
    shaded = cv2.resize(shaded, (width // 4 * 4, height // 4 * 4), interpolation=cv2.INTER_AREA)
    return np.clip(shaded, 0, 255).astype(np.uint8)


def ceiling_mesh(room: Room) -> Mesh:
    """Ceiling mesh, visible only from below."""
    x0, y0, x1, y1 = inner(room)
    return mesh_primitives.quad(
        (x0, y0, floor_plans.WALL_HEIGHT_M), (0, y1 - y0, 0), (x1 - x0, 0, 0), 3, 3
    )


def wall_visuals(room: Room, doorways: tuple[Doorway, ...], style: RoomStyle) -> list[Visual]:
    """Painted wall faces of a room, with openings, and skirting boards."""
    paint = Material(style.wall_rgb, "plaster", 0.02, 0.1)
    own = tuple(door for door in doorways if room.index in door.rooms)
    visuals = []
    for side in range(4):
        faces = [
            _wall_face(room, side, lo, hi, z0, z1)
            for lo, hi, z0, z1 in _face_pieces(room, own, side)
        ]
        visuals.append(Visual(mesh_primitives.merge(faces), paint))
        boards = [
            _board(room, side, lo, hi)
            for lo, hi, z0, _ in _face_pieces(room, own, side)
            if z0 == 0.0
        ]
        visuals.append(Visual(mesh_primitives.merge(boards), TRIM))
    return visuals


def _face_pieces(
    room: Room, doorways: tuple[Doorway, ...], side: int
) -> list[tuple[float, float, float, float]]:
    """Parts (lo, hi, z0, z1) of a wall face, beside and above the doorways."""
    axis = 0 if side < 2 else 1
    at = (room.x0, room.x1, room.y0, room.y1)[side]
    x0, y0, x1, y1 = inner(room)
    lo, hi = (y0, y1) if axis == 0 else (x0, x1)
    pieces, cursor = [], lo
    for door0, door1 in floor_plans.openings(doorways, axis, at, lo, hi):
        pieces.append((cursor, door0, 0.0, floor_plans.WALL_HEIGHT_M))
        pieces.append((door0, door1, floor_plans.DOOR_HEIGHT_M, floor_plans.WALL_HEIGHT_M))
        cursor = door1
    pieces.append((cursor, hi, 0.0, floor_plans.WALL_HEIGHT_M))
    return [piece for piece in pieces if piece[1] - piece[0] > 1e-6]


def _wall_face(room: Room, side: int, lo: float, hi: float, z0: float, z1: float) -> Mesh:
    x0, y0, x1, y1 = inner(room)
    along, up = hi - lo, (0.0, 0.0, z1 - z0)
    # Each face is visible from inside the room: edge_u x up points inwards.
    corner, edge = {
        0: ((x0, lo, z0), (0.0, along, 0.0)),
        1: ((x1, hi, z0), (0.0, -along, 0.0)),
        2: ((hi, y0, z0), (-along, 0.0, 0.0)),
        3: ((lo, y1, z0), (along, 0.0, 0.0)),
    }[side]
    cells = max(1, math.ceil(along / _WALL_CELL_M)), max(1, math.ceil((z1 - z0) / _WALL_CELL_M))
    mesh = mesh_primitives.quad(corner, edge, up, *cells)
    if mesh.normals[0] @ _inwards(side) < 0:
        mesh = Mesh(mesh.vertices, -mesh.normals, mesh.uv, mesh.faces[:, ::-1].copy())
    uv = mesh.uv + np.array([0.0, z0], dtype=np.float32)
    return Mesh(mesh.vertices, mesh.normals, uv, mesh.faces)


def _inwards(side: int) -> NDArray[np.float64]:
    return np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)][side], dtype=np.float64)


def _board(room: Room, side: int, lo: float, hi: float) -> Mesh:
    x0, y0, x1, y1 = inner(room)
    thick = 0.014
    middle = (lo + hi) / 2
    center, size = {
        0: ((x0 + thick / 2, middle), (thick, hi - lo)),
        1: ((x1 - thick / 2, middle), (thick, hi - lo)),
        2: ((middle, y0 + thick / 2), (hi - lo, thick)),
        3: ((middle, y1 - thick / 2), (hi - lo, thick)),
    }[side]
    box = mesh_primitives.box((*size, _BOARD_M))
    return mesh_primitives.transformed(box, np.eye(3), (*center, _BOARD_M / 2))


def doorway_visuals(door: Doorway, threshold: Material) -> tuple[Visual, ...]:
    """Door frame on both faces of the wall, lining and threshold, in the world frame."""
    b = ShapeBuilder()
    wall, height, half = 2 * floor_plans.WALL_HALF_M, floor_plans.DOOR_HEIGHT_M, door.width_m / 2
    turn = 0.0 if door.axis == 1 else math.pi / 2
    cos, sin = math.cos(turn), math.sin(turn)

    def part(u: float, z: float, size: tuple[float, float, float], material: Material) -> None:
        center = (door.x + cos * u, door.y + sin * u, z)
        b.box(center, size, material, tilt_rad=(0.0, 0.0, turn))

    frame = 0.07
    for s in (-1, 1):
        part(s * (half + frame / 2), height / 2, (frame, wall + 0.03, height), TRIM)
        part(s * (half + 0.001), height / 2, (0.006, wall + 0.002, height), TRIM)
    part(0.0, height + frame / 2, (door.width_m + 2 * frame, wall + 0.03, frame), TRIM)
    part(0.0, -0.002, (door.width_m, wall, 0.006), threshold)
    return b.finish((1, 1, 1), TRIM).visuals


def wall_caps(pieces: Sequence[floor_plans.WallPiece]) -> Visual:
    """Top faces of the walls, visible when the ceiling is hidden."""
    caps = []
    for piece in pieces:
        half = piece.half_extent_xy
        box = mesh_primitives.box((2 * half[0], 2 * half[1], 0.02))
        caps.append(
            mesh_primitives.transformed(box, np.eye(3), (*piece.center_xy, piece.z1_m + 0.011))
        )
    return Visual(mesh_primitives.merge(caps), CAP)
