"""Shapes of sofa, armchair, bed, bench, chair. Origin on the floor at the centre, back at +y."""

from collections.abc import Callable

import numpy as np

from helios_sim.home.color_palette import LINEN, Palette, darker
from helios_sim.home.home_types import Material, Shape, Vec3
from helios_sim.home.shape_builder import ShapeBuilder

Maker = Callable[[np.random.Generator, Palette], Shape]


def _padded_seat(
    rng: np.random.Generator, palette: Palette, width: float, seats: int, cushions: int
) -> Shape:
    cloth, legs = palette.fabric(rng), palette.wood(rng)
    depth = float(rng.uniform(0.84, 0.92))
    seat, back_height = float(rng.uniform(0.42, 0.46)), float(rng.uniform(0.78, 0.88))
    arm, arm_height = float(rng.uniform(0.14, 0.18)), float(rng.uniform(0.56, 0.62))
    back = 0.2
    b = ShapeBuilder()
    inner, seat_depth = width - 2 * arm, depth - back
    base_top = seat - 0.14
    seam = darker(cloth, 0.92)
    b.box(
        (0, 0, (0.1 + base_top) / 2),
        (width - 0.04, depth - 0.04, base_top - 0.1),
        seam,
        bevel_m=0.02,
    )
    for x in (-1, 1):
        b.box(
            (x * (width - arm) / 2, 0, (0.1 + arm_height) / 2),
            (arm, depth, arm_height - 0.1),
            cloth,
            bevel_m=0.06,
            segments=2,
        )
        b.solid("box", (x * (width - arm) / 2, 0, arm_height / 2), (arm, depth, arm_height))
    b.box(
        (0, (depth - back) / 2, (0.1 + back_height) / 2),
        (inner + 0.04, back - 0.04, back_height - 0.1),
        seam,
        bevel_m=0.06,
        segments=2,
    )
    b.solid("box", (0, (depth - back) / 2, back_height / 2), (width, back, back_height))
    b.solid("box", (0, -back / 2, seat / 2), (inner, seat_depth, seat))
    one = inner / seats
    for k in range(seats):
        x = -inner / 2 + (k + 0.5) * one
        b.box(
            (x, -back / 2, seat - 0.08),
            (one - 0.008, seat_depth + 0.02, 0.16),
            cloth,
            bevel_m=0.04,
            segments=2,
        )
        b.box(
            (x, depth / 2 - back + 0.015, seat + (back_height - seat) * 0.48),
            (one - 0.02, 0.11, (back_height - seat) * 0.92),
            cloth,
            bevel_m=0.045,
            segments=2,
            tilt_rad=(-0.1, 0, 0),
        )
    _cushions(b, rng, palette, cushions, inner, depth / 2 - back, seat)
    _legs(b, width - 0.14, depth - 0.14, 0.1, 0.022, legs)
    used = 0.4 if cushions else 0.0
    lo, hi = -inner / 2 + used, inner / 2 - (used if cushions > 1 else 0.0)
    b.surface(((lo + hi) / 2, -back / 2 - 0.03), (hi - lo - 0.02, seat_depth - 0.10), seat)
    return b.finish((width, depth, back_height), cloth)


def _cushions(
    b: ShapeBuilder,
    rng: np.random.Generator,
    palette: Palette,
    cushions: int,
    inner: float,
    back_y: float,
    seat: float,
) -> None:
    """Add cushions that lean against the back, the first one at -x."""
    for k in range(cushions):
        side = -1 if k == 0 else 1
        x = side * (inner / 2 - 0.19)
        b.box(
            (x, back_y - 0.09, seat + 0.19),
            (0.36, 0.12, 0.36),
            palette.accent(rng),
            bevel_m=0.055,
            segments=2,
            tilt_rad=(-0.28, 0, side * 0.06),
        )
        b.solid(
            "box",
            (x, back_y - 0.06, seat + 0.16),
            (0.36, 0.18, 0.32),
        )


def sofa(rng: np.random.Generator, palette: Palette) -> Shape:
    seats = int(rng.integers(2, 4))
    width = 0.36 + seats * float(rng.uniform(0.58, 0.64)) + (0.2 if seats == 2 else 0.0)
    return _padded_seat(rng, palette, width, seats, int(rng.integers(1, 3)) if seats == 3 else 1)


def armchair(rng: np.random.Generator, palette: Palette) -> Shape:
    return _padded_seat(rng, palette, float(rng.uniform(0.84, 0.94)), 1, 0)


