"""Shapes of furniture with doors and drawers. Origin on the floor at the centre, back at +y."""

import numpy as np

from helios_sim.home.color_palette import BLACK, STEEL, Palette, darker, tinted
from helios_sim.home.home_types import Material, Shape
from helios_sim.home.shape_builder import ShapeBuilder


def fronts(
    b: ShapeBuilder,
    x: tuple[float, float],
    z: tuple[float, float],
    y: float,
    columns: int,
    rows: int,
    front: Material,
    knob: Material,
    *,
    bar: bool,
) -> None:
    """Add a grid of drawer fronts or doors on the plane `y`, with knobs or bar handles."""
    width, height = (x[1] - x[0]) / columns, (z[1] - z[0]) / rows
    tall = height > width * 1.1
    for i in range(columns):
        for k in range(rows):
            cx, cz = x[0] + (i + 0.5) * width, z[0] + (k + 0.5) * height
            b.box((cx, y - 0.009, cz), (width - 0.012, 0.018, height - 0.012), front, bevel_m=0.005)
            side = (-1 if i % 2 else 1) * (width / 2 - 0.05) if tall else 0.0
            high = cz + (height * 0.28 if tall else 0.0)
            if bar:
                size = (0.014, 0.018, 0.14) if tall else (min(0.16, width * 0.4), 0.018, 0.014)
                b.box((cx + side, y - 0.028, high), size, knob)
            else:
                b.ellipsoid(
                    (cx + side, y - 0.03, high), (0.016, 0.016, 0.016), knob, sides=8, rings=6
                )


def nightstand(rng: np.random.Generator, palette: Palette) -> Shape:
    width, depth = float(rng.uniform(0.44, 0.52)), float(rng.uniform(0.38, 0.44))
    return _chest(
        rng, palette, width, depth, float(rng.uniform(0.5, 0.6)), 1, int(rng.integers(1, 3)), 0.12
    )


def dresser(rng: np.random.Generator, palette: Palette) -> Shape:
    width, depth = float(rng.uniform(0.95, 1.3)), float(rng.uniform(0.44, 0.5))
    return _chest(
        rng, palette, width, depth, float(rng.uniform(0.78, 0.92)), 2, int(rng.integers(3, 5)), 0.08
    )


def _chest(
    rng: np.random.Generator,
    palette: Palette,
    width: float,
    depth: float,
    height: float,
    columns: int,
    rows: int,
    foot: float,
) -> Shape:
    body = palette.wood_or_paint(rng)
    front = body if rng.random() < 0.6 else palette.paint(rng)
    knob = STEEL if rng.random() < 0.5 else BLACK
    b = ShapeBuilder()
    b.box((0, 0, height - 0.0125), (width, depth, 0.025), body, bevel_m=0.006)
    b.box(
        (0, 0.01, (foot + height - 0.025) / 2),
        (width - 0.02, depth - 0.03, height - 0.025 - foot),
        darker(body, 0.9),
    )
    fronts(
        b,
        (-width / 2 + 0.015, width / 2 - 0.015),
        (foot + 0.01, height - 0.03),
        -depth / 2 + 0.024,
        columns,
        rows,
        front,
        knob,
        bar=bool(rng.random() < 0.5),
    )
    for x in (-1, 1):
        for y in (-1, 1):
            b.box(
                (x * (width / 2 - 0.045), y * (depth / 2 - 0.045), foot / 2),
                (0.04, 0.04, foot),
                body,
            )
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    b.surface((0, 0), (width, depth), height)
    return b.finish((width, depth, height), body)


