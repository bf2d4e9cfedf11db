"""Data types of a home: immutable, in metres and radians, z up, floor at 0.

A `Shape` is geometry in a body's own frame: drawn meshes (`visuals`), collision primitives
(`collision_primitives`) and support surfaces (`surfaces`). A furniture frame has its origin on the
floor at the centre of the footprint, with the back (towards the wall) at +y. An object frame has
its origin at the centre of the bounding box.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Rgb = tuple[float, float, float]
Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]  # w, x, y, z
SolidKind = Literal["box", "cylinder", "sphere", "ellipsoid"]


@dataclass(frozen=True)
class Picture:
    """Texture image that covers one unit of uv. Pictures with the same name are equal."""

    name: str
    pixels: NDArray[np.uint8] = field(repr=False, compare=False)  # [h, w, 3], row 0 at v = 0


@dataclass(frozen=True)
class Material:
    """Appearance of a surface. `texture` names a pattern of `textures.PATTERNS`, tinted by `rgb`.

    `picture` replaces it where a surface has its own image.
    """

    rgb: Rgb
    texture: str = ""
    specular: float = 0.15
    shininess: float = 0.2
    emission: float = 0.0
    picture: Picture | None = None


@dataclass(frozen=True)
class Mesh:
    """Triangle mesh with one normal and one texture coordinate per vertex."""

    vertices: NDArray[np.float32]  # [n, 3] m
    normals: NDArray[np.float32]  # [n, 3] unit
    uv: NDArray[np.float32]  # [n, 2] in repeats of the texture
    faces: NDArray[np.int32]  # [m, 3] counter-clockwise, seen from outside


@dataclass(frozen=True)
class Visual:
    """Drawn mesh of one material."""

    mesh: Mesh
    material: Material


@dataclass(frozen=True)
class CollisionPrimitive:
    """Collision primitive; `half_extent`: half sizes, or (radius, half height) of a cylinder."""

    kind: SolidKind
    half_extent: Vec3
    center: Vec3
    quat: Quat = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Surface:
    """Flat rectangle on which objects can stand, `height_m` above the floor of the frame.

    `clear_m` is the headroom: up to the next shelf board, otherwise practically unlimited.
    """

    center_xy: tuple[float, float]
    half_extent_xy: tuple[float, float]
    yaw_rad: float
    height_m: float
    clear_m: float = 10.0


@dataclass(frozen=True, eq=False)
class Shape:
    """Geometry in the body's own frame. `size_m` is the bounding box (x, y, z)."""

    size_m: Vec3
    visuals: tuple[Visual, ...]
    collision_primitives: tuple[CollisionPrimitive, ...]
    color: Rgb
    surfaces: tuple[Surface, ...] = ()
    mass_kg: float = 0.0
    rolls: bool = False


Outline = tuple[tuple[float, float], ...]  # corners (x, y) of a polygon, m


@dataclass(frozen=True)
class Room:
    """Room with the bounding box (x0, y0, x1, y1); `kind` is for example "kitchen".

    A generated room fills its box, which the wall axes bound. A room of a drawn plan has an
    `outline` within its box.
    """

    index: int
    kind: str
    x0: float
    y0: float
    x1: float
    y1: float
    outline: Outline = field(default=(), repr=False)

    @property
    def center_xy(self) -> tuple[float, float]:
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2

    @property
    def area_m2(self) -> float:
        if self.outline:
            x, y = np.array(self.outline).T
            return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) / 2
        return (self.x1 - self.x0) * (self.y1 - self.y0)

    def contains(self, x: float, y: float) -> bool:
        in_box = self.x0 <= x < self.x1 and self.y0 <= y < self.y1
        return in_box and (not self.outline or bool(in_polygon(self.outline, x, y)))


def in_polygon(
    outline: Outline, x: float | NDArray[np.float64], y: float | NDArray[np.float64]
) -> NDArray[np.bool_]:
    """True for each point inside the polygon (even-odd rule); x and y broadcast."""
    px, py = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    inside = np.zeros(np.broadcast_shapes(px.shape, py.shape), dtype=bool)
    for (ax, ay), (bx, by) in zip(outline, (*outline[1:], outline[0]), strict=True):
        if ay != by:
            crosses = (ay > py) != (by > py)
            inside ^= crosses & (px < ax + (py - ay) * (bx - ax) / (by - ay))
    return inside


@dataclass(frozen=True)
class Doorway:
    """Opening centred at (x, y). `axis` 0: in a wall of constant x; 1: of constant y."""

    x: float
    y: float
    width_m: float
    axis: int
    rooms: tuple[int, int]


@dataclass(frozen=True)
class Receptacle:
    """Furniture on which objects stand. `surfaces` are in the world frame."""

    name: str
    class_name: str
    room: int
    x: float
    y: float
    yaw_rad: float
    size_m: Vec3
    surfaces: tuple[Surface, ...]
    color: Rgb
    shape: Shape = field(repr=False, compare=False)


@dataclass(frozen=True)
class Fixture:
    """Furniture or decoration that is no receptacle, such as a plant, a fridge or a picture.

    `blocks` is True if it blocks a robot; `z_m` is the height of the floor of its frame.
    """

    name: str
    class_name: str
    room: int
    x: float
    y: float
    yaw_rad: float
    size_m: Vec3
    blocks: bool
    color: Rgb
    shape: Shape = field(repr=False, compare=False)
    z_m: float = 0.0


@dataclass(frozen=True)
class SceneObject:
    """Movable object, upright at rest; `position_m` is the centre of its box."""

    name: str
    class_name: str
    receptacle: str
    position_m: Vec3
    yaw_rad: float
    size_m: Vec3
    color: Rgb
    shape: Shape = field(repr=False, compare=False)


@dataclass(frozen=True)
class Episode:
    """One task, such as "Move the mug from the coffee table to the kitchen counter"."""

    object_class: str
    start_receptacle_class: str
    goal_receptacle_class: str
    instruction: str
    absent: bool = False  # True if the home has no object of the class


@dataclass(frozen=True)
class RoomStyle:
    """Wall colour and floor of a room."""

    wall_rgb: Rgb
    floor_pattern: str
    floor_rgb: Rgb
