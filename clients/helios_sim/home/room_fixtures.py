"""Shapes of ceiling lamp, towel rail, coat rack, wall clock and cooker.

Origin below the centre, wall at +y.
"""

import math

import numpy as np

from helios_sim.home.color_palette import BLACK, STEEL, WHITE, Palette, darker
from helios_sim.home.home_types import Material, Shape
from helios_sim.home.shape_builder import ShapeBuilder

_GLOW = Material((1.0, 0.96, 0.88), "", 0.0, 0.0, 0.7)


def ceiling_lamp(rng: np.random.Generator, palette: Palette) -> Shape:
    """Ceiling lamp; z = 0 of its frame is the lower rim of its shade."""
    drop = float(rng.uniform(0.3, 0.45))
    shade = darker(palette.accent(rng), 0.9) if rng.random() < 0.5 else WHITE
    b = ShapeBuilder()
    if rng.random() < 0.5:
        r = float(rng.uniform(0.16, 0.24))
        profile = [(r, 0), (r * 0.3, 0.14), (r * 0.28, 0.14), (r * 0.96, 0.0)]
        b.lathe(profile, (0, 0, 0), shade, sides=20)
        b.ellipsoid((0, 0, 0.04), (0.045, 0.045, 0.05), _GLOW, sides=10, rings=6)
    else:
        r = float(rng.uniform(0.12, 0.18))
        b.ellipsoid((0, 0, r), (r, r, r), _GLOW, sides=16, rings=10)
    b.cylinder((0, 0, 0.1 + drop / 2), 0.006, drop, BLACK, sides=6)
    b.cylinder((0, 0, drop + 0.09), 0.05, 0.03, WHITE, sides=12)
    return b.finish((2 * r, 2 * r, drop + 0.1), shade)


def towel_rail(rng: np.random.Generator, palette: Palette) -> Shape:
    """Bar with two towels."""
    width = float(rng.uniform(0.55, 0.7))
    b = ShapeBuilder()
    z = 0.6
    b.box((0, -0.05, z), (width, 0.016, 0.016), STEEL)
    for s in (-1, 1):
        b.box((s * width / 2, -0.02, z), (0.02, 0.08, 0.02), STEEL)
    for s in (-1, 1):
        cloth = palette.accent(rng)
        long = float(rng.uniform(0.36, 0.55))
        x = s * width * 0.24
        b.box((x, -0.066, z - long / 2 + 0.01), (width * 0.38, 0.012, long), cloth, bevel_m=0.004)
        b.box((x, -0.032, z - long * 0.42), (width * 0.38, 0.01, long * 0.84), cloth)
        b.box((x, -0.05, z + 0.012), (width * 0.38, 0.045, 0.012), cloth, bevel_m=0.004)
    return b.finish((width, 0.1, 0.65), STEEL)


def coat_rack(rng: np.random.Generator, palette: Palette) -> Shape:
    """Board with hooks and up to four coats."""
    width = float(rng.uniform(0.7, 0.95))
    wood = palette.wood(rng)
    b = ShapeBuilder()
    z = 0.85
    b.box((0, -0.012, z), (width, 0.024, 0.1), wood, bevel_m=0.005)
    hooks = 4
    for k in range(hooks):
        x = -width / 2 + (k + 0.5) * width / hooks
        b.box((x, -0.045, z), (0.014, 0.05, 0.014), BLACK)
        b.box((x, -0.066, z + 0.016), (0.014, 0.012, 0.04), BLACK)
        if rng.random() < 0.5:
            cloth = palette.fabric(rng) if rng.random() < 0.6 else palette.accent(rng)
            long = float(rng.uniform(0.5, 0.8))
            b.box((x, -0.075, z - long / 2), (0.26, 0.09, long), cloth, bevel_m=0.04, segments=2)
            for s in (-1, 1):
                sleeve = (x + s * 0.15, -0.07, z - 0.3)
                b.box(sleeve, (0.08, 0.08, 0.5), darker(cloth, 0.92), bevel_m=0.03)
    return b.finish((width + 0.2, 0.16, 0.92), wood)


def wall_clock(rng: np.random.Generator, palette: Palette) -> Shape:
    r = float(rng.uniform(0.13, 0.18))
    rim = palette.wood(rng) if rng.random() < 0.5 else BLACK
    turned = (math.pi / 2, 0.0, 0.0)
    b = ShapeBuilder()
    b.cylinder((0, 0, r), r, 0.03, rim, bevel_m=0.006, sides=24, tilt_rad=turned)
    b.cylinder((0, -0.014, r), r * 0.88, 0.008, WHITE, sides=24, tilt_rad=turned)
    for k in range(12):
        a = k * math.pi / 6
        mark = (0.74 * r * math.sin(a), -0.0195, r + 0.74 * r * math.cos(a))
        b.box(mark, (0.008, 0.003, 0.024), BLACK, tilt_rad=(0, a, 0))
    for size, turn in ((r * 0.5, 1.1), (r * 0.7, -0.6)):
        hand = (math.sin(turn) * size / 2, -0.02, r + math.cos(turn) * size / 2)
        b.box(hand, (0.01, 0.003, size), BLACK, tilt_rad=(0, turn, 0))
    return b.finish((2 * r, 0.03, 2 * r), rim)


def cooker(rng: np.random.Generator, palette: Palette) -> Shape:
    """Free-standing oven with a hob."""
    width, depth, height = 0.6, 0.61, 0.9
    coat = WHITE if rng.random() < 0.5 else STEEL
    b = ShapeBuilder()
    b.box((0, 0.01, height / 2), (width, depth - 0.02, height), coat, bevel_m=0.006)
    glass = Material((0.08, 0.08, 0.09), "", 0.8, 0.8)
    b.box((0, 0, height + 0.003), (width - 0.02, depth - 0.05, 0.008), glass)
    ring = Material((0.28, 0.28, 0.29), "", 0.2)
    for x, y, r in ((-0.14, -0.13, 0.09), (0.14, -0.13, 0.075), (-0.14, 0.13, 0.075)):
        b.cylinder((x, y, height + 0.008), r, 0.003, ring, sides=20)
    b.cylinder((0.14, 0.13, height + 0.008), 0.09, 0.003, ring, sides=20)
    front = -depth / 2 + 0.005
    b.box((0, front, 0.45), (width - 0.03, 0.02, 0.5), darker(coat, 0.92), bevel_m=0.004)
    b.box((0, front - 0.008, 0.47), (width - 0.14, 0.012, 0.3), glass)
    b.box((0, front - 0.03, 0.68), (width - 0.1, 0.02, 0.018), darker(STEEL, 0.8))
    turned = (math.pi / 2, 0.0, 0.0)
    for k in range(5):
        knob = (-0.2 + 0.1 * k, front - 0.008, 0.79)
        b.cylinder(knob, 0.022, 0.03, BLACK, sides=12, tilt_rad=turned)
    b.box((0, depth / 2 - 0.012, height + 0.04), (width, 0.02, 0.08), coat)
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    del palette
    return b.finish((width, depth, height), coat)
