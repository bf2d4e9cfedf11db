"""Open door leaves, hinged beside the opening and turned into one of the rooms."""

import math
from collections.abc import Iterator

import numpy as np

from helios_sim.home import floor_plans
from helios_sim.home.color_palette import STEEL, Palette, darker
from helios_sim.home.home_types import Doorway, Room, Shape
from helios_sim.home.shape_builder import ShapeBuilder
from helios_sim.home.wall_placement import Pose

THICK_M = 0.04
_BESIDE_M = 0.045  # from the edge of the opening to the hinge
_BEFORE_M = 0.045  # from the wall face to the hinge
_NARROWER_M = 0.02


def door_leaf(rng: np.random.Generator, palette: Palette, width_m: float = 0.9) -> Shape:
    """Door leaf for an opening of that width; its origin is below its centre."""
    width, height = width_m - _NARROWER_M, floor_plans.DOOR_HEIGHT_M - 0.02
    coat = palette.paint(rng) if rng.random() < 0.6 else palette.wood(rng)
    b = ShapeBuilder()
    b.box((0, 0, height / 2 + 0.01), (width, THICK_M - 0.008, height), coat)
    panel = darker(coat, 0.9)
    rows = ((0.52, 0.62), (1.42, 0.86)) if rng.random() < 0.6 else ((1.05, 1.6),)
    for z, tall in rows:
        b.box((0, 0, z), (width * 0.62, THICK_M - 0.002, tall), panel, bevel_m=0.003)
    for s in (-1, 1):
        b.cylinder(
            (width / 2 - 0.07, s * 0.032, 1.02), 0.01, 0.05, STEEL, sides=8, tilt_rad=(1.5708, 0, 0)
        )
        b.box((width / 2 - 0.115, s * 0.055, 1.02), (0.11, 0.014, 0.018), STEEL, bevel_m=0.004)
    b.solid("box", (0, 0, height / 2 + 0.01), (width, THICK_M, height))
    return b.finish((width, THICK_M, height), coat)


def open_poses(
    rng: np.random.Generator, door: Doorway, rooms: tuple[Room, ...], width_m: float
) -> Iterator[tuple[Room, Pose]]:
    """Open poses of a leaf of that width: (room into which it opens, pose).

    Wide open leaves stand along the wall; the others reach into the room beside the opening. The
    hinge is outside the opening, so that the doorway keeps its width.
    """
    ways = [(s, t, wide) for wide in (True, False) for s in (-1, 1) for t in (-1, 1)]
    weights = rng.random(len(ways))
    order = sorted(range(len(ways)), key=lambda k: weights[k] - 0.5 * ways[k][2])
    for k in order:
        s, t, wide = ways[k]
        angle = math.radians(float(rng.uniform(158, 172) if wide else rng.uniform(92, 112)))
        along = s * (door.width_m / 2 + _BESIDE_M)
        across = t * (floor_plans.WALL_HALF_M + _BEFORE_M)
        # In the frame of the wall: u along the wall, v across it.
        du, dv = -s * math.cos(angle), t * math.sin(angle)
        half = width_m / 2
        u, v = along + du * half, across + dv * half
        if door.axis == 1:
            x, y, yaw = door.x + u, door.y + v, math.atan2(dv, du)
        else:
            x, y, yaw = door.x + v, door.y + u, math.atan2(du, dv)
        room = next((r for r in rooms if r.contains(x, y) and r.index in door.rooms), None)
        if room is not None:
            yield room, (x, y, yaw)
