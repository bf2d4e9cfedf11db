"""Objects of desk and sofa: phone, tablet, laptop, stapler, cube, picture frame, tissues, tape.

They are drawn on z = 0, then moved so that the origin is the centre of the bounding box.
"""

import math

import numpy as np

from helios_sim.home import mesh_primitives
from helios_sim.home.color_palette import BLACK, LINEN, STEEL, WHITE, Palette, darker, tinted
from helios_sim.home.home_types import Material, Rgb, Shape
from helios_sim.home.shape_builder import ShapeBuilder, lowered

_CASES: tuple[Rgb, ...] = (
    (0.12, 0.12, 0.13),
    (0.80, 0.80, 0.82),
    (0.70, 0.28, 0.30),
    (0.26, 0.36, 0.52),
    (0.86, 0.74, 0.60),
)
_BRIGHT: tuple[Rgb, ...] = (
    (0.80, 0.22, 0.20),
    (0.18, 0.40, 0.70),
    (0.95, 0.76, 0.20),
    (0.22, 0.58, 0.36),
    (0.95, 0.52, 0.16),
    (0.93, 0.93, 0.91),
)


def _case(rng: np.random.Generator) -> Material:
    return Material(tinted(_CASES[int(rng.integers(len(_CASES)))], rng, 0.03), "", 0.4, 0.5)


def _bright(rng: np.random.Generator, texture: str = "") -> Material:
    return Material(tinted(_BRIGHT[int(rng.integers(len(_BRIGHT)))], rng, 0.04), texture, 0.2, 0.4)


def _slab(rng: np.random.Generator, w: float, d: float, h: float, mass_kg: float) -> Shape:
    """Flat device with a screen on top."""
    case = _case(rng)
    glow = (0.10, 0.12, 0.15) if rng.random() < 0.6 else (0.30, 0.45, 0.60)
    b = ShapeBuilder()
    b.box((0, 0, h / 2), (w, d, h), case, bevel_m=0.004, segments=2)
    screen = Material(tinted(glow, rng, 0.03), "screen", 0.8, 0.9)
    b.box((0, 0, h), (w - 0.012, d - 0.02, 0.0016), screen)
    b.solid("box", (0, 0, h / 2), (w, d, h))
    return lowered(b.finish((w, d, h), case, mass_kg=mass_kg), h / 2)


def phone(rng: np.random.Generator, palette: Palette) -> Shape:
    del palette
    return _slab(rng, float(rng.uniform(0.07, 0.078)), float(rng.uniform(0.145, 0.16)), 0.014, 0.2)


def tablet(rng: np.random.Generator, palette: Palette) -> Shape:
    del palette
    return _slab(rng, float(rng.uniform(0.15, 0.17)), float(rng.uniform(0.21, 0.24)), 0.014, 0.5)


def laptop(rng: np.random.Generator, palette: Palette) -> Shape:
    """Small open laptop with its front at -y."""
    w, d, h = float(rng.uniform(0.27, 0.3)), float(rng.uniform(0.19, 0.21)), 0.0
    case = _case(rng)
    lean, tall = 0.22, float(rng.uniform(0.18, 0.2))
    h = tall * math.cos(lean) + 0.012
    back = tall * math.sin(lean)
    b = ShapeBuilder()
    y = -back / 2
    b.box((0, y, 0.009), (w, d, 0.018), case, bevel_m=0.004)
    b.box((0, y + 0.03, 0.0185), (w - 0.04, d * 0.5, 0.002), BLACK)
    b.box((0, y - d * 0.3, 0.0185), (0.08, d * 0.26, 0.0016), darker(case, 0.85))
    hinge = y + d / 2 - 0.004
    middle = (0.0, hinge + back / 2, 0.012 + tall * math.cos(lean) / 2)
    b.box(middle, (w, 0.009, tall), case, bevel_m=0.003, tilt_rad=(-lean, 0, 0), solid=True)
    glow = Material((0.16, 0.26, 0.40), "screen", 0.6, 0.8, 0.15)
    shift = 0.005
    face = (0.0, middle[1] - shift * math.cos(lean), middle[2] + shift * math.sin(lean))
    b.box(face, (w - 0.02, 0.002, tall - 0.024), glow, tilt_rad=(-lean, 0, 0))
    b.solid("box", (0, y, 0.009), (w, d, 0.018))
    del palette
    return lowered(b.finish((w, d + back, h), case, mass_kg=1.1), h / 2)


def stapler(rng: np.random.Generator, palette: Palette) -> Shape:
    length, w, h = float(rng.uniform(0.13, 0.15)), 0.036, 0.055
    coat = _bright(rng)
    b = ShapeBuilder()
    b.box((0, 0, 0.006), (length, w, 0.012), BLACK, bevel_m=0.004)
    b.box((0.005, 0, 0.03), (length * 0.92, w * 0.6, 0.014), STEEL, tilt_rad=(0, -0.1, 0))
    top = (0.0, 0.0, 0.043)
    b.box(top, (length, w, 0.02), coat, bevel_m=0.008, segments=2, tilt_rad=(0, -0.1, 0))
    b.box((-length * 0.42, 0, 0.026), (0.024, w, 0.036), coat, bevel_m=0.006)
    b.solid("box", (0, 0, h / 2), (length, w, h))
    del palette
    return lowered(b.finish((length, w, h), coat, mass_kg=0.3), h / 2)


