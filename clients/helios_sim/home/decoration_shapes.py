"""Shapes of furniture and decoration without surfaces. Origin below the centre, back at +y."""

import numpy as np

from helios_sim.home import mesh_primitives
from helios_sim.home.cabinet_shapes import fronts
from helios_sim.home.color_palette import BLACK, LINEN, STEEL, WHITE, Palette, darker, tinted
from helios_sim.home.home_types import Material, Shape
from helios_sim.home.shape_builder import ShapeBuilder

_GLOW = Material((1.0, 0.95, 0.84), "", 0.0, 0.0, 0.75)


def plant(rng: np.random.Generator, palette: Palette) -> Shape:
    height, pot = float(rng.uniform(0.8, 1.2)), float(rng.uniform(0.13, 0.16))
    clay = Material(tinted((0.72, 0.50, 0.38), rng, 0.15), "ceramic", 0.2)
    leaf = Material(tinted((0.24, 0.46, 0.22), rng, 0.07), "foliage", 0.15)
    stem = Material((0.38, 0.30, 0.20), "wood")
    b = ShapeBuilder()
    b.lathe(
        [
            (0, 0),
            (pot * 0.75, 0),
            (pot, 0.28),
            (pot + 0.015, 0.28),
            (pot + 0.015, 0.31),
            (pot - 0.01, 0.31),
            (pot - 0.015, 0.27),
            (0, 0.27),
        ],
        (0, 0, 0),
        clay,
    )
    b.cylinder((0, 0, height * 0.3 + 0.12), 0.012, height * 0.6 - 0.2, stem, sides=8)
    count = 16
    for k in range(count):
        turn = k * 2.4 + float(rng.uniform(-0.2, 0.2))
        z = 0.36 + (height - 0.42) * (k / count) ** 0.8
        reach = float(rng.uniform(0.13, 0.19)) * (1.15 - 0.5 * k / count)
        b.ellipsoid(
            (0.6 * reach * np.cos(turn), 0.6 * reach * np.sin(turn), z + 0.03),
            (reach * 0.62, reach * 0.36, 0.008),
            leaf,
            sides=8,
            rings=6,
            tilt_rad=(0.0, float(rng.uniform(-0.7, -0.25)), turn),
        )
    b.solid("cylinder", (0, 0, 0.155), (2 * pot, 2 * pot, 0.31))
    b.solid("cylinder", (0, 0, height / 2 + 0.15), (0.1, 0.1, height - 0.3))
    del palette
    return b.finish((0.48, 0.48, height), leaf)


def floor_lamp(rng: np.random.Generator, palette: Palette) -> Shape:
    height = float(rng.uniform(1.45, 1.65))
    metal = STEEL if rng.random() < 0.5 else BLACK
    b = ShapeBuilder()
    b.cylinder((0, 0, 0.0125), 0.14, 0.025, metal, bevel_m=0.006, sides=20)
    b.cylinder((0, 0, height / 2), 0.011, height - 0.2, metal, sides=8)
    b.lathe(
        [(0.19, height - 0.28), (0.12, height), (0.115, height), (0.185, height - 0.28)],
        (0, 0, 0),
        _GLOW,
        sides=20,
    )
    b.solid("cylinder", (0, 0, 0.0125), (0.28, 0.28, 0.025))
    b.solid("cylinder", (0, 0, height / 2), (0.05, 0.05, height))
    b.solid("cylinder", (0, 0, height - 0.14), (0.36, 0.36, 0.28))
    del palette
    return b.finish((0.38, 0.38, height), metal)


def wardrobe(rng: np.random.Generator, palette: Palette) -> Shape:
    width, depth, height = float(rng.uniform(1.0, 1.5)), 0.58, float(rng.uniform(1.95, 2.15))
    body = palette.wood_or_paint(rng)
    b = ShapeBuilder()
    b.box((0, 0.01, height / 2), (width, depth - 0.02, height), darker(body, 0.93), bevel_m=0.008)
    fronts(
        b,
        (-width / 2 + 0.01, width / 2 - 0.01),
        (0.08, height - 0.03),
        -depth / 2 + 0.02,
        round(width / 0.5),
        1,
        body,
        STEEL,
        bar=True,
    )
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    return b.finish((width, depth, height), body)