def bed(rng: np.random.Generator, palette: Palette) -> Shape:
    width = float(rng.choice([1.0, 1.4, 1.6])) + float(rng.uniform(-0.04, 0.04))
    length, top = float(rng.uniform(2.0, 2.1)), float(rng.uniform(0.48, 0.54))
    frame, cover = palette.wood(rng), palette.accent(rng)
    head = float(rng.uniform(0.95, 1.1))
    b = ShapeBuilder()
    b.box((0, 0, 0.22), (width, length, 0.16), frame, bevel_m=0.015)
    b.box((0, length / 2 - 0.03, head / 2), (width + 0.04, 0.06, head), frame, bevel_m=0.02)
    panel = palette.fabric(rng)
    b.box((0, length / 2 - 0.075, head - 0.25), (width - 0.06, 0.05, 0.4), panel, bevel_m=0.02)
    b.solid("box", (0, length / 2 - 0.05, head / 2), (width + 0.04, 0.10, head))
    b.box(
        (0, -0.03, (0.3 + top - 0.02) / 2),
        (width - 0.04, length - 0.12, top - 0.32),
        LINEN,
        bevel_m=0.05,
        segments=2,
    )
    pillows = 1 if width < 1.2 else 2
    end = length / 2 - 0.1
    one = (width - 0.1) / pillows
    for k in range(pillows):
        x = -(width - 0.1) / 2 + (k + 0.5) * one
        b.box(
            (x, end - 0.22, top + 0.045),
            (one - 0.05, 0.4, 0.13),
            LINEN,
            bevel_m=0.06,
            segments=2,
            tilt_rad=(0.12, 0, 0),
        )
    b.solid("box", (0, end - 0.22, top + 0.04), (width - 0.1, 0.42, 0.13))
    cover_end = end - 0.52
    front = -length / 2 + 0.02
    b.box(
        (0, (cover_end + front) / 2, (0.27 + top) / 2),
        (width + 0.02, cover_end - front, top - 0.27),
        cover,
        bevel_m=0.05,
        segments=2,
    )
    b.box(
        (0, cover_end + 0.02, top - 0.02),
        (width + 0.015, 0.26, 0.06),
        LINEN,
        bevel_m=0.025,
        segments=2,
    )
    b.solid("box", (0, -0.02, top / 2), (width, length - 0.04, top))
    _legs(b, width - 0.1, length - 0.1, 0.15, 0.03, frame)
    b.surface((0, (cover_end - 0.12 + front) / 2), (width - 0.1, cover_end - 0.14 - front), top)
    return b.finish((width + 0.04, length, head), cover)


def bench(rng: np.random.Generator, palette: Palette) -> Shape:
    width, depth = float(rng.uniform(1.0, 1.2)), float(rng.uniform(0.36, 0.42))
    height = float(rng.uniform(0.43, 0.48))
    wood = palette.wood(rng)
    b = ShapeBuilder()
    if rng.random() < 0.5:
        b.box((0, 0, height - 0.09), (width, depth, 0.05), wood, bevel_m=0.01)
        b.box(
            (0, 0, height - 0.035),
            (width - 0.02, depth - 0.02, 0.07),
            palette.fabric(rng),
            bevel_m=0.025,
            segments=2,
        )
    else:
        b.box((0, 0, height - 0.0225), (width, depth, 0.045), wood, bevel_m=0.01)
        b.box((0, 0, 0.14), (width - 0.1, depth - 0.08, 0.025), wood, bevel_m=0.006)
    for x in (-1, 1):
        b.box(
            (x * (width / 2 - 0.05), 0, (height - 0.1) / 2),
            (0.05, depth - 0.04, height - 0.1),
            wood,
            bevel_m=0.008,
        )
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    b.surface((0, 0), (width, depth), height)
    return b.finish((width, depth, height), wood)


def chair(rng: np.random.Generator, palette: Palette) -> Shape:
    width, depth, seat = 0.43, 0.46, 0.45
    back = float(rng.uniform(0.84, 0.92))
    wood = palette.wood_or_paint(rng)
    b = ShapeBuilder()
    b.box((0, -0.01, seat - 0.02), (width, depth - 0.02, 0.04), wood, bevel_m=0.012)
    if rng.random() < 0.6:
        b.box(
            (0, -0.02, seat + 0.015),
            (width - 0.04, depth - 0.08, 0.04),
            palette.fabric(rng),
            bevel_m=0.015,
        )
    for x in (-1, 1):
        b.box(
            (x * (width / 2 - 0.025), -depth / 2 + 0.035, seat / 2 - 0.02),
            (0.035, 0.035, seat - 0.04),
            wood,
        )
        b.box((x * (width / 2 - 0.025), depth / 2 - 0.03, back / 2), (0.035, 0.035, back), wood)
        b.box((x * (width / 2 - 0.025), 0, 0.2), (0.02, depth - 0.06, 0.02), wood)
    slats = int(rng.integers(2, 4))
    for k in range(slats):
        z = back - 0.05 - k * 0.13
        b.box((0, depth / 2 - 0.03, z), (width - 0.08, 0.02, 0.07), wood, bevel_m=0.006)
    b.solid("box", (0, 0, seat / 2), (width, depth, seat))
    b.solid("box", (0, depth / 2 - 0.03, back / 2), (width, 0.05, back))
    return b.finish((width, depth, back), wood)


def _legs(
    b: ShapeBuilder, width: float, depth: float, height: float, radius: float, material: Material
) -> None:
    for x in (-1, 1):
        for y in (-1, 1):
            center: Vec3 = (x * width / 2, y * depth / 2, height / 2)
            b.cylinder(center, radius * 0.75, height, material, top_radius_m=radius, sides=8)
