"""Shapes of open storage with surfaces on several levels. Origin on the floor, back at +y."""

import numpy as np

from helios_sim.home.cabinet_shapes import fronts, shelf_goods
from helios_sim.home.color_palette import BLACK, STEEL, WHITE, Palette, darker
from helios_sim.home.home_types import Material, Shape
from helios_sim.home.shape_builder import ShapeBuilder

_BOARD_M = 0.022


def shelf(rng: np.random.Generator, palette: Palette) -> Shape:
    """Open rack of three or four boards; a basket fills part of the lowest one."""
    width, depth = float(rng.uniform(0.75, 1.0)), float(rng.uniform(0.32, 0.38))
    boards = int(rng.integers(3, 5))
    low, pitch = float(rng.uniform(0.12, 0.18)), float(rng.uniform(0.32, 0.345))
    wood = palette.wood_or_paint(rng)
    metal = rng.random() < 0.5
    frame = (BLACK if rng.random() < 0.5 else STEEL) if metal else wood
    height = low + (boards - 1) * pitch
    post = 0.024 if metal else 0.036
    b = ShapeBuilder()
    for x in (-1, 1):
        for y in (-1, 1):
            center = (x * (width - post) / 2, y * (depth - post) / 2, (height + 0.03) / 2)
            b.box(center, (post, post, height + 0.03), frame, solid=True)
    basket_w = float(rng.uniform(0.26, 0.34))
    side = -1 if rng.random() < 0.5 else 1
    inner = width - 2 * post - 0.01
    for k in range(boards):
        top = low + k * pitch
        center = (0.0, 0.0, top - _BOARD_M / 2)
        b.box(center, (width - 0.004, depth - 0.004, _BOARD_M), wood, bevel_m=0.003, solid=True)
        clear = pitch - _BOARD_M - 0.02 if k < boards - 1 else 10.0
        if k == 0:
            _basket(b, rng, palette, (side * (inner - basket_w) / 2, 0, top), (basket_w, depth))
            free = inner - basket_w - 0.02
            b.surface((-side * (inner - free) / 2, 0), (free, depth), top, clear)
        else:
            b.surface((0, 0), (inner, depth), top, clear)
    return b.finish((width, depth, height), wood)


def _basket(
    b: ShapeBuilder,
    rng: np.random.Generator,
    palette: Palette,
    foot: tuple[float, float, float],
    size_xy: tuple[float, float],
) -> None:
    x, y, z = foot
    width, depth, height = size_xy[0] - 0.01, size_xy[1] - 0.05, float(rng.uniform(0.18, 0.24))
    weave = Material(darker(palette.accent(rng), 0.9).rgb, "weave", 0.02, 0.05)
    b.box((x, y, z + height / 2), (width, depth, height), weave, bevel_m=0.015)
    b.box((x, y - depth / 2 - 0.003, z + height * 0.72), (0.09, 0.008, 0.025), WHITE)
    b.solid("box", (x, y, z + height / 2), (width, depth, height))


