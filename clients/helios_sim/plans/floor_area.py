"""Floor of a plan: its rooms, what is outdoors, and the walls that close what has none."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_sim.home.freespace import Obstacle
from helios_sim.home.home_types import Outline
from helios_sim.plans.plan_types import DrawnRoom, Xy
from helios_sim.plans.wall_blocks import WallBlock

CELL_M = 0.025
_GAP_M = 0.125  # gaps between walls up to twice this are closed when rooms are sought
_LEAST_ROOM_M2 = 1.5
_ENCLOSED_SHARE, _LINED_SHARE = 0.5, 0.6
_BESIDE_M = 0.3
_SIMPLER_M = 0.04
_STEP_M = 0.05
_LEAST_GAP_M = 0.15
_CLOSING_THICK_M = 0.06
_OUTSIDE_CELL_M = 0.1

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Grid:
    """Cells [row, column] of `CELL_M`; cell (0, 0) has its corner at `origin_m`."""

    origin_m: Xy
    shape: tuple[int, int]

    @classmethod
    def around(cls, points: NDArray[np.float64], margin_m: float) -> Grid:
        """Grid around points [n, 2] with a margin on each side."""
        low, high = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
        columns, rows = np.ceil((high - low) / CELL_M).astype(int)
        return cls((float(low[0]), float(low[1])), (int(rows), int(columns)))

    def pixels(self, points: Iterable[Xy]) -> NDArray[np.int32]:
        """Points as [n, 2] cells (column, row) with 4 binary digits, for `cv2.fillPoly`."""
        cells = (np.array(list(points)) - self.origin_m) / CELL_M - 0.5
        return np.round(np.clip(cells, -1e5, 1e5) * 16).astype(np.int32)

    def filled(self, outlines: Iterable[Iterable[Xy]]) -> Mask:
        image = np.zeros(self.shape, np.uint8)
        for outline in outlines:
            cv2.fillPoly(image, [self.pixels(outline)], 1, shift=4)
        return image.astype(bool)

    def at(self, x: float, y: float) -> tuple[int, int]:
        """(row, column) of a point, clipped to the grid."""
        column, row = ((np.array([x, y]) - self.origin_m) / CELL_M).astype(int)
        return (
            int(np.clip(row, 0, self.shape[0] - 1)),
            int(np.clip(column, 0, self.shape[1] - 1)),
        )


@dataclass(frozen=True, eq=False)
class FloorArea:
    """Indoor floor of a plan. `closing`: walls that stand where the plan leaves a room open."""

    grid: Grid
    rooms: tuple[DrawnRoom, ...]
    outdoors: tuple[DrawnRoom, ...]
    indoor: Mask  # rooms and everything that walls enclose, with the walls themselves
    floor: Mask  # rooms and enclosed areas without the walls
    closing: tuple[WallBlock, ...]

    def is_floor(self, x: float, y: float) -> bool:
        return bool(self.floor[self.grid.at(x, y)])


def floor_area(rooms: Sequence[DrawnRoom], blocks: Sequence[WallBlock]) -> FloorArea:
    """Floor of drawn rooms and of areas that walls enclose.

    blocks: walls without openings. A room that walls neither enclose nor line is outdoors, unless
    no room is enclosed. No room comes back where nothing is closed.
    """
    corners = [p for room in rooms for p in room.outline]
    corners += [p for block in blocks for p in corners_of(block.footprint)]
    grid = Grid.around(np.array(corners or [(0.0, 0.0)]), 0.5)
    walls = grid.filled(corners_of(block.footprint) for block in blocks)
    enclosed = _enclosed(walls)
    inside, outdoors = _sorted_rooms(rooms, grid, walls, enclosed)
    drawn = grid.filled(room.outline for room in inside)
    found = _further_rooms(enclosed & ~drawn & ~walls, grid)
    kept = (*inside, *found)
    floor = (drawn | grid.filled(room.outline for room in found)) & ~walls
    if not kept:
        return FloorArea(grid, (), tuple(outdoors), floor, floor, ())
    doorsteps = enclosed & ~_touching_only(outdoors, grid)
    indoor = floor | walls | doorsteps
    closing = tuple(
        block for room in inside for block in _closing_blocks(room.outline, grid, indoor)
    )
    return FloorArea(grid, kept, tuple(outdoors), indoor, (floor | doorsteps) & ~walls, closing)


def _touching_only(outdoors: Sequence[DrawnRoom], grid: Grid) -> Mask:
    return grid.filled(room.outline for room in outdoors)


def _enclosed(walls: Mask) -> Mask:
    """Cells that no path from the edge of the grid reaches, through gaps up to 2 `_GAP_M`."""
    size = 2 * round(_GAP_M / CELL_M) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    thick = cv2.dilate(walls.astype(np.uint8), kernel)
    image = np.pad(thick, 1)
    cv2.floodFill(image, None, (0, 0), 2)
    held = (image[1:-1, 1:-1] == 0).astype(np.uint8)
    grown = cv2.dilate(held, kernel).astype(bool)
    return grown & ~walls


def _sorted_rooms(
    rooms: Sequence[DrawnRoom], grid: Grid, walls: Mask, enclosed: Mask
) -> tuple[list[DrawnRoom], list[DrawnRoom]]:
    """(indoors, outdoors)."""
    size = 2 * round(_BESIDE_M / CELL_M) + 1
    beside = cv2.dilate(walls.astype(np.uint8), np.ones((size, size), np.uint8)).astype(bool)
    inside: list[DrawnRoom] = []
    outdoors: list[DrawnRoom] = []
    for room in rooms:
        cells = grid.filled([room.outline])
        free = cells & ~walls
        share = float(enclosed[free].mean()) if free.any() else 1.0
        edge = np.array([grid.at(x, y) for x, y in _along(room.outline)])
        lined = float(beside[edge[:, 0], edge[:, 1]].mean())
        good = share >= _ENCLOSED_SHARE or lined >= _LINED_SHARE
        (inside if good else outdoors).append(room)
    return (inside, outdoors) if inside or enclosed.any() else (outdoors, [])


def _further_rooms(free: Mask, grid: Grid) -> list[DrawnRoom]:
    """Enclosed areas without a drawn room, as rooms without a name."""
    core = cv2.erode(free.astype(np.uint8), np.ones((5, 5), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(core, connectivity=4)
    found = []
    for k in range(1, count):
        if stats[k, cv2.CC_STAT_AREA] * CELL_M**2 < _LEAST_ROOM_M2:
            continue
        cells = cv2.dilate((labels == k).astype(np.uint8), np.ones((5, 5), np.uint8))
        contours, _ = cv2.findContours(cells, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        outer = max(contours, key=cv2.contourArea)
        simple = cv2.approxPolyDP(outer, _SIMPLER_M / CELL_M, True)[:, 0]
        if len(simple) >= 3:
            points = (simple + 0.5) * CELL_M + np.array(grid.origin_m)
            found.append(DrawnRoom("", tuple((float(x), float(y)) for x, y in points)))
    return found


def _along(outline: Outline) -> list[Xy]:
    """Points along an outline, at most `_STEP_M` apart."""
    points: list[Xy] = []
    for a, b in zip(outline, (*outline[1:], outline[0]), strict=True):
        count = max(1, math.ceil(math.dist(a, b) / _STEP_M))
        points += [
            (a[0] + (b[0] - a[0]) * k / count, a[1] + (b[1] - a[1]) * k / count)
            for k in range(count)
        ]
    return points


def _closing_blocks(outline: Outline, grid: Grid, indoor: Mask) -> list[WallBlock]:
    """Thin walls along the parts of an outline beyond which nothing is indoors."""
    x, y = np.array(outline).T
    turn = np.sign(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) or 1.0
    blocks = []
    for a, b in zip(outline, (*outline[1:], outline[0]), strict=True):
        length = math.dist(a, b)
        if length < 1e-6:
            continue
        ux, uy = (b[0] - a[0]) / length, (b[1] - a[1]) / length
        away = 2.5 * CELL_M
        ox, oy = turn * uy * away, -turn * ux * away  # outwards
        count = max(1, math.ceil(length / _STEP_M))
        middles = (np.arange(count) + 0.5) * length / count
        bare = [not indoor[grid.at(a[0] + ux * s + ox, a[1] + uy * s + oy)] for s in middles]
        for lo, hi in _runs(bare):
            start, end = lo * length / count, hi * length / count
            if end - start >= _LEAST_GAP_M:
                middle = (start + end) / 2
                blocks.append(
                    WallBlock(
                        a[0] + ux * middle,
                        a[1] + uy * middle,
                        math.atan2(uy, ux),
                        end - start + _CLOSING_THICK_M,
                        _CLOSING_THICK_M,
                        0.0,
                        2.5,
                    )
                )
    return blocks


def _runs(flags: Sequence[bool]) -> list[tuple[int, int]]:
    """Half-open index ranges of consecutive true flags."""
    edges = np.flatnonzero(np.diff(np.array([False, *flags, False]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def outside_obstacles(area: FloorArea, bounds: tuple[float, float, float, float]) -> list[Obstacle]:
    """Rectangles that cover what is not indoors within the bounds (x0, y0, x1, y1)."""
    columns = math.ceil((bounds[2] - bounds[0]) / _OUTSIDE_CELL_M)
    rows = math.ceil((bounds[3] - bounds[1]) / _OUTSIDE_CELL_M)
    outside = np.ones((rows, columns), bool)
    for du in (0.1, 0.5, 0.9):
        for dv in (0.1, 0.5, 0.9):
            x = bounds[0] + (np.arange(columns) + du) * _OUTSIDE_CELL_M
            y = bounds[1] + (np.arange(rows) + dv) * _OUTSIDE_CELL_M
            c = ((x - area.grid.origin_m[0]) / CELL_M).astype(int)
            r = ((y - area.grid.origin_m[1]) / CELL_M).astype(int)
            held = (c >= 0) & (c < area.grid.shape[1]), (r >= 0) & (r < area.grid.shape[0])
            cells = area.indoor[
                np.clip(r, 0, area.grid.shape[0] - 1)[:, None],
                np.clip(c, 0, area.grid.shape[1] - 1)[None, :],
            ]
            outside &= ~(cells & held[1][:, None] & held[0][None, :])
    return [
        Obstacle(
            bounds[0] + (c0 + c1) / 2 * _OUTSIDE_CELL_M,
            bounds[1] + (r0 + r1) / 2 * _OUTSIDE_CELL_M,
            (c1 - c0) / 2 * _OUTSIDE_CELL_M,
            (r1 - r0) / 2 * _OUTSIDE_CELL_M,
            0.0,
        )
        for r0, c0, r1, c1 in _rectangles(outside)
    ]


def _rectangles(mask: Mask) -> list[tuple[int, int, int, int]]:
    """Disjoint rectangles (row0, column0, row1, column1) that cover the mask, row by row."""
    open_runs: dict[tuple[int, int], int] = {}
    found: list[tuple[int, int, int, int]] = []
    for row in range(len(mask) + 1):
        runs = set(_runs(mask[row].tolist())) if row < len(mask) else set()
        for run in [run for run in open_runs if run not in runs]:
            found.append((open_runs.pop(run), run[0], row, run[1]))
        for run in runs:
            open_runs.setdefault(run, row)
    return found


def corners_of(rect: Obstacle) -> list[Xy]:
    """Corners of a rectangle, counter-clockwise."""
    cos, sin = math.cos(rect.yaw_rad), math.sin(rect.yaw_rad)
    return [
        (rect.x + cos * u - sin * v, rect.y + sin * u + cos * v)
        for u, v in (
            (rect.half_x, rect.half_y),
            (-rect.half_x, rect.half_y),
            (-rect.half_x, -rect.half_y),
            (rect.half_x, -rect.half_y),
        )
    ]
