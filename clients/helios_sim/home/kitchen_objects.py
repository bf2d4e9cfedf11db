"""Objects of a kitchen: glass, jar, jug, kettle, pan, salt shaker, orange, banana.

They are drawn standing on z = 0, then moved so that the origin is the centre of the bounding box.
"""

import math
from dataclasses import replace

import numpy as np

from helios_sim.home import mesh_primitives
from helios_sim.home.color_palette import BLACK, STEEL, WHITE, Palette, darker, tinted
from helios_sim.home.home_types import Material, Rgb, Shape
from helios_sim.home.shape_builder import ShapeBuilder, lowered

_GLASS: tuple[Rgb, ...] = ((0.70, 0.82, 0.84), (0.55, 0.72, 0.60), (0.80, 0.66, 0.50))
_ENAMEL: tuple[Rgb, ...] = (
    (0.80, 0.24, 0.22),
    (0.24, 0.36, 0.52),
    (0.90, 0.88, 0.82),
    (0.32, 0.44, 0.36),
    (0.20, 0.20, 0.22),
)


def _one_of(rng: np.random.Generator, colors: tuple[Rgb, ...], spread: float = 0.04) -> Rgb:
    return tinted(colors[int(rng.integers(len(colors)))], rng, spread)


def glass(rng: np.random.Generator, palette: Palette) -> Shape:
    """Opaque tumbler, because depth cameras do not measure glass."""
    r, h = float(rng.uniform(0.034, 0.04)), float(rng.uniform(0.10, 0.14))
    body = Material(_one_of(rng, _GLASS), "", 0.8, 0.9)
    b = ShapeBuilder()
    b.lathe([(0, 0), (r * 0.8, 0), (r * 0.84, 0.012), (r, h)], (0, 0, 0), body)
    inner = [(r, h), (r - 0.003, h), (r * 0.86, h * 0.5), (0, h * 0.5)]
    b.lathe(inner, (0, 0, 0), darker(body, 0.85))
    b.solid("cylinder", (0, 0, h / 2), (1.9 * r, 1.9 * r, h))
    del palette
    return lowered(b.finish((2 * r, 2 * r, h), body, mass_kg=0.25), h / 2)


def jar(rng: np.random.Generator, palette: Palette) -> Shape:
    """Filled storage jar with a lid."""
    r, h = float(rng.uniform(0.04, 0.05)), float(rng.uniform(0.11, 0.16))
    fill: tuple[Rgb, ...] = ((0.75, 0.5, 0.25), (0.7, 0.2, 0.2), (0.9, 0.85, 0.7), (0.4, 0.28, 0.2))
    body = Material(_one_of(rng, fill), "speckle", 0.6, 0.8)
    lid = STEEL if rng.random() < 0.5 else palette.wood(rng)
    b = ShapeBuilder()
    b.lathe([(0, 0), (r * 0.92, 0), (r, 0.01), (r, h * 0.74), (r * 0.8, h * 0.82)], (0, 0, 0), body)
    b.cylinder((0, 0, h * 0.9), r * 0.86, h * 0.2, lid, bevel_m=0.004, sides=18)
    label = Material((0.94, 0.92, 0.86), "", 0.05)
    b.lathe([(r + 0.0008, h * 0.25), (r + 0.0008, h * 0.55)], (0, 0, 0), label)
    b.solid("cylinder", (0, 0, h * 0.39), (2 * r, 2 * r, h * 0.78))
    b.solid("cylinder", (0, 0, h * 0.9), (1.72 * r, 1.72 * r, h * 0.2))
    return lowered(b.finish((2 * r, 2 * r, h), body, mass_kg=0.45), h / 2)


