"""Furniture of each kind of room in the benchmark homes, in the order of placement."""

from collections.abc import Callable

import numpy as np

from helios_sim.home import decoration_shapes, doors, floor_plans, room_fixtures, wall_placement
from helios_sim.home.furniture_placement import FurniturePlacer
from helios_sim.home.home_types import Receptacle, Room, Shape
from helios_sim.home.room_recipes import above, free_stretch, mount, wall_use
from helios_sim.home.wall_placement import wall_pose

_MAIN_TRIES = 6  # shapes drawn for one main item of a room


def furnish_all(f: FurniturePlacer) -> None:
    """Place door leaves, the required furniture of each room, then optional furniture and decor."""
    for door in f.doorways:
        if f.rng.random() < 0.8:
            _leaf(f, door)
    for room in f.rooms:
        _RECIPES[room.kind](f, room)
    _furnish_more(f)
    for room in f.rooms:
        for _ in range(int(f.rng.integers(0, 3))):
            f.fixture("plant", room, wall_placement.corners(f.rng))
        shape = room_fixtures.ceiling_lamp(f.rng, f.palette)
        pose = (*room.center_xy, 0.0)
        f.hang("ceiling lamp", room, pose, shape, z_m=floor_plans.WALL_HEIGHT_M - shape.size_m[2])


def _furnish_more(f: FurniturePlacer) -> None:
    """Place more receptacles, preferably of classes that are new in the home."""
    lo, hi = f.preset.receptacles
    wanted = min(hi, max(lo, round(3.2 * len(f.rooms) + float(f.rng.uniform(4.5, 8.5)))))
    choices = [(room, name) for room in f.rooms for name in _MORE[room.kind]]
    draws = f.rng.random(len(choices))
    there = {item.class_name for item in f.receptacles}
    late = [0.6 * (name.partition("@")[0] in there) for _, name in choices]
    for k in np.argsort(draws + late):
        if len(f.receptacles) >= wanted:
            return
        room, name = choices[int(k)]
        class_name, _, anchor = name.partition("@")
        own = [item for item in f.receptacles if item.room == room.index]
        if any(item.class_name == class_name for item in own) and not anchor:
            continue
        host = next((item for item in own if item.class_name == anchor), None)
        poses = wall_placement.beside(f.rng, host) if host else wall_placement.along_walls(f.rng)
        f.receptacle(class_name, room, poses)


def _leaf(f: FurniturePlacer, door: floor_plans.Doorway) -> None:
    shape = doors.door_leaf(f.rng, f.palette, door.width_m)
    for room, pose in doors.open_poses(f.rng, door, f.rooms, shape.size_m[0]):
        if f.stands_open(shape, room, pose):
            f.hang("door", room, pose, shape, blocks=True)
            return


def hang_more(f: FurniturePlacer, room: Room) -> None:
    """Hang the wall fixtures of the room's kind, clear of windows and pictures."""
    for class_name, z_m in _HANGS.get(room.kind, ()):
        shape = f.catalog.fixtures[class_name](f.rng, f.palette)
        for side in (int(k) for k in f.rng.permutation(4)):
            used = wall_use(f, room, side)
            along = free_stretch(f, room, side, shape.size_m[0] + 0.1, used)
            if along is not None:
                pose = wall_pose(room, side, along, shape.size_m[1] / 2 + 0.002)
                f.hang(class_name, room, pose, shape, z_m=z_m)
                break


def _main_item(f: FurniturePlacer, room: Room, class_name: str) -> Receptacle | None:
    """Place the main item of a room along a wall; None if it has no space. A home with a corridor
    tries several shapes."""
    for _ in range(_MAIN_TRIES if f.preset.layout == "corridor" else 1):
        item = f.receptacle(class_name, room, wall_placement.along_walls(f.rng))
        if item is not None:
            return item
    return None


def _living_room(f: FurniturePlacer, room: Room) -> None:
    sofa = _main_item(f, room, "sofa")
    if sofa is not None:
        table = f.receptacle(
            "coffee table", room, wall_placement.in_front_of(f.rng, sofa, (0.84, 0.95))
        )
        stand = f.receptacle("TV stand", room, wall_placement.opposite(f.rng, sofa))
        if stand is None:
            stand = f.receptacle("TV stand", room, wall_placement.along_walls(f.rng))
        if stand is not None:
            above(f, room, stand, "television", stand.size_m[2] + 0.3)
        if table is not None:
            _rug(f, room, table, (table.size_m[0] + 0.9, table.size_m[1] + 0.7))
    f.receptacle("armchair", room, wall_placement.along_walls(f.rng))
    f.fixture("floor lamp", room, wall_placement.corners(f.rng))