def tv_stand(rng: np.random.Generator, palette: Palette) -> Shape:
    width, depth = float(rng.uniform(1.3, 1.6)), float(rng.uniform(0.38, 0.44))
    height, foot = float(rng.uniform(0.45, 0.54)), 0.1
    body, front = palette.wood(rng), palette.wood_or_paint(rng)
    b = ShapeBuilder()
    for z in (height - 0.0125, foot + 0.0125):
        b.box((0, 0, z), (width, depth, 0.025), body, bevel_m=0.005)
    wing = width * 0.3
    for x in (-width / 2 + 0.0125, -width / 2 + wing, width / 2 - wing, width / 2 - 0.0125):
        b.box((x, 0, (foot + height) / 2), (0.025, depth - 0.01, height - foot - 0.03), body)
    b.box(
        (0, depth / 2 - 0.01, (foot + height) / 2),
        (width - 0.03, 0.012, height - foot - 0.03),
        darker(body, 0.7),
    )
    for s in (-1, 1):
        lo, hi = sorted((s * (width / 2 - 0.03), s * (width / 2 - wing)))
        fronts(
            b,
            (lo, hi),
            (foot + 0.03, height - 0.03),
            -depth / 2 + 0.02,
            1,
            1,
            front,
            STEEL,
            bar=False,
        )
    middle = (height + foot) / 2
    b.box((0, 0, middle), (width - 2 * wing, depth - 0.03, 0.018), body)
    b.box((0.02, -0.02, middle + 0.035), (0.3, 0.2, 0.05), BLACK, bevel_m=0.006)
    for x in (-1, 1):
        for y in (-1, 1):
            b.cylinder(
                (x * (width / 2 - 0.08), y * (depth / 2 - 0.06), foot / 2),
                0.016,
                foot,
                body,
                top_radius_m=0.022,
                sides=8,
            )
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    b.surface((0, 0), (width, depth), height)
    return b.finish((width, depth, height), body)


def bookcase(rng: np.random.Generator, palette: Palette) -> Shape:
    """Bookcase whose top is within reach and whose boards are full of books and baskets."""
    width, depth = float(rng.uniform(0.8, 1.05)), float(rng.uniform(0.3, 0.34))
    rows = int(rng.integers(2, 4))
    height = {2: float(rng.uniform(0.74, 0.84)), 3: float(rng.uniform(1.0, 1.1))}[rows]
    wood = palette.wood_or_paint(rng)
    b = ShapeBuilder()
    b.box((0, 0, height - 0.0125), (width, depth, 0.025), wood, bevel_m=0.005)
    for x in (-1, 1):
        b.box(
            (x * (width / 2 - 0.0125), 0, height / 2 - 0.0125), (0.025, depth, height - 0.025), wood
        )
    b.box(
        (0, depth / 2 - 0.006, height / 2), (width - 0.03, 0.012, height - 0.04), darker(wood, 0.75)
    )
    b.box((0, -depth / 2 + 0.03, 0.03), (width - 0.05, 0.02, 0.06), wood)
    cell = (height - 0.085) / rows
    for k in range(rows):
        floor_z = 0.06 + k * cell
        b.box((0, 0, floor_z + 0.009), (width - 0.05, depth - 0.02, 0.018), wood)
        half = (width - 0.07) / 2
        shelf_goods(b, rng, palette, (-half, half), depth, floor_z + 0.018, cell - 0.05)
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    b.surface((0, 0), (width, depth), height)
    return b.finish((width, depth, height), wood)


def shelf_goods(
    b: ShapeBuilder,
    rng: np.random.Generator,
    palette: Palette,
    span_x: tuple[float, float],
    depth: float,
    z: float,
    room: float,
) -> None:
    """Add books and baskets on a shelf board at height z, with `room` above it; visuals only."""
    x, end = span_x
    colors = [
        Material(tinted((0.62, 0.34, 0.28), rng, 0.2), "", 0.08),
        Material(tinted((0.30, 0.38, 0.48), rng, 0.2), "", 0.08),
        Material(tinted((0.76, 0.70, 0.58), rng, 0.15), "", 0.08),
        Material(tinted((0.36, 0.46, 0.36), rng, 0.2), "", 0.08),
    ]
    while x < end - 0.05:
        if rng.random() < 0.18 and end - x > 0.26:
            b.box(
                (x + 0.12, -0.01, z + 0.09),
                (0.22, depth - 0.08, 0.18),
                palette.accent(rng),
                bevel_m=0.015,
            )
            x += 0.26
        elif rng.random() < 0.15:
            x += float(rng.uniform(0.04, 0.14))
        else:
            thick = float(rng.uniform(0.02, 0.045))
            tall = float(rng.uniform(0.62, 0.95)) * room
            deep = float(rng.uniform(0.15, 0.2))
            book = colors[int(rng.integers(len(colors)))]
            b.box(
                (x + thick / 2, -depth / 2 + 0.03 + deep / 2, z + tall / 2),
                (thick - 0.002, deep, tall),
                book,
            )
            x += thick