def jug(rng: np.random.Generator, palette: Palette) -> Shape:
    """Pitcher with a handle and a lip."""
    r, h = float(rng.uniform(0.055, 0.065)), float(rng.uniform(0.18, 0.22))
    glaze = Material(_one_of(rng, _ENAMEL), "ceramic", 0.5, 0.6)
    b = ShapeBuilder()
    profile = [(0, 0), (r * 0.8, 0), (r, h * 0.3), (r * 0.9, h * 0.6), (r * 0.68, h * 0.82)]
    profile += [(r * 0.8, h), (r * 0.74, h), (r * 0.6, h * 0.8), (0, h * 0.7)]
    b.lathe(profile, (0, 0, 0), glaze, sides=20)
    lip = (r * 0.78, 0.0, h * 0.95)
    b.ellipsoid(lip, (r * 0.3, r * 0.3, h * 0.05), glaze, sides=10, rings=6)
    path = mesh_primitives.arc((-r * 0.72, 0, h * 0.58), h * 0.26, math.pi / 2, 3 * math.pi / 2)
    b.tube(path, 0.009, glaze)
    b.solid("cylinder", (0, 0, h * 0.32), (2 * r, 2 * r, h * 0.64))
    b.solid("cylinder", (0, 0, h * 0.82), (1.6 * r, 1.6 * r, h * 0.36))
    b.solid("box", (-r * 0.72 - h * 0.13, 0, h * 0.58), (h * 0.26, 0.02, h * 0.5))
    del palette
    return lowered(b.finish((2 * r + 0.07, 2 * r, h), glaze, mass_kg=0.6), h / 2)


def kettle(rng: np.random.Generator, palette: Palette) -> Shape:
    """Electric kettle on its base."""
    r, h = float(rng.uniform(0.072, 0.08)), float(rng.uniform(0.21, 0.24))
    coat = STEEL if rng.random() < 0.5 else Material(_one_of(rng, _ENAMEL), "ceramic", 0.5, 0.6)
    b = ShapeBuilder()
    b.cylinder((0, 0, 0.012), r, 0.024, BLACK, bevel_m=0.005, sides=20)
    profile = [(0, 0.024), (r * 0.96, 0.024), (r * 0.92, h * 0.5), (r * 0.7, h * 0.84)]
    profile += [(r * 0.4, h * 0.92), (0, h * 0.93)]
    b.lathe(profile, (0, 0, 0), coat, sides=20)
    b.ellipsoid((0, 0, h * 0.96), (0.014, 0.014, h * 0.04), BLACK, sides=8, rings=6)
    b.tube([(r * 0.7, 0, h * 0.62), (r * 0.95, 0, h * 0.74), (r * 1.15, 0, h * 0.84)], 0.013, coat)
    path = mesh_primitives.arc((-r * 0.72, 0, h * 0.56), h * 0.27, math.pi / 2, 1.42 * math.pi)
    b.tube(path, 0.011, BLACK)
    b.solid("cylinder", (0, 0, h * 0.28), (2 * r, 2 * r, h * 0.56))
    b.solid("cylinder", (0, 0, h * 0.74), (1.6 * r, 1.6 * r, h * 0.38))
    b.solid("box", (-r * 0.72 - h * 0.14, 0, h * 0.58), (h * 0.26, 0.024, h * 0.5))
    del palette
    return lowered(b.finish((2 * r + 0.06, 2 * r, h), coat, mass_kg=0.9), h / 2)


def pan(rng: np.random.Generator, palette: Palette) -> Shape:
    """Saucepan with a straight handle, short enough for a shelf."""
    r, h = float(rng.uniform(0.07, 0.085)), float(rng.uniform(0.07, 0.09))
    coat = (
        darker(STEEL, 0.9)
        if rng.random() < 0.4
        else Material(_one_of(rng, _ENAMEL), "ceramic", 0.4, 0.5)
    )
    b = ShapeBuilder()
    profile = [(0, 0), (r * 0.9, 0), (r * 0.97, 0.01), (r, h), (r - 0.005, h), (r * 0.93, 0.012)]
    b.lathe([*profile, (0, 0.01)], (0, 0, 0), coat, sides=24)
    grip = float(rng.uniform(0.1, 0.13))
    b.box((r + grip / 2 - 0.005, 0, h * 0.86), (grip, 0.02, 0.014), BLACK, bevel_m=0.005)
    b.solid("cylinder", (0, 0, h / 2), (2 * r, 2 * r, h))
    # The handle is thin and light, so that the pan does not tip over.
    b.solid("box", (r + grip / 2, 0, h * 0.86), (grip, 0.016, 0.012))
    shift = grip / 2
    del palette
    shape = lowered(b.finish((2 * r + grip, 2 * r, h), coat, mass_kg=0.6), h / 2)
    return _shifted_x(shape, -shift)