def _kitchen(f: FurniturePlacer, room: Room) -> None:
    counter = _main_item(f, room, "kitchen counter")
    if counter is not None:
        for name in ("cooker", "fridge"):
            if f.fixture(name, room, wall_placement.beside(f.rng, counter)) is None:
                f.fixture(name, room, wall_placement.along_walls(f.rng))
        cabinet = decoration_shapes.wall_cabinet(f.rng, f.palette, counter.size_m[0])
        mount(f, room, counter, "wall cabinet", cabinet, 1.5)
    if not any(other.kind == "dining room" for other in f.rooms):
        _dining_set(f, room)
    else:
        f.receptacle("serving cart", room, wall_placement.along_walls(f.rng))
        f.receptacle("stool", room, wall_placement.along_walls(f.rng))


def _bedroom(f: FurniturePlacer, room: Room) -> None:
    bed = _main_item(f, room, "bed")
    if bed is not None:
        f.receptacle("nightstand", room, wall_placement.beside(f.rng, bed))
        rug = decoration_shapes.rug(f.rng, f.palette, (bed.size_m[0] + 0.9, 1.0))
        x, y, _ = next(wall_placement.in_front_of(f.rng, bed, (-0.7, -0.65))(rug, room))
        f.lay("rug", room, (x, y, bed.yaw_rad), rug)
    names = ("wardrobe", "dresser")
    first = not any(item.class_name in names for item in f.receptacles)
    for name in names if first else names[int(f.rng.integers(2)) :][:1]:
        f.receptacle(name, room, wall_placement.along_walls(f.rng))


def _office(f: FurniturePlacer, room: Room) -> None:
    desk = _main_item(f, room, "desk")
    if desk is not None:
        f.receptacle(
            "chair", room, wall_placement.pulled_out(f.rng, desk, front_only=True), beside=desk
        )
        _rug(f, room, desk, (desk.size_m[0] + 0.5, desk.size_m[1] + 1.2))
    f.receptacle("filing cabinet", room, wall_placement.along_walls(f.rng))
    f.fixture("floor lamp", room, wall_placement.corners(f.rng))


def _bathroom(f: FurniturePlacer, room: Room) -> None:
    stand = _main_item(f, room, "washstand")
    if stand is not None:
        above(f, room, stand, "mirror", stand.size_m[2] + 0.35)
        mat = decoration_shapes.rug(f.rng, f.palette, (0.8, 0.5))
        x, y, yaw = next(wall_placement.in_front_of(f.rng, stand, (0.1, 0.15))(mat, room))
        f.lay("rug", room, (x, y, yaw), mat)
    _main_item(f, room, "bathtub")
    _main_item(f, room, "toilet")
    has_laundry_room = any(other.kind == "laundry room" for other in f.rooms)
    if f.preset.layout == "partition" or not has_laundry_room:
        _laundry(f, room)


def _laundry_room(f: FurniturePlacer, room: Room) -> None:
    _laundry(f, room)


def _laundry(f: FurniturePlacer, room: Room) -> None:
    """Place a washing machine and a hamper, once per home."""
    there = {item.class_name for item in f.receptacles}
    if "washing machine" not in there:
        _main_item(f, room, "washing machine")
    if "hamper" not in there:
        f.receptacle("hamper", room, wall_placement.along_walls(f.rng))


def _hallway(f: FurniturePlacer, room: Room) -> None:
    f.receptacle("shoe rack", room, wall_placement.along_walls(f.rng))
    long = room.x1 - room.x0 > room.y1 - room.y0
    runner = decoration_shapes.rug(f.rng, f.palette, (float(f.rng.uniform(1.4, 2.0)), 0.7))
    f.lay("rug", room, (*room.center_xy, 0.0 if long else np.pi / 2), runner)


