"""Floor plan: a rectangle divided into rooms by binary space partitioning, joined by doorways."""

import math
from dataclasses import dataclass

import numpy as np

from helios_sim.home.home_types import Doorway, Room
from helios_sim.home.presets import HomePreset

WALL_HALF_M = 0.06
WALL_HEIGHT_M = 2.6
DOOR_HEIGHT_M = 2.1
_DOOR_TO_CORNER_M = 0.3

# Number of rooms -> room kinds by decreasing area; of five or more, the smallest is a bathroom.
_KINDS = {
    4: ("living room", "kitchen", "bedroom", "office"),
    5: ("living room", "kitchen", "bedroom", "office", "bathroom"),
    6: ("living room", "kitchen", "bedroom", "dining room", "office", "bathroom"),
    7: ("living room", "kitchen", "bedroom", "dining room", "bedroom", "office", "bathroom"),
    8: (
        "living room",
        "kitchen",
        "bedroom",
        "dining room",
        "bedroom",
        "office",
        "office",
        "bathroom",
    ),
}

# Room kinds for the "ovmm" catalog; one of the alternatives separated by a bar is drawn.
_OVMM_KINDS = {
    4: "living room, kitchen, bedroom, bathroom",
    5: "living room, kitchen, bedroom, office|dining room|hallway, bathroom",
    6: "living room, kitchen, bedroom, dining room|office, hallway|laundry room, bathroom",
    7: "living room, kitchen, bedroom, bedroom, dining room|office, laundry room|hallway, bathroom",
    8: "living room, bedroom, dining room, kitchen, bedroom, office, laundry room|hallway"
    ", bathroom",
}

Rect = tuple[float, float, float, float]  # x0, y0, x1, y1 in m
Wall = tuple[int, float, float, float]  # axis, position, start and end in m; see WallPiece


@dataclass(frozen=True)
class WallPiece:
    """Piece of wall; `axis` 0: at x = `at_m`, y from `lo_m` to `hi_m`; 1: x and y swapped."""

    axis: int
    at_m: float
    lo_m: float
    hi_m: float
    z0_m: float
    z1_m: float

    @property
    def center_xy(self) -> tuple[float, float]:
        middle = (self.lo_m + self.hi_m) / 2
        return (self.at_m, middle) if self.axis == 0 else (middle, self.at_m)

    @property
    def half_extent_xy(self) -> tuple[float, float]:
        half = (self.hi_m - self.lo_m) / 2
        return (WALL_HALF_M, half) if self.axis == 0 else (half, WALL_HALF_M)


def draw_plan(
    rng: np.random.Generator, preset: HomePreset
) -> tuple[tuple[Room, ...], tuple[Doorway, ...]] | None:
    """Random rooms and doorways; None if this draw gives no valid floor plan."""
    count = int(rng.integers(preset.rooms[0], preset.rooms[1] + 1))
    width, depth = _size(rng, preset, count)
    rects = _partition(rng, (0.0, 0.0, width, depth), count, preset)
    if rects is None:
        return None
    rects.sort(key=lambda r: (-(r[2] - r[0]) * (r[3] - r[1]), r))
    kinds = _kinds(rng, preset, count)
    rooms = tuple(
        Room(i, kind, *rect) for i, (kind, rect) in enumerate(zip(kinds, rects, strict=True))
    )
    doorways = _doorways(rng, rooms, preset)
    return None if doorways is None else (rooms, doorways)


def _size(rng: np.random.Generator, preset: HomePreset, count: int) -> tuple[float, float]:
    """Random width and depth of the home in metres."""
    if preset.room_area_m2 == (0.0, 0.0):
        width = round(float(rng.uniform(*preset.width_m)), 2)
        return width, round(float(rng.uniform(*preset.depth_m)), 2)
    area = count * float(rng.uniform(*preset.room_area_m2))
    width = math.sqrt(area * float(rng.uniform(1.05, 1.55)))
    return (
        round(float(np.clip(width, *preset.width_m)), 2),
        round(float(np.clip(area / width, *preset.depth_m)), 2),
    )


def _kinds(rng: np.random.Generator, preset: HomePreset, count: int) -> list[str]:
    """Random room kinds by decreasing area."""
    if preset.catalog == "ovmm":
        alternatives = [names.split("|") for names in _OVMM_KINDS[count].split(", ")]
        return [names[int(rng.integers(len(names)))] for names in alternatives]
    kinds = list(_KINDS[count])
    if count == 4:
        kinds[3] = str(rng.choice(["office", "dining room", "bathroom"]))
    return kinds


def _partition(
    rng: np.random.Generator, rect: Rect, count: int, preset: HomePreset
) -> list[Rect] | None:
    min_side = preset.min_room_side_m
    rects = [rect]
    while len(rects) < count:
        rects.sort(key=lambda r: (-(r[2] - r[0]) * (r[3] - r[1]), r))
        x0, y0, x1, y1 = rects.pop(0)
        across_x = (x1 - x0) > (y1 - y0)
        lo, hi = (x0, x1) if across_x else (y0, y1)
        if hi - lo < 2 * min_side:
            return None
        cut = lo + float(rng.uniform(*preset.cut)) * (hi - lo)
        cut = round(float(np.clip(cut, lo + min_side, hi - min_side)), 2)
        if across_x:
            rects += [(x0, y0, cut, y1), (cut, y0, x1, y1)]
        else:
            rects += [(x0, y0, x1, cut), (x0, cut, x1, y1)]
    return rects