def _shifted_x(shape: Shape, by_m: float) -> Shape:
    """Shape moved along x; it centres a bounding box that is longer on one side."""
    visuals = tuple(
        replace(v, mesh=mesh_primitives.transformed(v.mesh, np.eye(3), (by_m, 0, 0)))
        for v in shape.visuals
    )
    solids = tuple(
        replace(s, center=(s.center[0] + by_m, s.center[1], s.center[2]))
        for s in shape.collision_primitives
    )
    return replace(shape, visuals=visuals, collision_primitives=solids)


def salt_shaker(rng: np.random.Generator, palette: Palette) -> Shape:
    """Small shaker or mill."""
    r, h = float(rng.uniform(0.022, 0.027)), float(rng.uniform(0.09, 0.13))
    body = palette.wood(rng) if rng.random() < 0.5 else WHITE
    b = ShapeBuilder()
    profile = [(0, 0), (r, 0), (r, h * 0.12), (r * 0.72, h * 0.4), (r * 0.86, h * 0.7)]
    b.lathe([*profile, (r * 0.7, h * 0.74), (0, h * 0.74)], (0, 0, 0), body, sides=16)
    top = (0.0, 0.0, h * 0.87)
    b.ellipsoid(top, (r * 0.84, r * 0.84, h * 0.13), STEEL, sides=14, rings=8)
    b.solid("cylinder", (0, 0, h / 2), (2 * r, 2 * r, h))
    return lowered(b.finish((2 * r, 2 * r, h), body, mass_kg=0.2), h / 2)


def orange(rng: np.random.Generator, palette: Palette) -> Shape:
    """Orange; it rolls."""
    r = float(rng.uniform(0.036, 0.042))
    skin = Material(tinted((0.93, 0.52, 0.12), rng, 0.05), "speckle", 0.2, 0.3)
    b = ShapeBuilder()
    b.ellipsoid((0, 0, 0), (r, r, r), skin, sides=18, rings=10)
    b.ellipsoid((0, 0, r * 0.97), (0.006, 0.006, 0.004), Material((0.3, 0.4, 0.15)), sides=8)
    b.solid("sphere", (0, 0, 0), (2 * r, 2 * r, 2 * r))
    del palette
    return b.finish((2 * r, 2 * r, 2 * r), skin, mass_kg=0.2, rolls=True)


def banana(rng: np.random.Generator, palette: Palette) -> Shape:
    """Banana that lies on its side."""
    skin = Material(tinted((0.93, 0.79, 0.20), rng, 0.04), "", 0.2, 0.3)
    r, bend = float(rng.uniform(0.018, 0.021)), float(rng.uniform(0.09, 0.11))
    tip = Material((0.35, 0.26, 0.12), "", 0.1)
    b = ShapeBuilder()
    angles = np.linspace(-0.85, 0.85, 8)
    points = [(bend * math.sin(a), bend * (math.cos(a) - 0.86), r) for a in angles]
    b.tube(points[1:-1], r, skin, sides=8)
    for (x0, y0, _), (x1, y1, _) in (points[1::-1], points[-2:]):
        turn = math.atan2(y1 - y0, x1 - x0)
        end = (math.hypot(x1 - x0, y1 - y0), r, r)
        b.ellipsoid((x0, y0, r), end, skin, sides=10, rings=8, tilt_rad=(0, 0, turn))
    for x, y, z in (points[0], points[-1]):
        b.ellipsoid((x, y, z), (0.009, 0.008, 0.008), tip, sides=8, rings=6)
    span = 2 * bend * math.sin(0.85)
    b.solid("box", (0, bend * 0.02, r), (span * 0.6, 2 * r, 2 * r))
    for s in (-1, 1):
        b.solid("box", (s * span * 0.36, -bend * 0.08, r), (span * 0.24, 2 * r, 2 * r))
    size = (span, bend * 0.36 + 2 * r, 2 * r)
    del palette
    return lowered(b.finish(size, skin, mass_kg=0.15), r)