def fridge(rng: np.random.Generator, palette: Palette) -> Shape:
    width, depth, height = 0.62, 0.64, float(rng.uniform(1.7, 1.9))
    coat = STEEL if rng.random() < 0.5 else WHITE
    b = ShapeBuilder()
    b.box((0, 0.02, height / 2), (width, depth - 0.04, height), darker(coat, 0.85), bevel_m=0.01)
    split = height * 0.38
    for lo, hi, grip in ((0.05, split, split - 0.2), (split, height - 0.01, split + 0.24)):
        b.box(
            (0, -depth / 2 + 0.03, (lo + hi) / 2),
            (width - 0.01, 0.05, hi - lo - 0.01),
            coat,
            bevel_m=0.014,
        )
        b.box(
            (-width / 2 + 0.06, -depth / 2 - 0.01, grip),
            (0.022, 0.03, 0.32),
            darker(STEEL, 0.8),
            bevel_m=0.006,
        )
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    del palette
    return b.finish((width, depth + 0.03, height), coat)


def wall_cabinet(rng: np.random.Generator, palette: Palette, width: float = 1.6) -> Shape:
    depth, height = 0.33, 0.62
    front = palette.wood_or_paint(rng)
    b = ShapeBuilder()
    b.box((0, 0.01, height / 2), (width, depth - 0.02, height), darker(front, 0.9))
    fronts(
        b,
        (-width / 2, width / 2),
        (0, height),
        -depth / 2 + 0.02,
        max(2, round(width / 0.45)),
        1,
        front,
        STEEL,
        bar=True,
    )
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    return b.finish((width, depth, height), front)


def television(rng: np.random.Generator, palette: Palette) -> Shape:
    width = float(rng.uniform(1.0, 1.25))
    height = width * 0.57
    b = ShapeBuilder()
    b.box((0, 0, height / 2), (width, 0.05, height), BLACK, bevel_m=0.008)
    glow = Material((0.10, 0.13, 0.18), "screen", 0.7, 0.8)
    b.box((0, -0.024, height / 2), (width - 0.03, 0.006, height - 0.03), glow)
    b.solid("box", (0, 0, height / 2), (width, 0.05, height))
    del palette
    return b.finish((width, 0.06, height), BLACK)


def picture(rng: np.random.Generator, palette: Palette) -> Shape:
    width, height = float(rng.uniform(0.45, 0.9)), float(rng.uniform(0.4, 0.65))
    frame = palette.wood(rng) if rng.random() < 0.6 else BLACK
    art = Material((1, 1, 1), f"art{int(rng.integers(6))}", 0.05)
    b = ShapeBuilder()
    b.box((0, 0, height / 2), (width, 0.03, height), frame, bevel_m=0.006)
    b.box((0, -0.014, height / 2), (width - 0.05, 0.006, height - 0.05), LINEN)
    w, h = width - 0.13, height - 0.13
    panel = mesh_primitives.quad((-w / 2, -0.018, height / 2 - h / 2), (w, 0, 0), (0, 0, h))
    b.mesh(
        mesh_primitives.covered_once(panel, (w, h)),
        art,
    )
    return b.finish((width, 0.04, height), frame)


def mirror(rng: np.random.Generator, palette: Palette) -> Shape:
    width, height = float(rng.uniform(0.6, 0.8)), 0.8
    b = ShapeBuilder()
    b.box((0, 0, height / 2), (width, 0.025, height), palette.wood(rng), bevel_m=0.006)
    b.box(
        (0, -0.012, height / 2),
        (width - 0.05, 0.006, height - 0.05),
        Material((0.74, 0.82, 0.85), "", 0.8, 0.8, 0.15),
    )
    return b.finish((width, 0.03, height), WHITE)


