"""Objects of cloth, and objects of bathroom and hall.

They are drawn standing on z = 0, then moved so that the origin is the centre of the bounding box.
"""

import numpy as np

from helios_sim.home import mesh_primitives
from helios_sim.home.color_palette import BLACK, STEEL, WHITE, Palette, darker, tinted
from helios_sim.home.home_types import Material, Rgb, Shape
from helios_sim.home.shape_builder import ShapeBuilder, lowered

_CLOTH: tuple[Rgb, ...] = (
    (0.93, 0.92, 0.88),
    (0.35, 0.52, 0.62),
    (0.78, 0.45, 0.38),
    (0.50, 0.60, 0.44),
    (0.86, 0.72, 0.42),
    (0.45, 0.40, 0.50),
)


def _cloth(rng: np.random.Generator, texture: str) -> Material:
    return Material(tinted(_CLOTH[int(rng.integers(len(_CLOTH)))], rng, 0.05), texture, 0.02, 0.05)


def towel(rng: np.random.Generator, palette: Palette) -> Shape:
    """Towel folded in three or four layers."""
    w, d = float(rng.uniform(0.2, 0.26)), float(rng.uniform(0.16, 0.2))
    layers, thick = int(rng.integers(3, 5)), 0.02
    cloth = _cloth(rng, "stripes" if rng.random() < 0.3 else "fabric")
    h = layers * thick
    b = ShapeBuilder()
    for k in range(layers):
        inset = 0.004 * (k % 2)
        z = (k + 0.5) * thick
        size = (w - inset, d - inset, thick + 0.002)
        b.box((0, inset / 2, z), size, darker(cloth, 1 - 0.05 * (k % 2)), bevel_m=0.009, segments=2)
    b.box((0, -d / 2 + 0.05, h), (w - 0.004, 0.02, 0.003), darker(cloth, 0.75))
    b.solid("box", (0, 0, h / 2), (w, d, h))
    del palette
    return lowered(b.finish((w, d, h), cloth, mass_kg=0.3), h / 2)


def toilet_paper(rng: np.random.Generator, palette: Palette) -> Shape:
    """Upright roll of toilet paper."""
    r, h = float(rng.uniform(0.05, 0.06)), float(rng.uniform(0.095, 0.105))
    paper = Material(tinted((0.95, 0.95, 0.94), rng, 0.02), "fabric", 0.02, 0.05)
    b = ShapeBuilder()
    b.lathe([(0.02, 0), (r, 0), (r, h), (0.02, h)], (0, 0, 0), paper, sides=22)
    core = Material((0.66, 0.54, 0.40), "", 0.02)
    b.lathe([(0.02, h), (0.018, h), (0.018, h * 0.6), (0, h * 0.6)], (0, 0, 0), core, sides=14)
    b.solid("cylinder", (0, 0, h / 2), (2 * r, 2 * r, h))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), paper, mass_kg=0.15), h / 2)


def soap_dispenser(rng: np.random.Generator, palette: Palette) -> Shape:
    r, h = float(rng.uniform(0.032, 0.038)), float(rng.uniform(0.16, 0.19))
    liquids: tuple[Rgb, ...] = ((0.55, 0.75, 0.62), (0.82, 0.62, 0.70), (0.93, 0.93, 0.92))
    body = Material(tinted(liquids[int(rng.integers(3))], rng), "", 0.6, 0.7)
    b = ShapeBuilder()
    profile = [
        (0, 0),
        (r * 0.95, 0),
        (r, 0.008),
        (r, h * 0.56),
        (r * 0.45, h * 0.66),
        (0, h * 0.66),
    ]
    b.lathe(profile, (0, 0, 0), body)
    metal = STEEL if rng.random() < 0.5 else BLACK
    b.cylinder((0, 0, h * 0.72), r * 0.36, h * 0.12, metal, sides=12)
    b.cylinder((0, 0, h * 0.84), 0.005, h * 0.2, metal, sides=8)
    b.box((r * 0.4, 0, h * 0.965), (r * 1.5, 0.018, h * 0.06), metal, bevel_m=0.004)
    b.solid("cylinder", (0, 0, h * 0.31), (2 * r, 2 * r, h * 0.62))
    b.solid("cylinder", (0, 0, h * 0.8), (0.7 * r, 0.7 * r, h * 0.4))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), body, mass_kg=0.4), h / 2)


def sponge(rng: np.random.Generator, palette: Palette) -> Shape:
    w, d, h = float(rng.uniform(0.1, 0.12)), float(rng.uniform(0.065, 0.08)), 0.04
    foam = Material(tinted((0.93, 0.80, 0.28), rng, 0.08), "speckle", 0.0, 0.0)
    scour = Material(tinted((0.22, 0.48, 0.30), rng, 0.06), "fabric", 0.0, 0.0)
    b = ShapeBuilder()
    b.box((0, 0, 0.014), (w, d, 0.028), foam, bevel_m=0.005)
    b.box((0, 0, 0.034), (w, d, 0.012), scour, bevel_m=0.003)
    b.solid("box", (0, 0, h / 2), (w, d, h))
    del palette
    return lowered(b.finish((w, d, h), foam, mass_kg=0.05), h / 2)


