"""Lathed objects: mug, bowl, plate, bottle, can, vase, teapot, candle, apple.

They are drawn standing on z = 0, then moved so that the origin is the centre of the bounding box.
"""

import math

import numpy as np

from helios_sim.home import mesh_primitives
from helios_sim.home.color_palette import Palette, darker, tinted
from helios_sim.home.home_types import Material, Rgb, Shape
from helios_sim.home.shape_builder import ShapeBuilder, lowered

_GLAZES: tuple[Rgb, ...] = (
    (0.88, 0.30, 0.25),
    (0.20, 0.42, 0.68),
    (0.93, 0.80, 0.40),
    (0.35, 0.60, 0.45),
    (0.93, 0.92, 0.88),
    (0.55, 0.38, 0.60),
    (0.90, 0.56, 0.30),
)


def _glaze(rng: np.random.Generator) -> Material:
    return Material(tinted(_GLAZES[int(rng.integers(len(_GLAZES)))], rng), "ceramic", 0.5, 0.6)


def mug(rng: np.random.Generator, palette: Palette) -> Shape:
    r, h = float(rng.uniform(0.038, 0.044)), float(rng.uniform(0.09, 0.11))
    glaze = _glaze(rng)
    b = ShapeBuilder()
    b.lathe([(0, 0), (r * 0.9, 0), (r, 0.008), (r, h)], (0, 0, 0), glaze)
    inner = Material((0.96, 0.95, 0.92), "", 0.4, 0.5)
    b.lathe([(r, h), (r - 0.005, h), (r - 0.006, h * 0.75), (0, h * 0.75)], (0, 0, 0), inner)
    b.tube(
        mesh_primitives.arc((r - 0.004, 0, h * 0.52), h * 0.3, -math.pi / 2, math.pi / 2),
        0.006,
        glaze,
    )
    b.solid("cylinder", (0, 0, h / 2), (2 * r, 2 * r, h))
    b.solid("box", (r + h * 0.13, 0, h * 0.52), (h * 0.3, 0.014, h * 0.6))
    del palette
    return lowered(b.finish((2 * r + 0.06, 2 * r, h), glaze, mass_kg=0.3), h / 2)


def bowl(rng: np.random.Generator, palette: Palette) -> Shape:
    r, h = float(rng.uniform(0.07, 0.09)), float(rng.uniform(0.06, 0.075))
    glaze = _glaze(rng)
    b = ShapeBuilder()
    b.lathe(
        [
            (0, 0),
            (r * 0.48, 0),
            (r * 0.5, 0.008),
            (r * 0.78, h * 0.35),
            (r * 0.94, h * 0.7),
            (r, h),
            (r - 0.006, h),
            (r * 0.86, h * 0.66),
            (r * 0.68, h * 0.36),
            (r * 0.4, 0.016),
            (0, 0.012),
        ],
        (0, 0, 0),
        glaze,
        sides=22,
    )
    b.solid("cylinder", (0, 0, h * 0.25), (1.4 * r, 1.4 * r, h * 0.5))
    b.solid("cylinder", (0, 0, h * 0.75), (2 * r, 2 * r, h * 0.5))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), glaze, mass_kg=0.35), h / 2)


def plate(rng: np.random.Generator, palette: Palette) -> Shape:
    r, h = float(rng.uniform(0.095, 0.115)), 0.026
    glaze = _glaze(rng)
    rim = darker(glaze, 0.75)
    b = ShapeBuilder()
    b.lathe([(0, 0), (r * 0.6, 0), (r * 0.66, 0.006), (r, h)], (0, 0, 0), glaze, sides=26)
    b.lathe([(r, h), (r * 0.93, h - 0.001)], (0, 0, 0), rim, sides=26)
    b.lathe([(r * 0.93, h - 0.001), (r * 0.64, 0.011), (0, 0.009)], (0, 0, 0), glaze, sides=26)
    b.solid("cylinder", (0, 0, h * 0.3), (1.5 * r, 1.5 * r, h * 0.6))
    b.solid("cylinder", (0, 0, h * 0.75), (2 * r, 2 * r, h * 0.5))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), glaze, mass_kg=0.4), h / 2)