def window(rng: np.random.Generator, palette: Palette) -> Shape:
    width, height = float(rng.uniform(1.1, 1.5)), float(rng.uniform(1.1, 1.25))
    frame = Material((0.96, 0.96, 0.94), "", 0.2, 0.3)
    sky = Material((1, 1, 1), "sky", 0.0, 0.0, 0.55)
    b = ShapeBuilder()
    panel = mesh_primitives.quad((-width / 2, -0.012, 0), (width, 0, 0), (0, 0, height))
    b.mesh(
        mesh_primitives.covered_once(panel, (width, height)),
        sky,
    )
    for x in (-width / 2, 0.0, width / 2):
        b.box((x, -0.02, height / 2), (0.05, 0.05, height), frame)
    for z in (0.0, height * 0.62, height):
        b.box((0, -0.02, z), (width + 0.05, 0.05, 0.05), frame)
    b.box((0, -0.06, -0.04), (width + 0.02, 0.14, 0.03), frame, bevel_m=0.006)
    cloth = Material(
        tinted(palette.fabric(rng).rgb, rng), "stripes" if rng.random() < 0.3 else "fabric", 0.02
    )
    b.tube(
        [
            (-width / 2 - 0.3, -0.1, height + 0.12),
            (0, -0.1, height + 0.12),
            (width / 2 + 0.3, -0.1, height + 0.12),
        ],
        0.012,
        STEEL,
    )
    for side in (-1, 1):
        folds = 5
        for k in range(folds):
            x = side * (width / 2 + 0.02 + 0.05 * k)
            b.cylinder(
                (x, -0.09 - 0.012 * (k % 2), height / 2 - 0.07),
                0.034,
                height + 0.36,
                cloth,
                sides=8,
            )
    return b.finish((width + 0.6, 0.15, height), frame)


def rug(
    rng: np.random.Generator, palette: Palette, size: tuple[float, float] = (2.0, 1.4)
) -> Shape:
    base = palette.accent(rng).rgb if rng.random() < 0.5 else palette.fabric(rng).rgb
    cloth = Material(base, "rug", 0.0, 0.0)
    b = ShapeBuilder()
    b.box((0, 0, 0.004), (size[0], size[1], 0.008), cloth)
    edge = darker(cloth, 0.7)
    for s in (-1, 1):
        b.box((s * size[0] / 2, 0, 0.005), (0.08, size[1] + 0.08, 0.01), edge)
        b.box((0, s * size[1] / 2, 0.005), (size[0] + 0.08, 0.08, 0.01), edge)
    return b.finish((size[0], size[1], 0.01), cloth)


def toilet(rng: np.random.Generator, palette: Palette) -> Shape:
    b = ShapeBuilder()
    b.box((0, 0.25, 0.62), (0.38, 0.16, 0.36), WHITE, bevel_m=0.03, segments=2)
    b.cylinder((0, -0.08, 0.19), 0.13, 0.38, WHITE, top_radius_m=0.17, sides=20)
    b.box((0, 0.14, 0.2), (0.22, 0.3, 0.4), WHITE, bevel_m=0.03)
    b.ellipsoid((0, -0.09, 0.41), (0.19, 0.25, 0.035), WHITE, sides=20)
    b.cylinder((0, 0.25, 0.805), 0.02, 0.012, STEEL, sides=10)
    b.solid("box", (0, -0.03, 0.21), (0.36, 0.56, 0.42))
    b.solid("box", (0, 0.25, 0.4), (0.38, 0.16, 0.8))
    del rng, palette
    return b.finish((0.4, 0.68, 0.81), WHITE)


def bathtub(rng: np.random.Generator, palette: Palette) -> Shape:
    width, depth, height = float(rng.uniform(1.5, 1.65)), 0.72, 0.56
    b = ShapeBuilder()
    wall = 0.07
    for s in (-1, 1):
        b.box(
            (0, s * (depth - wall) / 2, height / 2),
            (width, wall, height),
            WHITE,
            bevel_m=0.025,
            segments=2,
        )
        b.box(
            (s * (width - wall) / 2, 0, height / 2),
            (wall, depth, height),
            WHITE,
            bevel_m=0.025,
            segments=2,
        )
    b.box((0, 0, 0.1), (width - 0.1, depth - 0.1, 0.1), darker(WHITE, 0.93))
    b.tube(
        [
            (-width / 2 + 0.04, 0, height),
            (-width / 2 + 0.04, 0, height + 0.14),
            (-width / 2 + 0.1, 0, height + 0.17),
            (-width / 2 + 0.17, 0, height + 0.13),
        ],
        0.014,
        STEEL,
    )
    b.solid("box", (0, 0, 0.08), (width, depth, 0.16))
    for s in (-1, 1):
        b.solid("box", (0, s * (depth - wall) / 2, height / 2), (width, wall, height))
        b.solid("box", (s * (width - wall) / 2, 0, height / 2), (wall, depth, height))
    del palette
    return b.finish((width, depth, height), WHITE)
