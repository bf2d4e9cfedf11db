"""Shapes of stool, trunk, filing cabinet, hamper, washing machine, sideboard, chair, bath, toilet.

Origin on the floor at the centre, back at +y. Collision legs are as thin as the drawn ones.
"""

import math

import numpy as np

from helios_sim.home import decoration_shapes, mesh_primitives
from helios_sim.home.cabinet_shapes import fronts
from helios_sim.home.color_palette import BLACK, STEEL, WHITE, Palette, darker, tinted
from helios_sim.home.home_types import Material, Rgb, Shape
from helios_sim.home.shape_builder import ShapeBuilder
from helios_sim.home.shape_variation import joined


def _thin_legs(
    b: ShapeBuilder,
    top_half: tuple[float, float],
    foot_half: tuple[float, float],
    height: float,
    thick: float,
    material: Material,
) -> None:
    """Add four legs that spread from the underside of a seat to the floor."""
    for x in (-1, 1):
        for y in (-1, 1):
            dx, dy = x * (foot_half[0] - top_half[0]), y * (foot_half[1] - top_half[1])
            length = math.sqrt(height**2 + dx**2 + dy**2)
            # Rotation about x, then y, that aligns z with the leg, from the foot upwards.
            tilt = (math.asin(dy / length), -math.atan2(dx, height), 0.0)
            middle = (
                x * (top_half[0] + foot_half[0]) / 2,
                y * (top_half[1] + foot_half[1]) / 2,
                height / 2,
            )
            b.box(middle, (thick, thick, length), material, tilt_rad=tilt, solid=True)


def stool(rng: np.random.Generator, palette: Palette) -> Shape:
    """Low stool or bar stool on four spread legs."""
    height = float(rng.choice([0.46, 0.66])) + float(rng.uniform(-0.03, 0.03))
    wood = palette.wood_or_paint(rng)
    legs = wood if rng.random() < 0.5 else BLACK
    b = ShapeBuilder()
    spread = 0.17 + 0.05 * height
    if rng.random() < 0.5:
        radius = float(rng.uniform(0.16, 0.18))
        b.cylinder((0, 0, height - 0.018), radius, 0.036, wood, bevel_m=0.008, sides=24)
        b.solid("cylinder", (0, 0, height - 0.018), (2 * radius, 2 * radius, 0.036))
        side = radius * 1.5
    else:
        side = float(rng.uniform(0.3, 0.34))
        b.box((0, 0, height - 0.018), (side, side, 0.036), wood, bevel_m=0.01, solid=True)
    _thin_legs(b, (0.1, 0.1), (spread, spread), height - 0.03, 0.026, legs)
    ring = height * 0.3
    reach = spread - (spread - 0.1) * 0.3
    for s in (-1, 1):
        b.box((0, s * reach, ring), (2 * reach, 0.016, 0.016), legs)
        b.box((s * reach, 0, ring), (0.016, 2 * reach, 0.016), legs)
    b.surface((0, 0), (side, side), height)
    return b.finish((2 * spread + 0.03, 2 * spread + 0.03, height), wood)


def chair(rng: np.random.Generator, palette: Palette) -> Shape:
    """Dining chair with four separate legs and a seat on which objects can lie."""
    width, depth = float(rng.uniform(0.41, 0.46)), float(rng.uniform(0.43, 0.48))
    seat, back = float(rng.uniform(0.44, 0.47)), float(rng.uniform(0.82, 0.95))
    wood = palette.wood_or_paint(rng)
    leg = float(rng.uniform(0.026, 0.036))
    b = ShapeBuilder()
    b.box((0, -0.01, seat - 0.02), (width, depth - 0.02, 0.04), wood, bevel_m=0.012)
    b.solid("box", (0, 0, seat - 0.02), (width, depth, 0.04))
    if rng.random() < 0.6:
        cloth = palette.fabric(rng)
        b.box((0, -0.02, seat - 0.005), (width - 0.02, depth - 0.07, 0.04), cloth, bevel_m=0.015)
        b.solid("box", (0, -0.02, seat + 0.0025), (width - 0.02, depth - 0.07, 0.025))
        seat += 0.015
    for x in (-1, 1):
        front = (x * (width / 2 - leg / 2), -depth / 2 + leg / 2 + 0.005, (seat - 0.03) / 2)
        b.box(front, (leg, leg, seat - 0.03), wood, solid=True)
        rear = (x * (width / 2 - leg / 2), depth / 2 - leg / 2, back / 2)
        b.box(rear, (leg, leg, back), wood, solid=True)
        b.box((x * (width / 2 - leg / 2), 0, 0.2), (0.018, depth - 0.06, 0.018), wood)
    inner = width - 2 * leg
    if rng.random() < 0.5:
        for k in range(int(rng.integers(2, 4))):
            z = back - 0.05 - k * 0.12
            b.box((0, depth / 2 - 0.02, z), (inner, 0.02, 0.06), wood, bevel_m=0.006)
    else:
        b.box((0, depth / 2 - 0.02, back - 0.03), (inner, 0.022, 0.05), wood, bevel_m=0.006)
        for k in range(4):
            x = -inner / 2 + (k + 0.5) * inner / 4
            tall = back - seat - 0.05
            b.box((x, depth / 2 - 0.02, seat + tall / 2), (0.018, 0.014, tall), wood)
    center = (0.0, depth / 2 - 0.02, (seat + 0.1 + back) / 2)
    b.solid("box", center, (width, 0.03, back - seat - 0.1))
    b.surface((0, -0.025), (width - 0.04, depth - 0.09), seat)
    return b.finish((width, depth, back), wood)


