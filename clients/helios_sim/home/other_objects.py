"""Objects: book, box, toys, lamp, alarm clock, remote control, pot plant."""

import math

import numpy as np

from helios_sim.home.color_palette import BLACK, LINEN, STEEL, Palette, darker, tinted
from helios_sim.home.home_types import Material, Rgb, Shape
from helios_sim.home.shape_builder import ShapeBuilder, lowered

_BRIGHT: tuple[Rgb, ...] = (
    (0.80, 0.22, 0.20),
    (0.18, 0.40, 0.70),
    (0.95, 0.76, 0.20),
    (0.22, 0.58, 0.36),
    (0.60, 0.30, 0.60),
    (0.95, 0.52, 0.16),
)


def _bright(rng: np.random.Generator, texture: str = "") -> Material:
    return Material(tinted(_BRIGHT[int(rng.integers(len(_BRIGHT)))], rng), texture, 0.25, 0.4)


def ball(rng: np.random.Generator, palette: Palette) -> Shape:
    r = float(rng.uniform(0.05, 0.065))
    skin = _bright(rng)
    band = Material((0.95, 0.95, 0.93), "", 0.3, 0.4)
    b = ShapeBuilder()
    b.ellipsoid((0, 0, 0), (r, r, r), skin, sides=20, rings=12)
    for tilt in (0.0, math.pi / 2):
        s = 0.18
        edge = [(r * 1.004 * math.cos(a), r * 1.004 * math.sin(a)) for a in np.linspace(-s, s, 5)]
        b.lathe(edge, (0, 0, 0), band, sides=24, tilt_rad=(tilt, 0, 0))
    b.solid("sphere", (0, 0, 0), (2 * r, 2 * r, 2 * r))
    del palette
    return b.finish((2 * r, 2 * r, 2 * r), skin, mass_kg=0.15, rolls=True)


def book(rng: np.random.Generator, palette: Palette) -> Shape:
    w, d, h = (
        float(rng.uniform(0.14, 0.17)),
        float(rng.uniform(0.20, 0.235)),
        float(rng.uniform(0.03, 0.042)),
    )
    cover = _bright(rng) if rng.random() < 0.6 else darker(_bright(rng), 0.6)
    b = ShapeBuilder()
    for z in (0.002, h - 0.002):
        b.box((0, 0, z), (w, d, 0.004), cover)
    b.box((-w / 2 + 0.002, 0, h / 2), (0.004, d, h), cover)
    b.box((0.0, 0, h / 2), (w - 0.012, d - 0.012, h - 0.008), LINEN)
    title = Material((0.95, 0.90, 0.70), "", 0.1)
    b.box((0.005, d * 0.2, h + 0.0004), (w * 0.6, d * 0.14, 0.0008), title)
    b.box((0.005, -d * 0.22, h + 0.0004), (w * 0.36, d * 0.05, 0.0008), title)
    b.solid("box", (0, 0, h / 2), (w, d, h))
    del palette
    return lowered(b.finish((w, d, h), cover, mass_kg=0.4), h / 2)


def box(rng: np.random.Generator, palette: Palette) -> Shape:
    w, d, h = (
        float(rng.uniform(0.12, 0.18)),
        float(rng.uniform(0.10, 0.15)),
        float(rng.uniform(0.08, 0.14)),
    )
    card = (
        Material(tinted((0.72, 0.55, 0.36), rng, 0.05), "wood", 0.03)
        if rng.random() < 0.55
        else _bright(rng, "ceramic")
    )
    tape = darker(card, 0.75)
    b = ShapeBuilder()
    b.box((0, 0, h / 2), (w, d, h), card, bevel_m=0.002)
    b.box((0, 0, h / 2), (w * 0.16, d + 0.0015, h + 0.0015), tape)
    b.box((w * 0.28, -d / 2 - 0.0006, h * 0.6), (w * 0.28, 0.001, h * 0.36), LINEN)
    b.solid("box", (0, 0, h / 2), (w, d, h))
    del palette
    return lowered(b.finish((w, d, h), card, mass_kg=0.4), h / 2)