def bottle(rng: np.random.Generator, palette: Palette) -> Shape:
    r, h = float(rng.uniform(0.034, 0.038)), float(rng.uniform(0.22, 0.25))
    colors: tuple[Rgb, ...] = (
        (0.16, 0.38, 0.22),
        (0.45, 0.26, 0.12),
        (0.30, 0.52, 0.70),
        (0.75, 0.2, 0.2),
    )
    glass = Material(tinted(colors[int(rng.integers(4))], rng, 0.04), "", 0.7, 0.8)
    b = ShapeBuilder()
    b.lathe(
        [
            (0, 0),
            (r * 0.94, 0),
            (r, 0.01),
            (r, h * 0.56),
            (r * 0.85, h * 0.66),
            (r * 0.4, h * 0.78),
            (r * 0.36, h * 0.92),
            (0, h * 0.92),
        ],
        (0, 0, 0),
        glass,
    )
    b.cylinder(
        (0, 0, h * 0.955), r * 0.42, h * 0.09, Material((0.85, 0.82, 0.7), "", 0.3), sides=12
    )
    label = Material(tinted((0.93, 0.88, 0.72), rng), "", 0.05)
    b.lathe([(r + 0.0008, h * 0.16), (r + 0.0008, h * 0.44)], (0, 0, 0), label)
    b.solid("cylinder", (0, 0, h * 0.31), (2 * r, 2 * r, h * 0.62))
    b.solid("cylinder", (0, 0, h * 0.81), (r, r, h * 0.38))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), glass, mass_kg=0.5), h / 2)


def can(rng: np.random.Generator, palette: Palette) -> Shape:
    r, h = 0.033, float(rng.uniform(0.11, 0.125))
    tin = Material((0.75, 0.76, 0.78), "", 0.7, 0.7)
    paint = Material(tinted(_GLAZES[int(rng.integers(4))], rng), "", 0.5, 0.6)
    b = ShapeBuilder()
    b.lathe([(0, 0), (r * 0.8, 0), (r, 0.008)], (0, 0, 0), tin)
    b.lathe([(r, 0.008), (r, h * 0.4)], (0, 0, 0), paint)
    b.lathe([(r, h * 0.4), (r, h * 0.6)], (0, 0, 0), Material((0.94, 0.94, 0.92), "", 0.4, 0.5))
    b.lathe([(r, h * 0.6), (r, h - 0.01)], (0, 0, 0), paint)
    b.lathe([(r, h - 0.01), (r * 0.85, h), (r * 0.8, h - 0.004), (0, h - 0.004)], (0, 0, 0), tin)
    b.solid("cylinder", (0, 0, h / 2), (2 * r, 2 * r, h))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), paint, mass_kg=0.35), h / 2)


def vase(rng: np.random.Generator, palette: Palette) -> Shape:
    r, h = float(rng.uniform(0.05, 0.062)), float(rng.uniform(0.18, 0.24))
    glaze = _glaze(rng)
    neck = float(rng.uniform(0.4, 0.6))
    b = ShapeBuilder()
    b.lathe(
        [
            (0, 0),
            (r * 0.62, 0),
            (r * 0.8, h * 0.12),
            (r, h * 0.36),
            (r * 0.86, h * 0.58),
            (r * neck, h * 0.78),
            (r * neck, h * 0.88),
            (r * (neck + 0.2), h),
            (r * (neck + 0.1), h),
            (r * neck * 0.8, h * 0.88),
            (0, h * 0.86),
        ],
        (0, 0, 0),
        glaze,
    )
    b.solid("cylinder", (0, 0, h * 0.06), (1.4 * r, 1.4 * r, h * 0.12))
    b.solid("cylinder", (0, 0, h * 0.36), (2 * r, 2 * r, h * 0.48))
    b.solid("cylinder", (0, 0, h * 0.8), (1.4 * r * (neck + 0.2), 1.4 * r * (neck + 0.2), h * 0.4))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), glaze, mass_kg=0.6), h / 2)