def bookcase(rng: np.random.Generator, palette: Palette) -> Shape:
    """Bookcase with three rows, partly full of books; surfaces on top and beside the books."""
    width, depth = float(rng.uniform(0.9, 1.15)), float(rng.uniform(0.3, 0.34))
    height, rows = float(rng.uniform(1.06, 1.14)), 3
    wood = palette.wood_or_paint(rng)
    b = ShapeBuilder()
    center = (0.0, 0.0, height - 0.0125)
    b.box(center, (width, depth, 0.025), wood, bevel_m=0.005, solid=True)
    for x in (-1, 1):
        center = (x * (width / 2 - 0.0125), 0.0, height / 2 - 0.0125)
        b.box(center, (0.025, depth, height - 0.025), wood, solid=True)
    back = (width - 0.03, 0.012, height - 0.04)
    b.box((0, depth / 2 - 0.006, height / 2), back, darker(wood, 0.75))
    b.solid("box", (0, depth / 2 - 0.006, height / 2), (width, 0.012, height))
    b.box((0, -depth / 2 + 0.03, 0.03), (width - 0.05, 0.02, 0.06), wood)
    cell = (height - 0.085) / rows
    half = width / 2 - 0.035
    for k in range(rows):
        top = 0.06 + k * cell + 0.018
        b.box((0, 0, top - 0.009), (width - 0.05, depth - 0.02, 0.018), wood, solid=True)
        full = width * float(rng.uniform(0.35, 0.6))
        side = 1 if rng.random() < 0.5 else -1
        span = (half - full, half) if side > 0 else (-half, -half + full)
        shelf_goods(b, rng, palette, span, depth, top, cell - 0.05)
        goods = (side * (half - full / 2), -0.01, top + (cell - 0.06) / 2)
        b.solid("box", goods, (full, depth - 0.07, cell - 0.06))
        free = 2 * half - full - 0.02
        b.surface((-side * (half - free / 2), -0.01), (free, depth - 0.03), top, cell - 0.04)
    b.surface((0, 0), (width, depth), height)
    return b.finish((width, depth, height), wood)


def shoe_rack(rng: np.random.Generator, palette: Palette) -> Shape:
    """Shoe rack with two or three low boards."""
    width, depth = float(rng.uniform(0.7, 0.95)), float(rng.uniform(0.29, 0.33))
    boards, low = int(rng.integers(2, 4)), float(rng.uniform(0.11, 0.14))
    pitch = float(rng.uniform(0.22, 0.25)) if boards == 2 else float(rng.uniform(0.2, 0.22))
    wood = palette.wood(rng)
    frame = wood if rng.random() < 0.6 else BLACK
    height = low + (boards - 1) * pitch
    b = ShapeBuilder()
    for x in (-1, 1):
        center = (x * (width / 2 - 0.011), 0.0, height / 2 - 0.005)
        b.box(center, (0.022, depth - 0.02, height - 0.01), frame, bevel_m=0.004, solid=True)
    for k in range(boards):
        top = low + k * pitch
        size = (width if k == boards - 1 else width - 0.044, depth, 0.02)
        if rng.random() < 0.5:
            b.box((0, 0, top - 0.01), size, wood, bevel_m=0.004)
        else:
            for slat in range(4):
                y = -depth / 2 + (slat + 0.5) * depth / 4
                b.box((0, y, top - 0.01), (size[0], depth / 4 - 0.012, 0.02), wood)
        b.solid("box", (0, 0, top - 0.01), size)
        clear = pitch - 0.03 if k < boards - 1 else 10.0
        b.surface((0, 0), (width - 0.06, depth), top, clear)
    return b.finish((width, depth, height), wood)


def serving_cart(rng: np.random.Generator, palette: Palette) -> Shape:
    """Trolley with two or three trays, on castors."""
    width, depth = float(rng.uniform(0.6, 0.75)), float(rng.uniform(0.38, 0.44))
    height = float(rng.uniform(0.76, 0.84))
    trays = int(rng.integers(2, 4))
    metal = STEEL if rng.random() < 0.5 else BLACK
    plate = palette.wood(rng) if rng.random() < 0.5 else palette.paint(rng)
    b = ShapeBuilder()
    low = 0.2
    pitch = (height - low) / (trays - 1)
    for x in (-1, 1):
        for y in (-1, 1):
            px, py = x * (width / 2 - 0.012), y * (depth / 2 - 0.012)
            b.cylinder((px, py, 0.06 + height / 2), 0.011, height - 0.04, metal, sides=8)
            b.solid("box", (px, py, 0.06 + height / 2), (0.022, 0.022, height - 0.04))
            turned = (0.0, np.pi / 2, 0.0)
            b.cylinder((px, py, 0.04), 0.04, 0.022, BLACK, sides=12, tilt_rad=turned)
            b.solid("box", (px, py, 0.04), (0.03, 0.03, 0.08))
    for k in range(trays):
        top = low + k * pitch
        size = (width - 0.02, depth - 0.02, 0.018)
        b.box((0, 0, top - 0.009), size, plate, bevel_m=0.003, solid=True)
        for y in (-1, 1):
            rail = (0.0, y * (depth / 2 - 0.012), top + 0.03)
            b.box(rail, (width - 0.03, 0.008, 0.008), metal)
        clear = pitch - 0.04 if k < trays - 1 else 10.0
        b.surface((0, 0), (width - 0.06, depth - 0.05), top, clear)
    x = width / 2 + 0.03
    for y in (-1, 1):
        b.box((x - 0.02, y * (depth / 2 - 0.04), height), (0.06, 0.014, 0.014), metal)
    b.box((x, 0, height), (0.016, depth - 0.06, 0.016), metal)
    b.solid("box", (x - 0.01, 0, height), (0.05, depth - 0.06, 0.03))
    return b.finish((width + 0.08, depth, height), plate)