def teddy_bear(rng: np.random.Generator, palette: Palette) -> Shape:
    h = float(rng.uniform(0.2, 0.24))
    coats: tuple[Rgb, ...] = (
        (0.60, 0.40, 0.22),
        (0.82, 0.68, 0.48),
        (0.45, 0.32, 0.24),
        (0.85, 0.6, 0.62),
    )
    fur = Material(tinted(coats[int(rng.integers(4))], rng, 0.04), "fur", 0.02, 0.02)
    pale = Material(tinted((0.92, 0.84, 0.70), rng, 0.03), "fur", 0.02, 0.02)
    s = h / 0.22
    b = ShapeBuilder()
    b.ellipsoid((0, 0, 0.066 * s), (0.052 * s, 0.046 * s, 0.066 * s), fur)
    b.ellipsoid((0, -0.014 * s, 0.062 * s), (0.034 * s, 0.036 * s, 0.044 * s), pale)
    b.ellipsoid((0, -0.005 * s, 0.160 * s), (0.048 * s, 0.044 * s, 0.043 * s), fur)
    b.ellipsoid(
        (0, -0.043 * s, 0.150 * s), (0.021 * s, 0.018 * s, 0.016 * s), pale, sides=10, rings=6
    )
    b.ellipsoid(
        (0, -0.060 * s, 0.155 * s), (0.007 * s, 0.006 * s, 0.005 * s), BLACK, sides=8, rings=6
    )
    for x in (-1, 1):
        b.ellipsoid(
            (x * 0.017 * s, -0.043 * s, 0.172 * s),
            (0.005 * s, 0.004 * s, 0.006 * s),
            BLACK,
            sides=8,
            rings=6,
        )
        b.ellipsoid(
            (x * 0.037 * s, 0, 0.201 * s), (0.018 * s, 0.010 * s, 0.018 * s), fur, sides=10, rings=6
        )
        b.ellipsoid(
            (x * 0.058 * s, -0.014 * s, 0.092 * s),
            (0.017 * s, 0.02 * s, 0.042 * s),
            fur,
            sides=10,
            rings=6,
            tilt_rad=(0.4, x * 0.5, 0),
        )
        b.ellipsoid(
            (x * 0.04 * s, -0.056 * s, 0.024 * s),
            (0.022 * s, 0.046 * s, 0.024 * s),
            fur,
            sides=10,
            rings=6,
        )
        b.ellipsoid(
            (x * 0.04 * s, -0.098 * s, 0.026 * s),
            (0.016 * s, 0.006 * s, 0.018 * s),
            pale,
            sides=10,
            rings=6,
        )
    b.solid("box", (0, -0.028 * s, 0.05 * s), (0.12 * s, 0.146 * s, 0.1 * s))
    b.solid("sphere", (0, -0.005 * s, 0.160 * s), (0.09 * s, 0.09 * s, 0.09 * s))
    del palette
    return lowered(b.finish((0.15 * s, 0.2 * s, h), fur, mass_kg=0.25), h / 2)


def toy_car(rng: np.random.Generator, palette: Palette) -> Shape:
    length, width, h = float(rng.uniform(0.15, 0.19)), 0.08, 0.07
    paint = _bright(rng)
    b = ShapeBuilder()
    b.box((0, 0, 0.03), (length, width - 0.012, 0.026), paint, bevel_m=0.009, segments=2)
    b.box((-0.008, 0, 0.054), (length * 0.52, width - 0.02, 0.03), paint, bevel_m=0.01, segments=2)
    glass = Material((0.55, 0.70, 0.78), "", 0.7, 0.7)
    b.box((-0.008, 0, 0.053), (length * 0.535, width - 0.034, 0.016), glass, bevel_m=0.004)
    b.box((-0.008, 0, 0.053), (length * 0.38, width - 0.017, 0.016), glass, bevel_m=0.004)
    for x in (-1, 1):
        for y in (-1, 1):
            b.cylinder(
                (x * length * 0.31, y * (width / 2 - 0.008), 0.0165),
                0.0165,
                0.016,
                BLACK,
                sides=14,
                tilt_rad=(math.pi / 2, 0, 0),
            )
            b.cylinder(
                (x * length * 0.31, y * (width / 2 - 0.007), 0.0165),
                0.008,
                0.016,
                STEEL,
                sides=10,
                tilt_rad=(math.pi / 2, 0, 0),
            )
        b.ellipsoid(
            (length / 2 - 0.004, x * 0.022, 0.032),
            (0.005, 0.008, 0.006),
            Material((1, 0.95, 0.7), "", 0.5, 0.5, 0.3),
            sides=8,
            rings=6,
        )
    b.solid("box", (0, 0, 0.022), (length, width, 0.044))
    b.solid("box", (-0.008, 0, 0.057), (length * 0.52, width - 0.02, 0.026))
    del palette
    return lowered(b.finish((length, width, h), paint, mass_kg=0.2), h / 2)


def lamp(rng: np.random.Generator, palette: Palette) -> Shape:
    h, r = float(rng.uniform(0.22, 0.25)), float(rng.uniform(0.06, 0.07))
    base = _bright(rng, "ceramic")
    shade = Material(tinted((0.98, 0.92, 0.78), rng, 0.02), "", 0.0, 0.0, 0.6)
    b = ShapeBuilder()
    b.lathe(
        [
            (0, 0),
            (r * 0.8, 0),
            (r * 0.8, 0.012),
            (r * 0.4, 0.03),
            (r * 0.55, h * 0.26),
            (r * 0.2, h * 0.44),
            (0.006, h * 0.5),
            (0.006, h * 0.9),
            (0, h * 0.9),
        ],
        (0, 0, 0),
        base,
    )
    b.lathe(
        [(r, h * 0.52), (r * 0.68, h), (r * 0.66, h), (r * 0.97, h * 0.52)],
        (0, 0, 0),
        shade,
        sides=22,
    )
    b.solid("cylinder", (0, 0, 0.008), (1.6 * r, 1.6 * r, 0.016))
    b.solid("cylinder", (0, 0, h * 0.26), (1.1 * r, 1.1 * r, h * 0.52))
    b.solid("cylinder", (0, 0, h * 0.76), (2 * r, 2 * r, h * 0.48))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), shade, mass_kg=0.5), h / 2)


