"""A drawn plan: one level of a home, in metres and radians, in the frame of a generated home.

x points right, y up on the page, z up; the floor of the level is at 0. Sweet Home 3D draws y
downwards and counts angles clockwise; `plan_reader` converts both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from helios_sim.home.home_types import Outline, Rgb, Vec3

Xy = tuple[float, float]
OpeningKind = Literal["door", "window"]


@dataclass(frozen=True)
class Wall:
    """Wall from start to end. `arc_rad`: angle of its arc, seen on the page; 0: straight.

    `left_rgb` is the colour of the face on the left, seen from start to end.
    """

    start: Xy
    end: Xy
    thickness_m: float
    height_m: float
    end_height_m: float
    arc_rad: float = 0.0
    left_rgb: Rgb | None = None
    right_rgb: Rgb | None = None


@dataclass(frozen=True)
class DrawnRoom:
    """Room with its outline; `name` as its author wrote it, perhaps empty."""

    name: str
    outline: Outline
    floor_rgb: Rgb | None = None


@dataclass(frozen=True)
class Opening:
    """Door or window; its frame has x along the wall. `z_m`: height of its lower edge.

    `hinge`: -1 at the low end of x, 1 at the high end, 0 unknown; `swing`: -1 towards -y, 1 towards
    +y, 0 unknown.
    """

    name: str
    kind: OpeningKind
    x: float
    y: float
    yaw_rad: float
    width_m: float
    depth_m: float
    height_m: float
    z_m: float
    hinge: int = 0
    swing: int = 0


@dataclass(frozen=True, eq=False)
class Piece:
    """Piece of furniture in the furniture frame: origin below its centre, back at +y.

    `size_m` is (width, depth, height); `z_m` the height of its lower face above the floor.
    `model` names an entry of the archive; `rotation` [3, 3] turns its axes to x right, y up,
    z front.
    """

    name: str
    catalog_id: str
    x: float
    y: float
    z_m: float
    yaw_rad: float
    size_m: Vec3
    model: str
    rotation: NDArray[np.float64]
    rgb: Rgb | None = None
    stairs: bool = False


@dataclass(frozen=True)
class Plan:
    """One level of a home. `left_out`: a sentence for each part of the file that is not used."""

    file_name: str
    sha256: str
    level: str  # name; empty if the home has one level without a name
    other_levels: tuple[str, ...]
    walls: tuple[Wall, ...]
    rooms: tuple[DrawnRoom, ...]
    openings: tuple[Opening, ...]
    pieces: tuple[Piece, ...]
    left_out: tuple[str, ...]