def trunk(rng: np.random.Generator, palette: Palette) -> Shape:
    """Chest with a lid, straps and a lock plate."""
    width, depth = float(rng.uniform(0.8, 1.05)), float(rng.uniform(0.42, 0.5))
    height, lid = float(rng.uniform(0.42, 0.5)), 0.11
    wood = palette.wood(rng)
    iron = darker(STEEL, 0.55) if rng.random() < 0.5 else Material((0.62, 0.5, 0.3), "", 0.5, 0.5)
    b = ShapeBuilder()
    b.box((0, 0, (height - lid) / 2), (width - 0.02, depth - 0.02, height - lid), wood)
    top = (0.0, 0.0, height - lid / 2)
    b.box(top, (width, depth, lid - 0.006), darker(wood, 0.92), bevel_m=0.012)
    for x in (-0.3, 0.3):
        front = (x * width, -depth / 2 + 0.008, height / 2)
        b.box(front, (0.05, 0.02, height), iron)
        b.box((x * width, 0, height - 0.002), (0.05, depth, 0.004), iron)
    b.box((0, -depth / 2 - 0.004, height - lid), (0.08, 0.02, 0.1), iron, bevel_m=0.004)
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    b.surface((0, 0), (width, depth), height)
    return b.finish((width, depth, height), wood)


def filing_cabinet(rng: np.random.Generator, palette: Palette) -> Shape:
    """Steel cabinet with two or three deep drawers and label holders."""
    width, depth, rows = 0.42, float(rng.uniform(0.5, 0.58)), int(rng.integers(2, 4))
    height = 0.05 + rows * float(rng.uniform(0.31, 0.335))
    coats: tuple[Rgb, ...] = ((0.62, 0.65, 0.67), (0.30, 0.33, 0.36), (0.86, 0.86, 0.83))
    coat = Material(tinted(coats[int(rng.integers(3))], rng, 0.03), "", 0.35, 0.4)
    b = ShapeBuilder()
    b.box((0, 0.01, height / 2), (width, depth - 0.02, height), darker(coat, 0.9), bevel_m=0.004)
    one = (height - 0.05) / rows
    for k in range(rows):
        z = 0.03 + (k + 0.5) * one
        y = -depth / 2 + 0.012
        b.box((0, y, z), (width - 0.02, 0.024, one - 0.012), coat, bevel_m=0.004)
        b.box((0, y - 0.02, z), (0.13, 0.02, 0.018), STEEL)
        b.box((0, y - 0.012, z + 0.08), (0.09, 0.006, 0.04), STEEL)
        b.box((0, y - 0.014, z + 0.08), (0.075, 0.006, 0.028), WHITE)
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    b.surface((0, 0), (width, depth), height)
    del palette
    return b.finish((width, depth, height), coat)


def hamper(rng: np.random.Generator, palette: Palette) -> Shape:
    """Woven laundry basket with a flat lid, round or rectangular."""
    height = float(rng.uniform(0.52, 0.64))
    weave = Material(tinted((0.74, 0.6, 0.42), rng, 0.08), "weave", 0.03, 0.05)
    lid = darker(weave, 0.85) if rng.random() < 0.5 else palette.wood(rng)
    b = ShapeBuilder()
    if rng.random() < 0.5:
        r = float(rng.uniform(0.2, 0.23))
        profile = [(0, 0), (r * 0.82, 0), (r * 0.96, height - 0.04), (0, height - 0.04)]
        b.lathe(profile, (0, 0, 0), weave, sides=22)
        b.cylinder((0, 0, height - 0.02), r, 0.04, lid, bevel_m=0.008, sides=22)
        b.solid("cylinder", (0, 0, height / 2), (2 * r, 2 * r, height))
        size, flat = (2 * r, 2 * r), (1.45 * r, 1.45 * r)
    else:
        width, depth = float(rng.uniform(0.42, 0.52)), float(rng.uniform(0.34, 0.4))
        body = (0.0, 0.0, (height - 0.04) / 2)
        b.box(body, (width - 0.03, depth - 0.03, height - 0.04), weave, bevel_m=0.03, segments=2)
        b.box((0, 0, height - 0.02), (width, depth, 0.04), lid, bevel_m=0.01)
        for x in (-1, 1):
            grip = (x * (width / 2 - 0.012), 0.0, height * 0.72)
            b.box(grip, (0.012, 0.12, 0.03), darker(weave, 0.5))
        b.solid("box", (0, 0, height / 2), (width, depth, height))
        size, flat = (width, depth), (width, depth)
    b.surface((0, 0), flat, height)
    return b.finish((*size, height), weave)