def alarm_clock(rng: np.random.Generator, palette: Palette) -> Shape:
    r = float(rng.uniform(0.045, 0.052))
    rim = _bright(rng)
    h, depth = 2 * r + 0.045, 0.05
    z = r + 0.012
    quarter = (math.pi / 2, 0.0, 0.0)
    b = ShapeBuilder()
    b.cylinder((0, 0, z), r, depth, rim, bevel_m=0.006, sides=22, tilt_rad=quarter)
    b.cylinder(
        (0, -depth / 2, z),
        r * 0.86,
        0.003,
        Material((0.97, 0.97, 0.94)),
        sides=22,
        tilt_rad=quarter,
    )
    for size, turn in (((0.004, 0.002, r * 0.6), 0.6), ((0.004, 0.002, r * 0.75), -1.4)):
        x, dz = math.sin(turn) * size[2] / 2, math.cos(turn) * size[2] / 2
        b.box((x, -depth / 2 - 0.002, z + dz), size, BLACK, tilt_rad=(0, turn, 0))
    for x in (-1, 1):
        b.ellipsoid(
            (x * r * 0.62, 0, 2 * r + 0.012),
            (0.02, 0.016, 0.014),
            STEEL,
            sides=12,
            rings=6,
            tilt_rad=(0, x * 0.5, 0),
        )
        b.tube(
            [(x * r * 0.5, 0, 0.02), (x * r * 0.7, 0, 0.01), (x * r * 0.85, 0, 0.0)], 0.005, STEEL
        )
    b.tube(
        [
            (-0.02, 0, 2 * r + 0.02),
            (-0.018, 0, h - 0.01),
            (0, 0, h - 0.003),
            (0.018, 0, h - 0.01),
            (0.02, 0, 2 * r + 0.02),
        ],
        0.003,
        STEEL,
    )
    b.solid("box", (0, 0, (h - 0.02) / 2), (1.9 * r, depth, h - 0.02))
    del palette
    return lowered(b.finish((2 * r, depth, h), rim, mass_kg=0.3), h / 2)


def remote_control(rng: np.random.Generator, palette: Palette) -> Shape:
    w, d, h = 0.05, float(rng.uniform(0.17, 0.2)), 0.024
    body = Material(tinted((0.14, 0.14, 0.15), rng, 0.04), "", 0.4, 0.5)
    b = ShapeBuilder()
    b.box((0, 0, h / 2), (w, d, h), body, bevel_m=0.007, segments=2)
    key = Material((0.82, 0.82, 0.80), "", 0.2)
    for row in range(4):
        for column in range(3):
            center = ((column - 1) * 0.013, d * (0.06 - 0.11 * row), h)
            b.cylinder(center, 0.0042, 0.004, key, sides=8)
    b.cylinder((0.012, d * 0.4, h), 0.005, 0.004, Material((0.85, 0.15, 0.12), "", 0.3), sides=10)
    b.cylinder((0, d * 0.23, h), 0.014, 0.003, key, sides=14)
    b.solid("box", (0, 0, h / 2), (w, d, h))
    del palette
    return lowered(b.finish((w, d, h), body, mass_kg=0.15), h / 2)


def pot_plant(rng: np.random.Generator, palette: Palette) -> Shape:
    r, pot = float(rng.uniform(0.045, 0.055)), float(rng.uniform(0.08, 0.1))
    h = pot + 0.075
    clay = Material(tinted((0.80, 0.52, 0.38), rng, 0.12), "ceramic", 0.2)
    leaf = Material(tinted((0.34, 0.56, 0.30), rng, 0.07), "foliage", 0.15)
    b = ShapeBuilder()
    b.lathe(
        [
            (0, 0),
            (r * 0.7, 0),
            (r, pot),
            (r - 0.006, pot),
            (r - 0.01, pot - 0.012),
            (0, pot - 0.012),
        ],
        (0, 0, 0),
        clay,
    )
    for k in range(11):
        turn, lean = k * 2.4, 0.25 + 0.075 * k
        reach = 0.036 if k else 0.04
        tip = (math.sin(lean) * reach * math.cos(turn), math.sin(lean) * reach * math.sin(turn))
        center = (tip[0], tip[1], pot - 0.008 + math.cos(lean) * 0.042)
        b.ellipsoid(
            center, (0.011, 0.006, 0.044), leaf, sides=8, rings=6, tilt_rad=(0.0, lean, turn)
        )
    b.solid("cylinder", (0, 0, pot / 2), (2 * r, 2 * r, pot))
    b.solid("cylinder", (0, 0, pot + 0.035), (0.07, 0.07, 0.07))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), clay, mass_kg=0.5), h / 2)
