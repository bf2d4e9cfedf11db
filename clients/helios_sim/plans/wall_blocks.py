"""Walls of a plan as upright boxes: arcs in straight pieces, corners closed, doors cut out."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from helios_sim.home.freespace import Obstacle
from helios_sim.home.home_types import Rgb
from helios_sim.plans.plan_types import Opening, Wall, Xy

_ARC_STEP_RAD = math.radians(12)
_SLOPE_STEP_M = 0.5
_TOUCH_M = 0.03
_PARALLEL_COS = math.cos(math.radians(25))
_SLACK_M = 0.03
_LEAST_CUT_M = 0.05


@dataclass(frozen=True)
class WallBlock:
    """Upright box; its x axis runs along the wall from `z0_m` to `z1_m` above the floor.

    `left_rgb` is the colour of the face at +y of the block.
    """

    x: float
    y: float
    yaw_rad: float
    length_m: float
    thickness_m: float
    z0_m: float
    z1_m: float
    left_rgb: Rgb | None = None
    right_rgb: Rgb | None = None

    @property
    def footprint(self) -> Obstacle:
        return Obstacle(self.x, self.y, self.length_m / 2, self.thickness_m / 2, self.yaw_rad)

    def along(self, lo_m: float, hi_m: float, z0_m: float, z1_m: float) -> WallBlock:
        """Part of the block from `lo_m` to `hi_m` along its x axis, measured from its middle."""
        middle = (lo_m + hi_m) / 2
        return WallBlock(
            self.x + math.cos(self.yaw_rad) * middle,
            self.y + math.sin(self.yaw_rad) * middle,
            self.yaw_rad,
            hi_m - lo_m,
            self.thickness_m,
            z0_m,
            z1_m,
            self.left_rgb,
            self.right_rgb,
        )


def whole_blocks(walls: Sequence[Wall]) -> list[WallBlock]:
    """Blocks of all walls without openings; ends that touch another wall reach into it."""
    runs = [(wall, axis_points(wall)) for wall in walls]
    blocks = []
    for k, (wall, points) in enumerate(runs):
        others = [run for j, run in enumerate(runs) if j != k]
        first, last = (_overlap_m(wall, end, others) for end in (points[0], points[-1]))
        pieces = list(itertools.pairwise(points))
        for i, (a, b) in enumerate(pieces):
            inner = 0.0 if len(pieces) == 1 else wall.thickness_m / 2 * math.tan(_ARC_STEP_RAD / 2)
            before = first if i == 0 else inner
            after = last if i == len(pieces) - 1 else inner
            share = (i + 0.5) / len(pieces)
            top = wall.height_m + share * (wall.end_height_m - wall.height_m)
            blocks.append(_block(wall, a, b, before, after, top))
    return blocks


def _block(wall: Wall, a: Xy, b: Xy, before: float, after: float, top: float) -> WallBlock:
    length, yaw = math.dist(a, b), math.atan2(b[1] - a[1], b[0] - a[0])
    shift = (after - before) / 2
    return WallBlock(
        (a[0] + b[0]) / 2 + math.cos(yaw) * shift,
        (a[1] + b[1]) / 2 + math.sin(yaw) * shift,
        yaw,
        length + before + after,
        wall.thickness_m,
        0.0,
        top,
        wall.left_rgb,
        wall.right_rgb,
    )


def axis_points(wall: Wall) -> list[Xy]:
    """Points of a wall's axis from start to end: two of a straight wall of one height."""
    (ax, ay), (bx, by) = wall.start, wall.end
    chord = math.dist(wall.start, wall.end)
    if abs(wall.arc_rad) < 1e-3 or abs(math.sin(wall.arc_rad / 2)) < 1e-3:
        level = abs(wall.end_height_m - wall.height_m) < 0.01
        count = 1 if level else min(40, max(1, math.ceil(chord / _SLOPE_STEP_M)))
        return [(ax + (bx - ax) * k / count, ay + (by - ay) * k / count) for k in range(count + 1)]
    away = chord / 2 / math.tan(wall.arc_rad / 2)
    cx = (ax + bx) / 2 - (by - ay) / chord * away
    cy = (ay + by) / 2 + (bx - ax) / chord * away
    radius, begin = math.hypot(ax - cx, ay - cy), math.atan2(ay - cy, ax - cx)
    count = min(60, max(2, math.ceil(abs(wall.arc_rad) / _ARC_STEP_RAD)))
    turns = [begin + wall.arc_rad * k / count for k in range(count + 1)]
    return [(cx + radius * math.cos(t), cy + radius * math.sin(t)) for t in turns]