def puzzle_cube(rng: np.random.Generator, palette: Palette) -> Shape:
    """Cube with nine coloured squares on each face except the bottom."""
    s = float(rng.uniform(0.056, 0.064))
    colors = [Material(c, "", 0.4, 0.5) for c in _BRIGHT]
    b = ShapeBuilder()
    b.box((0, 0, 0), (s, s, s), BLACK, bevel_m=0.003)
    step, tile, e = s / 3, s / 3 - 0.003, s / 2 + 0.0004
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            u, v = i * step, j * step
            for center, size in (
                ((u, v, e), (tile, tile, 0.0012)),
                ((u, e, v), (tile, 0.0012, tile)),
                ((u, -e, v), (tile, 0.0012, tile)),
                ((e, u, v), (0.0012, tile, tile)),
                ((-e, u, v), (0.0012, tile, tile)),
            ):
                b.box(center, size, colors[int(rng.integers(len(colors)))])
    b.solid("box", (0, 0, 0), (s, s, s))
    del palette
    return b.finish((s, s, s), BLACK, mass_kg=0.12)


def picture_frame(rng: np.random.Generator, palette: Palette) -> Shape:
    """Picture frame on a foot, leaning back."""
    w, tall = float(rng.uniform(0.12, 0.16)), float(rng.uniform(0.16, 0.2))
    frame = palette.wood(rng) if rng.random() < 0.6 else STEEL
    lean = 0.2
    h, back = tall * math.cos(lean), tall * math.sin(lean)
    foot = 0.07
    b = ShapeBuilder()
    depth = foot + 0.012
    y0 = -depth / 2 + 0.008
    middle = (0.0, y0 + back / 2, h / 2)
    tilt = (-lean, 0.0, 0.0)
    b.box(middle, (w, 0.014, tall), frame, bevel_m=0.004, tilt_rad=tilt)
    off = 0.0078
    face = (0.0, middle[1] - off * math.cos(lean), middle[2] + off * math.sin(lean))
    b.box(face, (w - 0.02, 0.002, tall - 0.02), LINEN, tilt_rad=tilt)
    pw, ph = w - 0.05, tall - 0.05
    panel = mesh_primitives.quad((-pw / 2, 0, -ph / 2), (pw, 0, 0), (0, 0, ph))
    art = Material((1, 1, 1), f"art{int(rng.integers(6))}", 0.1)
    place = (0.0, face[1] - 0.0016, face[2])
    turned = mesh_primitives.transformed(
        mesh_primitives.covered_once(panel, (pw, ph)), mesh_primitives.rotation_xyz(*tilt), place
    )
    b.mesh(turned, art)
    b.box((0, depth / 2 - 0.02, h * 0.3), (0.03, 0.006, h * 0.62), BLACK, tilt_rad=(0.32, 0, 0))
    b.solid("box", (0, 0, h * 0.25), (w, depth, h * 0.5))
    b.solid("box", (0, y0 + back * 0.75, h * 0.75), (w, 0.03, h * 0.5))
    return lowered(b.finish((w, depth, h), frame, mass_kg=0.4), h / 2)


def tissue_box(rng: np.random.Generator, palette: Palette) -> Shape:
    w, d, h = float(rng.uniform(0.2, 0.23)), 0.115, float(rng.uniform(0.07, 0.09))
    patterns = ("checks", "stripes", "dots", "")
    card = _bright(rng, patterns[int(rng.integers(4))])
    b = ShapeBuilder()
    b.box((0, 0, h / 2), (w, d, h), card, bevel_m=0.003)
    b.box((0, 0, h), (w * 0.5, d * 0.3, 0.002), darker(card, 0.5))
    for tilt, x in ((0.5, -0.02), (-0.35, 0.015)):
        b.box((x, 0, h + 0.018), (0.06, 0.004, 0.04), WHITE, tilt_rad=(tilt, 0.2, 0.1))
    b.solid("box", (0, 0, h / 2), (w, d, h))
    del palette
    return lowered(b.finish((w, d, h + 0.036), card, mass_kg=0.25), (h + 0.036) / 2)


def tape_roll(rng: np.random.Generator, palette: Palette) -> Shape:
    """Tape roll that lies flat."""
    r, h = float(rng.uniform(0.045, 0.055)), float(rng.uniform(0.03, 0.045))
    tape = Material(tinted((0.76, 0.62, 0.42), rng, 0.12), "", 0.4, 0.6)
    b = ShapeBuilder()
    ring = [(r * 0.66, 0), (r, 0), (r, h), (r * 0.66, h)]
    b.lathe(ring, (0, 0, 0), tape, sides=24)
    core = Material((0.85, 0.80, 0.70), "", 0.05)
    b.lathe([(r * 0.66, h), (r * 0.6, h), (r * 0.6, 0), (r * 0.66, 0)], (0, 0, 0), core, sides=24)
    b.solid("cylinder", (0, 0, h / 2), (2 * r, 2 * r, h))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), tape, mass_kg=0.15), h / 2)
