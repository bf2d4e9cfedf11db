"""Shapes of dining table, coffee table, side table and desk. Origin on the floor, back at +y."""

import numpy as np

from helios_sim.home.color_palette import BLACK, STEEL, Palette, darker
from helios_sim.home.home_types import Material, Shape
from helios_sim.home.shape_builder import ShapeBuilder


def dining_table(rng: np.random.Generator, palette: Palette) -> Shape:
    height = float(rng.uniform(0.72, 0.76))
    if rng.random() < 0.35:
        return _round_table(rng, palette, float(rng.uniform(0.46, 0.52)), height)
    return _leg_table(
        palette.wood(rng),
        float(rng.uniform(1.2, 1.5)),
        float(rng.uniform(0.74, 0.84)),
        height,
        leg=0.065,
        apron=0.09,
    )


def coffee_table(rng: np.random.Generator, palette: Palette) -> Shape:
    height = float(rng.uniform(0.40, 0.46))
    style = rng.random()
    if style < 0.25:
        return _round_table(rng, palette, float(rng.uniform(0.34, 0.40)), height)
    wood = palette.wood(rng)
    return _leg_table(
        wood,
        float(rng.uniform(0.9, 1.1)),
        float(rng.uniform(0.5, 0.6)),
        height,
        leg=0.05,
        apron=0.05,
        shelf=style < 0.65,
        legs=BLACK if style > 0.85 else wood,
    )


def side_table(rng: np.random.Generator, palette: Palette) -> Shape:
    return _round_table(
        rng, palette, float(rng.uniform(0.21, 0.25)), float(rng.uniform(0.52, 0.62))
    )


def desk(rng: np.random.Generator, palette: Palette) -> Shape:
    width, depth = float(rng.uniform(1.15, 1.4)), float(rng.uniform(0.6, 0.68))
    height = float(rng.uniform(0.72, 0.76))
    wood, front = palette.wood(rng), palette.wood_or_paint(rng)
    b = ShapeBuilder()
    b.box((0, 0, height - 0.0175), (width, depth, 0.035), wood, bevel_m=0.006)
    b.solid("box", (0, 0, height - 0.0175), (width, depth, 0.035))
    side = 1 if rng.random() < 0.5 else -1
    unit = 0.38
    x = side * (width / 2 - unit / 2 - 0.02)
    b.box((x, 0.01, (height - 0.035) / 2), (unit, depth - 0.06, height - 0.035), wood, solid=True)
    rows = 3
    drawer = (height - 0.1) / rows
    for k in range(rows):
        z = 0.05 + (k + 0.5) * drawer
        b.box((x, -depth / 2 + 0.03, z), (unit - 0.02, 0.025, drawer - 0.012), front, bevel_m=0.005)
        b.box((x, -depth / 2 + 0.01, z), (0.12, 0.014, 0.014), STEEL)
    for y in (-1, 1):
        b.box(
            (-side * (width / 2 - 0.04), y * (depth / 2 - 0.05), (height - 0.035) / 2),
            (0.045, 0.045, height - 0.035),
            wood,
            solid=True,
        )
    b.box(
        (-side * unit / 2, depth / 2 - 0.06, height - 0.2), (width - unit - 0.06, 0.018, 0.3), wood
    )
    b.surface((0, 0), (width, depth), height)
    return b.finish((width, depth, height), wood)


def _leg_table(
    top: Material,
    width: float,
    depth: float,
    height: float,
    *,
    leg: float,
    apron: float,
    shelf: bool = False,
    legs: Material | None = None,
) -> Shape:
    legs = legs or top
    b = ShapeBuilder()
    b.box((0, 0, height - 0.018), (width, depth, 0.036), top, bevel_m=0.008)
    b.solid("box", (0, 0, height - 0.018), (width, depth, 0.036))
    dx, dy = width / 2 - leg / 2 - 0.03, depth / 2 - leg / 2 - 0.03
    z = height - 0.036 - apron / 2
    shade = darker(legs, 0.93)
    for s in (-1, 1):
        b.box((0, s * dy, z), (2 * dx, 0.022, apron), shade)
        b.box((s * dx, 0, z), (0.022, 2 * dy, apron), shade)
        for t in (-1, 1):
            b.box(
                (s * dx, t * dy, (height - 0.036) / 2),
                (leg, leg, height - 0.036),
                legs,
                bevel_m=0.005,
                solid=True,
            )
    if shelf:
        b.box((0, 0, 0.14), (2 * dx, 2 * dy, 0.02), top, bevel_m=0.004)
    b.surface((0, 0), (width, depth), height)
    return b.finish((width, depth, height), top)


def _round_table(rng: np.random.Generator, palette: Palette, radius: float, height: float) -> Shape:
    wood = palette.wood_or_paint(rng)
    b = ShapeBuilder()
    b.cylinder((0, 0, height - 0.016), radius, 0.032, wood, bevel_m=0.008, sides=32)
    b.solid("cylinder", (0, 0, height - 0.016), (2 * radius, 2 * radius, 0.032))
    if rng.random() < 0.5:
        b.lathe(
            [
                (0, 0),
                (radius * 0.6, 0),
                (radius * 0.6, 0.015),
                (0.06, 0.05),
                (0.035, 0.16),
                (0.035, height - 0.12),
                (0.10, height - 0.03),
                (0, height - 0.03),
            ],
            (0, 0, 0),
            wood,
            sides=24,
        )
        b.solid("cylinder", (0, 0, height / 2 - 0.02), (0.12, 0.12, height - 0.04))
    else:
        for k in range(3):
            a = np.pi / 2 + k * 2 * np.pi / 3
            foot, cap = radius * 0.85, radius * 0.5
            path = [
                (foot * np.cos(a), foot * np.sin(a), 0.0),
                ((foot + cap) / 2 * np.cos(a), (foot + cap) / 2 * np.sin(a), height / 2),
                (cap * np.cos(a), cap * np.sin(a), height - 0.03),
            ]
            b.tube([(float(x), float(y), float(z)) for x, y, z in path], 0.018, wood)
        b.solid("cylinder", (0, 0, height / 2 - 0.02), (radius, radius, height - 0.04))
    # A square within the circle keeps objects on the round top.
    side = radius * 1.5
    b.surface((0, 0), (side, side), height)
    return b.finish((2 * radius, 2 * radius, height), wood)