def _overlap_m(wall: Wall, end: Xy, others: Iterable[tuple[Wall, list[Xy]]]) -> float:
    """How far a wall reaches beyond this end of its axis, to close the corner with another."""
    reach = 0.0
    for other, points in others:
        near = min(_to_segment(end, a, b) for a, b in itertools.pairwise(points))
        if near <= other.thickness_m / 2 + _TOUCH_M:
            reach = max(reach, min(wall.thickness_m, other.thickness_m) / 2)
    return reach


def _to_segment(p: Xy, a: Xy, b: Xy) -> float:
    ab, ap = np.subtract(b, a), np.subtract(p, a)
    share = float(np.clip(ap @ ab / max(float(ab @ ab), 1e-12), 0.0, 1.0))
    return float(np.hypot(*(ap - share * ab)))


def cut(blocks: Iterable[WallBlock], doors: Sequence[Opening]) -> list[WallBlock]:
    """Blocks without the openings of these doors; the wall above each remains."""
    out = []
    for block in blocks:
        spans = [(*span, door) for door in doors if (span := crossing(block, door)) is not None]
        half = block.length_m / 2
        marks = sorted({-half, half, *(u for lo, hi, _ in spans for u in (lo, hi))})
        for lo, hi in itertools.pairwise(marks):
            over = [door for a, b, door in spans if a < (lo + hi) / 2 < b]
            bottom = max((d.z_m + d.height_m for d in over), default=block.z0_m)
            if hi - lo > 1e-4 and bottom < block.z1_m - 0.01:
                out.append(block.along(lo, hi, bottom, block.z1_m))
    return out


def crossing(block: WallBlock, opening: Opening) -> tuple[float, float] | None:
    """Span along a block, from its middle, that an opening takes; None if it is not in it."""
    cos, sin = math.cos(block.yaw_rad), math.sin(block.yaw_rad)
    turned = math.cos(opening.yaw_rad - block.yaw_rad)
    if abs(turned) < _PARALLEL_COS:
        return None
    dx, dy = opening.x - block.x, opening.y - block.y
    along, across = cos * dx + sin * dy, cos * dy - sin * dx
    if abs(across) > (block.thickness_m + opening.depth_m) / 2 + _SLACK_M:
        return None
    half = block.length_m / 2
    lo, hi = max(along - opening.width_m / 2, -half), min(along + opening.width_m / 2, half)
    return (lo, hi) if hi - lo > _LEAST_CUT_M or (hi > lo and half < _LEAST_CUT_M) else None


def wall_of(opening: Opening, blocks: Iterable[WallBlock]) -> tuple[float, float, float] | None:
    """(x, y, thickness) of the wall around an opening, at its middle; None outside any wall.

    Two walls side by side count as one.
    """
    cos, sin = math.cos(opening.yaw_rad), math.sin(opening.yaw_rad)
    low, high = math.inf, -math.inf
    for block in blocks:
        if crossing(block, opening) is None:
            continue
        across = cos * (block.y - opening.y) - sin * (block.x - opening.x)
        turn = opening.yaw_rad - block.yaw_rad
        if abs(math.sin(turn)) > 0.02:  # an oblique block: its axis where the opening is
            c, s = math.cos(block.yaw_rad), math.sin(block.yaw_rad)
            across = s * (opening.x - block.x) - c * (opening.y - block.y)
            across *= 1 if math.cos(turn) > 0 else -1  # the wall may run the other way
        low, high = (
            min(low, across - block.thickness_m / 2),
            max(high, across + block.thickness_m / 2),
        )
    if low > high:
        return None
    middle = (low + high) / 2
    return opening.x - sin * middle, opening.y + cos * middle, high - low