def _corridor(f: FurniturePlacer, room: Room) -> None:
    """Place a shoe rack, and runners with gaps of about 2 m along the middle."""
    f.receptacle("shoe rack", room, wall_placement.along_walls(f.rng))
    along_x = room.x1 - room.x0 > room.y1 - room.y0
    length_m = max(room.x1 - room.x0, room.y1 - room.y0)
    count = max(1, int(length_m // 5.0))
    runner = decoration_shapes.rug(f.rng, f.palette, (float(f.rng.uniform(2.4, 3.2)), 0.75))
    cx, cy = room.center_xy
    for k in range(count):
        shift = ((k + 0.5) / count - 0.5) * length_m
        x, y, yaw = (cx + shift, cy, 0.0) if along_x else (cx, cy + shift, np.pi / 2)
        f.lay("rug", room, (x, y, yaw), runner)


def _childs_room(f: FurniturePlacer, room: Room) -> None:
    bed = _main_item(f, room, "bed")
    if bed is not None:
        f.receptacle("nightstand", room, wall_placement.beside(f.rng, bed))
    desk = _main_item(f, room, "desk")
    if desk is not None:
        f.receptacle(
            "chair", room, wall_placement.pulled_out(f.rng, desk, front_only=True), beside=desk
        )
    f.receptacle("trunk", room, wall_placement.along_walls(f.rng))
    rug = decoration_shapes.rug(f.rng, f.palette, (1.6, 1.1))
    f.lay("rug", room, (*room.center_xy, 0.0), rug)


def _guest_room(f: FurniturePlacer, room: Room) -> None:
    _bedroom(f, room)
    f.receptacle("armchair", room, wall_placement.along_walls(f.rng))


def _storage_room(f: FurniturePlacer, room: Room) -> None:
    for name in ("shelf", "shelf", "trunk"):
        f.receptacle(name, room, wall_placement.along_walls(f.rng))


def _dining_room(f: FurniturePlacer, room: Room) -> None:
    _dining_set(f, room)
    f.receptacle("sideboard", room, wall_placement.along_walls(f.rng))


def _dining_set(f: FurniturePlacer, room: Room) -> None:
    table = f.receptacle("dining table", room, wall_placement.in_the_middle(f.rng))
    if table is None:
        return
    if f.rng.random() < 0.6:
        _rug(f, room, table, (table.size_m[0] + 1.1, table.size_m[1] + 1.0))
    lo, hi = f.preset.chairs_per_table
    for _ in range(int(f.rng.integers(lo, hi + 1))):
        f.receptacle("chair", room, wall_placement.pulled_out(f.rng, table), beside=table)


def _rug(f: FurniturePlacer, room: Room, item: Receptacle, size_m: tuple[float, float]) -> None:
    rug: Shape = decoration_shapes.rug(f.rng, f.palette, size_m)
    f.lay("rug", room, (item.x, item.y, item.yaw_rad), rug)


_RECIPES: dict[str, Callable[[FurniturePlacer, Room], None]] = {
    "living room": _living_room,
    "kitchen": _kitchen,
    "bedroom": _bedroom,
    "office": _office,
    "bathroom": _bathroom,
    "laundry room": _laundry_room,
    "hallway": _hallway,
    "dining room": _dining_room,
    "corridor": _corridor,
    "child's room": _childs_room,
    "guest room": _guest_room,
    "storage room": _storage_room,
}

# Optional receptacles by room kind; "a@b": beside b if the room has one, otherwise along a wall.
_MORE: dict[str, tuple[str, ...]] = {
    "living room": ("side table@sofa", "bookcase", "sideboard", "shelf", "trunk", "stool"),
    "kitchen": ("serving cart", "stool", "bench", "shelf", "shoe rack"),
    "bedroom": ("nightstand@bed", "trunk", "bench", "armchair", "stool", "desk", "shelf"),
    "office": ("shelf", "bookcase", "armchair", "side table", "stool"),
    "bathroom": ("stool", "shelf", "hamper"),
    "laundry room": ("shelf", "stool", "bench", "shoe rack"),
    "hallway": ("bench", "trunk", "wardrobe", "stool", "side table"),
    "dining room": ("serving cart", "bench", "armchair", "shelf", "bookcase"),
    "corridor": ("bench", "side table", "stool", "shelf"),
    "child's room": ("shelf", "bookcase", "stool", "dresser", "bench"),
    "guest room": ("nightstand@bed", "bench", "stool", "shelf", "desk"),
    "storage room": ("shoe rack", "hamper", "stool", "wardrobe"),
}

# Wall fixtures by room kind: (class, height of the frame origin in metres).
_HANGS: dict[str, tuple[tuple[str, float], ...]] = {
    "living room": (("wall clock", 1.75),),
    "kitchen": (("wall clock", 1.75),),
    "bathroom": (("towel rail", 0.75),),
    "laundry room": (("towel rail", 0.75),),
    "hallway": (("coat rack", 0.85),),
    "corridor": (("coat rack", 0.85), ("wall clock", 1.75)),
    "child's room": (("wall clock", 1.75),),
}