def washing_machine(rng: np.random.Generator, palette: Palette) -> Shape:
    """Washing machine with a front door of random size and colour."""
    width, depth, height = 0.6, float(rng.uniform(0.56, 0.62)), float(rng.uniform(0.84, 0.88))
    coat = WHITE if rng.random() < 0.7 else darker(STEEL, 0.85)
    b = ShapeBuilder()
    b.box((0, 0.01, height / 2), (width, depth - 0.02, height), coat, bevel_m=0.012)
    y, z = -depth / 2 + 0.004, height * 0.44
    turned = (math.pi / 2, 0.0, 0.0)
    r = float(rng.uniform(0.17, 0.2))
    rim = darker(STEEL, 0.8) if rng.random() < 0.6 else darker(WHITE, 0.8)
    b.cylinder((0, y, z), r, 0.04, rim, bevel_m=0.01, sides=24, tilt_rad=turned)
    glass = Material((0.16, 0.18, 0.21), "", 0.8, 0.8)
    b.cylinder((0, y - 0.018, z), r * 0.74, 0.012, glass, sides=24, tilt_rad=turned)
    b.box((0, y - 0.002, height - 0.075), (width - 0.02, 0.02, 0.12), darker(coat, 0.86))
    knob = (0.08, y - 0.02, height - 0.075)
    b.cylinder(knob, 0.03, 0.03, STEEL, sides=16, tilt_rad=turned)
    b.box((-0.19, y - 0.008, height - 0.075), (0.16, 0.02, 0.07), coat, bevel_m=0.004)
    b.box((0.21, y - 0.008, height - 0.07), (0.1, 0.016, 0.04), glass)
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    b.surface((0, 0), (width, depth - 0.04), height)
    del palette
    return b.finish((width, depth, height), coat)


def sideboard(rng: np.random.Generator, palette: Palette) -> Shape:
    """Low cabinet with doors, on feet."""
    width, depth = float(rng.uniform(1.15, 1.5)), float(rng.uniform(0.4, 0.46))
    height, foot = float(rng.uniform(0.72, 0.85)), float(rng.uniform(0.08, 0.16))
    body = palette.wood(rng)
    front = palette.paint(rng) if rng.random() < 0.5 else body
    b = ShapeBuilder()
    b.box((0, 0, height - 0.0125), (width, depth, 0.025), body, bevel_m=0.006)
    middle = (0.0, 0.01, (foot + height - 0.025) / 2)
    b.box(middle, (width - 0.02, depth - 0.03, height - 0.025 - foot), darker(body, 0.9))
    span, level = (-width / 2 + 0.015, width / 2 - 0.015), (foot + 0.01, height - 0.03)
    plane, count = -depth / 2 + 0.024, int(rng.integers(3, 5))
    fronts(b, span, level, plane, count, 1, front, BLACK, bar=bool(rng.random() < 0.5))
    for x in (-1, 1):
        for y in (-1, 1):
            place = (x * (width / 2 - 0.06), y * (depth / 2 - 0.06), foot / 2)
            b.cylinder(place, 0.014, foot, BLACK, top_radius_m=0.02, sides=8)
    b.solid("box", (0, 0, height / 2), (width, depth, height))
    b.surface((0, 0), (width, depth), height)
    return b.finish((width, depth, height), body)


def bathtub(rng: np.random.Generator, palette: Palette) -> Shape:
    """Bathtub with a board across it, on which objects can stand."""
    tub = decoration_shapes.bathtub(rng, palette)
    width, depth, rim = tub.size_m
    board, x = float(rng.uniform(0.4, 0.55)), float(rng.uniform(-0.15, width / 2 - 0.4))
    b = ShapeBuilder()
    size = (board, depth - 0.01, 0.022)
    b.box((x, 0, rim + 0.011), size, palette.wood(rng), bevel_m=0.005, solid=True)
    b.surface((x, 0), (board, depth - 0.03), rim + 0.022)
    return joined(tub, b.finish(tub.size_m, WHITE))


def toilet(rng: np.random.Generator, palette: Palette) -> Shape:
    """Toilet with a closed lid; objects can stand on the lid and on the cistern."""
    bowl = decoration_shapes.toilet(rng, palette)
    b = ShapeBuilder()
    disc = mesh_primitives.lathe(
        [(0, -0.012), (0.19, -0.012), (0.195, 0), (0.185, 0.012), (0, 0.012)], 24
    )
    lid = (0.0, -0.1, 0.448)
    b.mesh(mesh_primitives.transformed(disc, np.eye(3), lid, (1.0, 1.25, 1.0)), darker(WHITE, 0.97))
    b.solid("box", lid, (0.34, 0.42, 0.024))
    b.surface((0, -0.1), (0.3, 0.36), 0.46)
    b.solid("box", (0, 0.25, 0.62), (0.38, 0.16, 0.36))
    b.surface((0.06, 0.25), (0.24, 0.15), 0.8)
    return joined(bowl, b.finish(bowl.size_m, WHITE))
