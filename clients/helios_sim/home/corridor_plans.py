"""Floor plan of a large home: a straight corridor between two rows of rooms.

One row is deep (living room, dining room, kitchen, office), the other shallow (bedrooms, bathrooms,
laundry room). Optional rooms join the row with less width. Living room, dining room and kitchen are
neighbours, and so are a bedroom and a bathroom. Each room opens onto the corridor, except that the
bathroom next to the bedroom may open into it alone.
"""

from dataclasses import dataclass

import numpy as np
from helios_core.errors import Internal

from helios_sim.home import floor_plans
from helios_sim.home.floor_plans import Rect
from helios_sim.home.home_types import Doorway, Room
from helios_sim.home.presets import HomePreset

CORRIDOR = "corridor"
# Kind -> smallest and largest area in m², between the wall axes.
AREAS_M2: dict[str, tuple[float, float]] = {
    "living room": (28.0, 45.0),
    "kitchen": (12.0, 22.0),
    "dining room": (14.0, 24.0),
    "office": (11.0, 18.0),
    "bedroom": (12.0, 20.0),
    "child's room": (11.0, 18.0),
    "guest room": (11.0, 18.0),
    "bathroom": (6.5, 10.0),
    "laundry room": (6.5, 10.0),
    "storage room": (6.0, 10.0),
    "hallway": (7.0, 13.0),
}
_DEEP_M, _SHALLOW_M = (4.7, 5.8), (3.5, 4.2)  # depths of the two rows
_DAY = ("living room", "dining room", "kitchen")  # neighbours in this order
_SUITE = ("bedroom", "bathroom")
_DEEP = (_DAY, ("office",))
_SHALLOW = (_SUITE, ("bedroom",), ("bathroom",), ("laundry room",))
_OPTIONAL = ("child's room", "guest room", "storage room", "hallway", "bedroom", "bathroom")
_SMALL = ("bathroom", "storage room")  # too narrow in the deep row
_ALWAYS = 1 + sum(len(block) for block in (*_DEEP, *_SHALLOW))  # with the corridor
_MOST_ELONGATED = 1.9  # largest depth of a room, as a multiple of its width
_TRIES = 1000
_SUITE_CLOSED = 0.5  # probability that the bathroom of `_SUITE` has no door to the corridor
_TURNED = 0.25  # probability of a corridor along y

Block = tuple[str, ...]  # kinds of rooms that are neighbours, in this order


@dataclass(frozen=True)
class _Row:
    """Row of rooms: their kinds from low to high x, their widths in metres, the row's depth."""

    kinds: tuple[str, ...]
    widths_m: tuple[float, ...]
    depth_m: float

    @property
    def width_m(self) -> float:
        return sum(self.widths_m)

    def stretched(self, width_m: float) -> "_Row":
        """The row at that width, with ends of the rooms at whole centimetres."""
        ends = np.round(np.cumsum(self.widths_m) * width_m / self.width_m, 2)
        widths = np.diff(ends, prepend=0.0)
        return _Row(self.kinds, tuple(float(w) for w in widths), self.depth_m)

    def is_plausible(self, min_width_m: float) -> bool:
        """True if each room has an area of its kind and none, except hallways, is too narrow."""
        return all(
            width >= min_width_m
            and (kind == "hallway" or width * _MOST_ELONGATED >= self.depth_m)
            and AREAS_M2[kind][0] <= width * self.depth_m <= AREAS_M2[kind][1]
            for kind, width in zip(self.kinds, self.widths_m, strict=True)
        )


def draw_plan(
    rng: np.random.Generator, preset: HomePreset
) -> tuple[tuple[Room, ...], tuple[Doorway, ...]] | None:
    """Random rooms, by decreasing area, and doorways; None if this draw gives no valid plan."""
    count = int(rng.integers(preset.rooms[0], preset.rooms[1] + 1))
    for _ in range(_TRIES):
        rows = _draw_rows(rng, count)
        corridor_m = round(float(rng.uniform(*preset.corridor_width_m)), 2)
        if _fits(rows, corridor_m, preset):
            rects = _rects(rng, rows, corridor_m)
            rects.sort(key=lambda r: (-(r[1][2] - r[1][0]) * (r[1][3] - r[1][1]), r[1]))
            rooms = tuple(Room(i, kind, *rect) for i, (kind, rect) in enumerate(rects))
            return rooms, _doorways(rng, rooms, preset)
    return None


def _draw_rows(rng: np.random.Generator, count: int) -> tuple[_Row, _Row]:
    """Deep and shallow row of equal width, for that number of rooms with the corridor."""
    depths = [round(float(rng.uniform(*depth)), 2) for depth in (_DEEP_M, _SHALLOW_M)]
    blocks: list[list[tuple[Block, list[float]]]] = [
        [(block, _widths(rng, block, depth)) for block in row]
        for row, depth in zip((_DEEP, _SHALLOW), depths, strict=True)
    ]
    for k in rng.permutation(len(_OPTIONAL))[: count - _ALWAYS]:
        kind = _OPTIONAL[int(k)]
        lengths = [sum(sum(widths) for _, widths in row) for row in blocks]
        row = 1 if kind in _SMALL or lengths[1] <= lengths[0] else 0
        blocks[row].append(((kind,), _widths(rng, (kind,), depths[row])))
    rows = [_joined(rng, row, depth) for row, depth in zip(blocks, depths, strict=True)]
    width = round((rows[0].width_m + rows[1].width_m) / 2, 2)
    return rows[0].stretched(width), rows[1].stretched(width)


