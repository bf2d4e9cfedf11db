"""Shapes of kitchen counter and washstand. Origin on the floor at the centre, back at +y."""

import numpy as np

from helios_sim.home.cabinet_shapes import fronts
from helios_sim.home.color_palette import BLACK, STEEL, WHITE, Palette, darker, tinted
from helios_sim.home.home_types import Material, Shape
from helios_sim.home.shape_builder import ShapeBuilder


def kitchen_counter(rng: np.random.Generator, palette: Palette) -> Shape:
    width, depth = float(rng.uniform(1.8, 2.3)), 0.62
    height = float(rng.uniform(0.88, 0.92))
    front, top = palette.wood_or_paint(rng), palette.paint(rng)
    stone = Material(
        tinted((0.80, 0.79, 0.76) if top.rgb[0] > 0.6 else (0.45, 0.45, 0.46), rng),
        "speckle",
        0.3,
        0.5,
    )
    b = ShapeBuilder()
    b.box((0, 0, height - 0.02), (width, depth, 0.04), stone, bevel_m=0.008)
    b.box(
        (0, 0.02, (0.1 + height - 0.04) / 2),
        (width - 0.01, depth - 0.05, height - 0.14),
        darker(front, 0.85),
    )
    b.box((0, 0.05, 0.05), (width - 0.02, depth - 0.12, 0.1), BLACK)
    columns = round(width / 0.5)
    fronts(
        b,
        (-width / 2 + 0.005, width / 2 - 0.005),
        (0.11, height - 0.23),
        -depth / 2 + 0.014,
        columns,
        1,
        front,
        STEEL,
        bar=True,
    )
    fronts(
        b,
        (-width / 2 + 0.005, width / 2 - 0.005),
        (height - 0.22, height - 0.05),
        -depth / 2 + 0.014,
        columns,
        1,
        front,
        STEEL,
        bar=True,
    )
    b.box((0, depth / 2 - 0.006, height + 0.27), (width, 0.012, 0.54), WHITE)
    side = 1 if rng.random() < 0.5 else -1
    sink_x = side * (width / 2 - 0.38)
    _sink(b, sink_x, height)
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    b.solid("box", (sink_x, 0.25, height + 0.12), (0.04, 0.04, 0.24))
    length = width - 0.68
    b.surface((-side * (width - length) / 2, 0), (length, depth), height)
    return b.finish((width, depth, height), front)


def _sink(b: ShapeBuilder, x: float, height: float) -> None:
    """Add a basin in the counter top and its tap."""
    basin = darker(STEEL, 0.62)
    b.box((x, -0.01, height + 0.002), (0.52, 0.42, 0.012), STEEL, bevel_m=0.005)
    b.box((x, -0.01, height + 0.005), (0.44, 0.34, 0.012), basin, bevel_m=0.005)
    b.tube(
        [
            (x, 0.25, height),
            (x, 0.25, height + 0.2),
            (x, 0.21, height + 0.26),
            (x, 0.13, height + 0.27),
            (x, 0.09, height + 0.22),
        ],
        0.012,
        STEEL,
    )


def washstand(rng: np.random.Generator, palette: Palette) -> Shape:
    width, depth = float(rng.uniform(0.95, 1.15)), float(rng.uniform(0.46, 0.5))
    height, foot = float(rng.uniform(0.80, 0.86)), 0.16
    front = palette.wood_or_paint(rng)
    b = ShapeBuilder()
    b.box((0, 0, height - 0.02), (width, depth, 0.04), WHITE, bevel_m=0.01)
    b.box(
        (0, 0.01, (foot + height - 0.04) / 2),
        (width - 0.02, depth - 0.04, height - 0.04 - foot),
        darker(front, 0.88),
    )
    fronts(
        b,
        (-width / 2 + 0.02, width / 2 - 0.02),
        (foot, height - 0.05),
        -depth / 2 + 0.022,
        2,
        1,
        front,
        STEEL,
        bar=True,
    )
    side = 1 if rng.random() < 0.5 else -1
    x, r = side * (width / 2 - 0.24), 0.19
    _bowl(b, x, r, height)
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    b.solid("cylinder", (x, -0.01, height + 0.055), (2 * r, 2 * r, 0.11))
    for s in (-1, 1):
        for t in (-1, 1):
            b.box(
                (s * (width / 2 - 0.04), t * (depth / 2 - 0.05), foot / 2),
                (0.04, 0.04, foot),
                front,
            )
    length = width - 0.46
    b.surface((-side * (width - length) / 2, 0), (length, depth), height)
    return b.finish((width, depth, height), front)


def _bowl(b: ShapeBuilder, x: float, r: float, height: float) -> None:
    """Add a bowl of radius r on the top and its tap."""
    b.lathe(
        [
            (0, 0),
            (r * 0.6, 0),
            (r * 0.95, 0.06),
            (r, 0.11),
            (r - 0.012, 0.11),
            (r * 0.85, 0.06),
            (r * 0.5, 0.015),
            (0, 0.012),
        ],
        (x, -0.01, height),
        WHITE,
        sides=24,
    )
    b.tube(
        [
            (x, 0.19, height),
            (x, 0.19, height + 0.19),
            (x, 0.15, height + 0.21),
            (x, 0.09, height + 0.19),
        ],
        0.011,
        STEEL,
    )