def teapot(rng: np.random.Generator, palette: Palette) -> Shape:
    r, h = float(rng.uniform(0.06, 0.068)), float(rng.uniform(0.13, 0.15))
    glaze = _glaze(rng)
    body = h * 0.78
    b = ShapeBuilder()
    b.lathe(
        [
            (0, 0),
            (r * 0.62, 0),
            (r * 0.92, body * 0.25),
            (r, body * 0.5),
            (r * 0.85, body * 0.8),
            (r * 0.5, body),
            (r * 0.46, body + 0.006),
            (r * 0.2, body + 0.014),
            (0, body + 0.016),
        ],
        (0, 0, 0),
        glaze,
    )
    b.ellipsoid((0, 0, h - 0.011), (0.011, 0.011, 0.011), darker(glaze, 0.7), sides=8, rings=6)
    b.tube(
        [
            (r * 0.8, 0, body * 0.35),
            (r * 1.25, 0, body * 0.5),
            (r * 1.45, 0, body * 0.8),
            (r * 1.65, 0, body * 0.92),
        ],
        0.011,
        glaze,
    )
    b.tube(
        mesh_primitives.arc((-r * 0.85, 0, body * 0.55), body * 0.32, math.pi / 2, 3 * math.pi / 2),
        0.007,
        glaze,
    )
    b.solid("cylinder", (0, 0, body * 0.5), (1.9 * r, 1.9 * r, body))
    b.solid("box", (r * 1.3, 0, body * 0.65), (r * 0.8, 0.022, body * 0.5))
    del palette
    return lowered(b.finish((3.1 * r, 2 * r, h), glaze, mass_kg=0.6), h / 2)


def candle(rng: np.random.Generator, palette: Palette) -> Shape:
    r, h = float(rng.uniform(0.034, 0.042)), float(rng.uniform(0.09, 0.13))
    wax = Material(tinted((0.93, 0.87, 0.74), rng, 0.06), "ceramic", 0.2, 0.3)
    b = ShapeBuilder()
    b.cylinder(
        (0, 0, 0.007), r * 1.35, 0.014, Material((0.55, 0.45, 0.25), "", 0.7, 0.7), bevel_m=0.003
    )
    b.cylinder((0, 0, (0.014 + h - 0.014) / 2), r, h - 0.028, wax, bevel_m=0.004)
    b.cylinder((0, 0, h - 0.007), 0.0025, 0.014, Material((0.1, 0.1, 0.1)), sides=6)
    b.solid("cylinder", (0, 0, 0.007), (2.7 * r, 2.7 * r, 0.014))
    b.solid("cylinder", (0, 0, h / 2), (2 * r, 2 * r, h - 0.016))
    del palette
    return lowered(b.finish((2.7 * r, 2.7 * r, h), wax, mass_kg=0.3), h / 2)


def apple(rng: np.random.Generator, palette: Palette) -> Shape:
    r = float(rng.uniform(0.036, 0.042))
    colors: tuple[Rgb, ...] = ((0.75, 0.12, 0.12), (0.50, 0.66, 0.18), (0.85, 0.62, 0.18))
    skin = Material(tinted(colors[int(rng.integers(3))], rng), "ceramic", 0.5, 0.6)
    h = 2.1 * r
    b = ShapeBuilder()
    b.lathe(
        [
            (0, 0.006),
            (r * 0.3, 0.001),
            (r * 0.62, r * 0.16),
            (r * 0.92, r * 0.62),
            (r, r * 1.05),
            (r * 0.93, r * 1.45),
            (r * 0.7, r * 1.78),
            (r * 0.35, r * 1.88),
            (0, r * 1.7),
        ],
        (0, 0, 0),
        skin,
    )
    b.tube(
        [(0, 0, r * 1.68), (0.002, 0, r * 1.9), (0.006, 0, r * 2.1)],
        0.0022,
        Material((0.3, 0.2, 0.1)),
        sides=6,
    )
    # A flat base keeps the apple upright until it is pushed.
    b.solid("cylinder", (0, 0, r * 0.1), (r * 0.9, r * 0.9, r * 0.2))
    b.solid("sphere", (0, 0, r * 0.98), (2 * r * 0.96, 2 * r * 0.96, 2 * r * 0.96))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), skin, mass_kg=0.2, rolls=True), h / 2)