def _widths(rng: np.random.Generator, block: Block, depth_m: float) -> list[float]:
    return [float(rng.uniform(*AREAS_M2[kind])) / depth_m for kind in block]


def _joined(
    rng: np.random.Generator, blocks: list[tuple[Block, list[float]]], depth_m: float
) -> _Row:
    """Row of the blocks in random order, each in its own or the reverse order."""
    kinds: list[str] = []
    widths: list[float] = []
    for k in rng.permutation(len(blocks)):
        names, own = blocks[int(k)]
        step = 1 if rng.random() < 0.5 else -1
        kinds += names[::step]
        widths += own[::step]
    return _Row(tuple(kinds), tuple(widths), depth_m)


def _fits(rows: tuple[_Row, _Row], corridor_m: float, preset: HomePreset) -> bool:
    """True if the sizes of the home and of all its rooms are within their limits."""
    width, depth = rows[0].width_m, rows[0].depth_m + corridor_m + rows[1].depth_m
    return (
        preset.width_m[0] <= width <= preset.width_m[1]
        and preset.depth_m[0] <= depth <= preset.depth_m[1]
        and preset.floor_area_m2[0] <= width * depth <= preset.floor_area_m2[1]
        and all(row.is_plausible(preset.min_room_side_m) for row in rows)
    )


def _rects(
    rng: np.random.Generator, rows: tuple[_Row, _Row], corridor_m: float
) -> list[tuple[str, Rect]]:
    """(kind, rectangle) of each room: a row, the corridor, the other row, along x or y."""
    south, north = rows if rng.random() < 0.5 else rows[::-1]
    corridor_y = (round(south.depth_m, 2), round(south.depth_m + corridor_m, 2))
    end_y = round(corridor_y[1] + north.depth_m, 2)
    width = round(south.width_m, 2)
    rects: list[tuple[str, Rect]] = [(CORRIDOR, (0.0, corridor_y[0], width, corridor_y[1]))]
    for row, (y0, y1) in ((south, (0.0, corridor_y[0])), (north, (corridor_y[1], end_y))):
        ends = [round(float(end), 2) for end in np.cumsum((0.0, *row.widths_m))]
        for kind, x0, x1 in zip(row.kinds, ends[:-1], ends[1:], strict=True):
            rects.append((kind, (x0, y0, x1, y1)))
    if rng.random() < _TURNED:
        return [(kind, (y0, x0, y1, x1)) for kind, (x0, y0, x1, y1) in rects]
    return rects


def _doorways(
    rng: np.random.Generator, rooms: tuple[Room, ...], preset: HomePreset
) -> tuple[Doorway, ...]:
    """A doorway from each room to the corridor or, for a closed suite, to its bedroom; then
    `extra_doorways` between living room, dining room and kitchen."""
    corridor = next(room for room in rooms if room.kind == CORRIDOR)
    pairs: list[tuple[Room, Room]] = []
    suite = _neighbours(rooms, _SUITE, preset) if rng.random() < _SUITE_CLOSED else []
    inner = suite[int(rng.integers(len(suite)))] if suite else None
    for room in rooms:
        if room.index == corridor.index:
            continue
        closed = inner is not None and room.index == inner[1].index
        pairs.append(inner if inner is not None and closed else (room, corridor))
    day = [pair for k in (0, 1) for pair in _neighbours(rooms, _DAY[k : k + 2], preset)]
    pairs += [day[int(k)] for k in rng.permutation(len(day))[: preset.extra_doorways]]
    return tuple(_doorway(rng, a, b, preset) for a, b in pairs)


def _doorway(rng: np.random.Generator, a: Room, b: Room, preset: HomePreset) -> Doorway:
    wall = floor_plans.shared_wall(a, b)
    if wall is None:
        raise Internal(f"{a.kind} {a.index} and {b.kind} {b.index} share no wall for a doorway")
    return floor_plans.draw_doorway(rng, wall, (a.index, b.index), preset)


def _neighbours(
    rooms: tuple[Room, ...], kinds: Block, preset: HomePreset
) -> list[tuple[Room, Room]]:
    """Pairs of rooms of two kinds with a wall long enough for a doorway between them."""
    found = []
    for a in (room for room in rooms if room.kind == kinds[0]):
        for b in (room for room in rooms if room.kind == kinds[1]):
            wall = floor_plans.shared_wall(a, b)
            if wall is not None and wall[3] - wall[2] >= floor_plans.doorway_wall_m(preset):
                found.append((a, b))
    return found