def wardrobe(rng: np.random.Generator, palette: Palette) -> Shape:
    """Wardrobe with a door on one half, open boards on the other, and clothes above the boards."""
    width, depth = float(rng.uniform(1.2, 1.5)), 0.56
    height = float(rng.uniform(1.95, 2.1))
    body = palette.wood_or_paint(rng)
    shade = darker(body, 0.85)
    side = 1 if rng.random() < 0.5 else -1
    half = width / 2
    b = ShapeBuilder()
    closed = (-side * half / 2, 0.01, height / 2)
    b.box(closed, (half, depth - 0.02, height), darker(body, 0.93), bevel_m=0.006)
    span = (-half + 0.01, -0.005) if side > 0 else (0.005, half - 0.01)
    fronts(b, span, (0.08, height - 0.03), -depth / 2 + 0.02, 1, 1, body, STEEL, bar=True)
    b.solid("box", (-side * half / 2, 0, height / 2), (half, depth, height))
    outer = (side * (half - 0.012), 0.0, height / 2)
    b.box(outer, (0.024, depth, height), body, solid=True)
    b.box((side * half / 2, 0, height - 0.012), (half, depth, 0.024), body, solid=True)
    back = (side * half / 2, depth / 2 - 0.01, height / 2)
    b.box(back, (half, 0.02, height), shade, solid=True)
    b.box((side * half / 2, -0.01, 0.04), (half, depth - 0.04, 0.08), shade)
    inner, low, pitch = half - 0.04, float(rng.uniform(0.36, 0.42)), 0.36
    for k in range(3):
        top = low + k * pitch
        b.box((side * half / 2, 0, top - 0.01), (half - 0.01, depth - 0.03, 0.02), body, solid=True)
        clear = pitch - 0.04 if k < 2 else 0.5
        b.surface((side * half / 2, -0.06), (inner, depth - 0.16), top, clear)
    b.box((side * half / 2, 0, low - 0.17), (half - 0.03, depth - 0.06, 0.28), palette.accent(rng))
    b.solid("box", (side * half / 2, 0, low - 0.17), (half - 0.03, depth - 0.06, 0.28))
    _clothes(b, rng, palette, (side * half / 2, height - 0.1), inner)
    return b.finish((width, depth, height), body)


def _clothes(
    b: ShapeBuilder,
    rng: np.random.Generator,
    palette: Palette,
    rail_xz: tuple[float, float],
    width: float,
) -> None:
    """Add short clothes on a rail, above reach; visuals only."""
    x0, z = rail_xz
    b.box((x0, 0.02, z), (width, 0.02, 0.02), STEEL)
    count = int(rng.integers(3, 6))
    for k in range(count):
        cloth = palette.accent(rng) if rng.random() < 0.5 else palette.fabric(rng)
        x = x0 - width / 2 + (k + 0.5) * width / count
        length = float(rng.uniform(0.32, 0.42))
        b.box((x, 0.03, z - length / 2 - 0.02), (0.05, 0.36, length), cloth, bevel_m=0.02)