def shared_wall(a: Room, b: Room) -> Wall | None:
    """(axis, at, lo, hi) of the wall between two rooms; None if they share none."""
    for axis, (a0, a1, b0, b1), (c0, c1, d0, d1) in (
        (0, (a.x0, a.x1, b.x0, b.x1), (a.y0, a.y1, b.y0, b.y1)),
        (1, (a.y0, a.y1, b.y0, b.y1), (a.x0, a.x1, b.x0, b.x1)),
    ):
        lo, hi = max(c0, d0), min(c1, d1)
        if hi <= lo:
            continue
        if abs(a1 - b0) < 1e-9:
            return axis, a1, lo, hi
        if abs(a0 - b1) < 1e-9:
            return axis, a0, lo, hi
    return None


def _doorways(
    rng: np.random.Generator, rooms: tuple[Room, ...], preset: HomePreset
) -> tuple[Doorway, ...] | None:
    walls = []
    for i, a in enumerate(rooms):
        for b in rooms[i + 1 :]:
            wall = shared_wall(a, b)
            if wall is not None and wall[3] - wall[2] >= doorway_wall_m(preset):
                walls.append((a.index, b.index, wall))
    group = list(range(len(rooms)))
    doors: list[Doorway] = []
    extra = preset.extra_doorways
    for k in rng.permutation(len(walls)):
        i, j, wall = walls[int(k)]
        if group[i] != group[j]:
            old, new = group[j], group[i]
            group = [new if g == old else g for g in group]
        elif extra > 0:
            extra -= 1
        else:
            continue
        doors.append(draw_doorway(rng, wall, (i, j), preset))
    return tuple(doors) if len(set(group)) == 1 else None


def doorway_wall_m(preset: HomePreset) -> float:
    """Shortest wall, in metres, that has space for any doorway of the preset."""
    return preset.doorway_width_m[1] + 2 * (_DOOR_TO_CORNER_M + WALL_HALF_M)


def draw_doorway(
    rng: np.random.Generator, wall: Wall, rooms: tuple[int, int], preset: HomePreset
) -> Doorway:
    """Doorway of random width at a random position in the wall between two rooms."""
    axis, at, lo, hi = wall
    width = round(float(rng.uniform(*preset.doorway_width_m)), 2)
    inset = width / 2 + _DOOR_TO_CORNER_M + WALL_HALF_M
    along = round(float(rng.uniform(lo + inset, hi - inset)), 2)
    x, y = (at, along) if axis == 0 else (along, at)
    return Doorway(x, y, width, axis, rooms)


def bounds_of(rooms: tuple[Room, ...]) -> Rect:
    """Rectangle of the outer faces of the outer walls."""
    return (
        min(r.x0 for r in rooms) - WALL_HALF_M,
        min(r.y0 for r in rooms) - WALL_HALF_M,
        max(r.x1 for r in rooms) + WALL_HALF_M,
        max(r.y1 for r in rooms) + WALL_HALF_M,
    )


def wall_pieces(rooms: tuple[Room, ...], doorways: tuple[Doorway, ...]) -> list[WallPiece]:
    """All pieces of wall: beside the doorways, and a lintel above each doorway."""
    pieces = []
    for axis, at, lo, hi in _wall_runs(rooms):
        cursor, end = lo - WALL_HALF_M, hi + WALL_HALF_M
        for door0, door1 in openings(doorways, axis, at, lo, hi):
            pieces.append(WallPiece(axis, at, cursor, door0, 0.0, WALL_HEIGHT_M))
            pieces.append(WallPiece(axis, at, door0, door1, DOOR_HEIGHT_M, WALL_HEIGHT_M))
            cursor = door1
        pieces.append(WallPiece(axis, at, cursor, end, 0.0, WALL_HEIGHT_M))
    return pieces


def openings(
    doorways: tuple[Doorway, ...], axis: int, at: float, lo: float, hi: float
) -> list[tuple[float, float]]:
    """Intervals of the doorways along the wall line (axis, at), in order."""
    found = []
    for door in doorways:
        across, along = (door.x, door.y) if door.axis == 0 else (door.y, door.x)
        if door.axis == axis and abs(across - at) < 1e-9 and lo < along < hi:
            found.append((along - door.width_m / 2, along + door.width_m / 2))
    return sorted(found)


def _wall_runs(rooms: tuple[Room, ...]) -> list[tuple[int, float, float, float]]:
    """Wall lines (axis, at, lo, hi); overlapping lines of neighbouring rooms are merged."""
    sides = []
    for room in rooms:
        sides += [(0, room.x0, room.y0, room.y1), (0, room.x1, room.y0, room.y1)]
        sides += [(1, room.y0, room.x0, room.x1), (1, room.y1, room.x0, room.x1)]
    sides.sort()
    runs: list[tuple[int, float, float, float]] = []
    for axis, at, lo, hi in sides:
        if runs and runs[-1][0] == axis and abs(runs[-1][1] - at) < 1e-9 and lo <= runs[-1][3]:
            runs[-1] = (axis, at, runs[-1][2], max(hi, runs[-1][3]))
        else:
            runs.append((axis, at, lo, hi))
    return runs