def shoe(rng: np.random.Generator, palette: Palette) -> Shape:
    """Trainer with its tip at -y."""
    d, w = float(rng.uniform(0.24, 0.27)), float(rng.uniform(0.088, 0.098))
    h = float(rng.uniform(0.1, 0.115))
    leather = _cloth(rng, "fabric") if rng.random() < 0.6 else darker(_cloth(rng, ""), 0.5)
    sole = WHITE if rng.random() < 0.6 else BLACK
    b = ShapeBuilder()
    b.box((0, 0, 0.013), (w, d, 0.026), sole, bevel_m=0.012, segments=2)
    tip = (0.0, -d * 0.24, 0.036)
    b.ellipsoid(tip, (w * 0.48, d * 0.25, 0.038), leather, sides=14, rings=8)
    heel = (0.0, d * 0.18, h * 0.52)
    b.box(heel, (w * 0.86, d * 0.56, h * 0.72), leather, bevel_m=0.03, segments=2)
    slope = (0.0, -d * 0.1, h * 0.52)
    b.box(slope, (w * 0.78, d * 0.3, h * 0.5), leather, bevel_m=0.026, tilt_rad=(0.42, 0, 0))
    opening = (0.0, d * 0.2, h * 0.885)
    b.ellipsoid(opening, (w * 0.3, d * 0.19, 0.006), darker(leather, 0.3), sides=12, rings=6)
    for k in range(3):
        lace = (0.0, -d * (0.02 + 0.06 * k), h * (0.80 - 0.09 * k))
        b.box(lace, (w * 0.46, 0.008, 0.007), WHITE, tilt_rad=(0.5, 0, 0))
    b.solid("box", (0, 0, 0.02), (w, d, 0.04))
    b.solid("box", (0, d * 0.18, h * 0.5), (w * 0.86, d * 0.56, h * 0.8))
    del palette
    return lowered(b.finish((w, d, h * 0.9), leather, mass_kg=0.35), h * 0.45)


def hat(rng: np.random.Generator, palette: Palette) -> Shape:
    """Hat with its brim down."""
    r, h = float(rng.uniform(0.1, 0.12)), float(rng.uniform(0.1, 0.12))
    felt = Material(tinted((0.62, 0.50, 0.34), rng, 0.15), "weave", 0.02, 0.02)
    b = ShapeBuilder()
    profile = [(0, 0), (r, 0), (r, 0.008), (r * 0.6, 0.014), (r * 0.58, h * 0.5)]
    profile += [(r * 0.54, h * 0.86), (r * 0.36, h), (0, h * 0.96)]
    b.lathe(profile, (0, 0, 0), felt, sides=24)
    band = [(r * 0.606, 0.016), (r * 0.596, 0.04)]
    b.lathe(band, (0, 0, 0), darker(felt, 0.4), sides=24)
    b.solid("cylinder", (0, 0, 0.006), (2 * r, 2 * r, 0.012))
    b.solid("cylinder", (0, 0, h / 2), (1.16 * r, 1.16 * r, h))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), felt, mass_kg=0.15), h / 2)


def basket(rng: np.random.Generator, palette: Palette) -> Shape:
    """Small woven basket, open at the top, with a handle."""
    r, rim = float(rng.uniform(0.09, 0.11)), float(rng.uniform(0.09, 0.11))
    weave = Material(tinted((0.70, 0.54, 0.34), rng, 0.1), "weave", 0.03, 0.05)
    h = rim + 0.09
    b = ShapeBuilder()
    profile = [(0, 0), (r * 0.8, 0), (r, rim), (r - 0.009, rim), (r * 0.74, 0.012), (0, 0.012)]
    b.lathe(profile, (0, 0, 0), weave, sides=22)
    b.tube(mesh_primitives.arc((0, 0, rim - 0.012), 0.1 if r > 0.1 else r, 0, np.pi), 0.007, weave)
    b.solid("cylinder", (0, 0, rim / 2), (1.9 * r, 1.9 * r, rim))
    b.solid("box", (0, 0, rim + 0.04), (2 * r * 0.8, 0.014, 0.08))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), weave, mass_kg=0.3), h / 2)


def cushion(rng: np.random.Generator, palette: Palette) -> Shape:
    """Square cushion that lies flat."""
    w, h = float(rng.uniform(0.23, 0.27)), float(rng.uniform(0.075, 0.095))
    patterns = ("fabric", "stripes", "checks", "dots")
    cloth = _cloth(rng, patterns[int(rng.integers(4))])
    b = ShapeBuilder()
    b.box((0, 0, h / 2), (w, w, h), cloth, bevel_m=h * 0.48, segments=3)
    b.solid("box", (0, 0, h / 2), (w * 0.92, w * 0.92, h))
    del palette
    return lowered(b.finish((w, w, h), cloth, mass_kg=0.3), h / 2)
