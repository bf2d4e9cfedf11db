"""Furniture of each kind of room in the demo homes, in the order of placement."""

from collections.abc import Callable

from helios_sim.home import decoration_shapes, floor_plans, wall_placement
from helios_sim.home.furniture_placement import FurniturePlacer
from helios_sim.home.home_types import Fixture, Receptacle, Room
from helios_sim.home.wall_placement import EAST, NORTH, SOUTH, WEST, side_of, wall_pose, wall_range


def furnish_all(furnisher: FurniturePlacer) -> None:
    """Furnish each room by its kind."""
    for room in furnisher.rooms:
        _RECIPES[room.kind](furnisher, room)


def _living_room(f: FurniturePlacer, room: Room) -> None:
    sofa = f.receptacle("sofa", room, wall_placement.along_walls(f.rng))
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
            rug = decoration_shapes.rug(
                f.rng, f.palette, (table.size_m[0] + 0.9, table.size_m[1] + 0.7)
            )
            f.lay("rug", room, (table.x, table.y, table.yaw_rad), rug)
        f.receptacle("side table", room, wall_placement.beside(f.rng, sofa))
    f.receptacle("armchair", room, wall_placement.along_walls(f.rng))
    f.receptacle("bookcase", room, wall_placement.along_walls(f.rng))
    f.fixture("floor lamp", room, wall_placement.corners(f.rng))
    f.fixture("plant", room, wall_placement.corners(f.rng))


def _kitchen(f: FurniturePlacer, room: Room) -> None:
    counter = f.receptacle("kitchen counter", room, wall_placement.along_walls(f.rng))
    if counter is not None:
        if f.fixture("fridge", room, wall_placement.beside(f.rng, counter)) is None:
            f.fixture("fridge", room, wall_placement.along_walls(f.rng))
        cabinet = decoration_shapes.wall_cabinet(f.rng, f.palette, counter.size_m[0])
        mount(f, room, counter, "wall cabinet", cabinet, 1.5)
    _dining_set(f, room)
    f.receptacle("bench", room, wall_placement.along_walls(f.rng))
    f.fixture("plant", room, wall_placement.corners(f.rng))


def _bedroom(f: FurniturePlacer, room: Room) -> None:
    bed = f.receptacle("bed", room, wall_placement.along_walls(f.rng))
    if bed is not None:
        for _ in range(2):
            f.receptacle("nightstand", room, wall_placement.beside(f.rng, bed))
        rug = decoration_shapes.rug(f.rng, f.palette, (bed.size_m[0] + 0.9, 1.0))
        x, y, _ = next(wall_placement.in_front_of(f.rng, bed, (-0.7, -0.65))(rug, room))
        f.lay("rug", room, (x, y, bed.yaw_rad), rug)
    f.receptacle("dresser", room, wall_placement.along_walls(f.rng))
    f.fixture("wardrobe", room, wall_placement.along_walls(f.rng))
    f.receptacle(
        "armchair" if f.rng.random() < 0.5 else "bench", room, wall_placement.along_walls(f.rng)
    )
    f.fixture("plant", room, wall_placement.corners(f.rng))


def _office(f: FurniturePlacer, room: Room) -> None:
    desk = f.receptacle("desk", room, wall_placement.along_walls(f.rng))
    if desk is not None:
        f.fixture("chair", room, wall_placement.at_desk(f.rng, desk), beside=desk)
    f.receptacle("bookcase", room, wall_placement.along_walls(f.rng))
    f.receptacle("armchair", room, wall_placement.along_walls(f.rng))
    f.receptacle("side table", room, wall_placement.corners(f.rng))
    f.fixture("floor lamp", room, wall_placement.corners(f.rng))
    f.fixture("plant", room, wall_placement.corners(f.rng))


def _bathroom(f: FurniturePlacer, room: Room) -> None:
    stand = f.receptacle("washstand", room, wall_placement.along_walls(f.rng))
    if stand is not None:
        above(f, room, stand, "mirror", stand.size_m[2] + 0.35)
    f.fixture("bathtub", room, wall_placement.along_walls(f.rng))
    f.fixture("toilet", room, wall_placement.along_walls(f.rng))
    f.receptacle("bench", room, wall_placement.along_walls(f.rng))


def _dining_room(f: FurniturePlacer, room: Room) -> None:
    _dining_set(f, room)
    f.receptacle("dresser", room, wall_placement.along_walls(f.rng))
    f.receptacle("bench", room, wall_placement.along_walls(f.rng))
    f.receptacle("armchair", room, wall_placement.along_walls(f.rng))
    f.fixture("plant", room, wall_placement.corners(f.rng))
    f.fixture("floor lamp", room, wall_placement.corners(f.rng))


def _dining_set(f: FurniturePlacer, room: Room) -> None:
    table = f.receptacle("dining table", room, wall_placement.in_the_middle(f.rng))
    if table is None:
        return
    lo, hi = f.preset.chairs_per_table
    for _ in range(int(f.rng.integers(lo, hi + 1))):
        f.fixture("chair", room, wall_placement.tucked_under(f.rng, table), beside=table)


def above(f: FurniturePlacer, room: Room, item: Receptacle, class_name: str, z_m: float) -> None:
    """Hang a television or a mirror above a piece of furniture."""
    make = {"television": decoration_shapes.television, "mirror": decoration_shapes.mirror}[
        class_name
    ]
    mount(f, room, item, class_name, make(f.rng, f.palette), z_m)


def mount(
    f: FurniturePlacer,
    room: Room,
    item: Receptacle,
    class_name: str,
    shape: decoration_shapes.Shape,
    z_m: float,
) -> Fixture:
    """Hang a fixture on the wall behind a piece of furniture."""
    side = side_of(item.yaw_rad)
    along = item.y if side in (WEST, EAST) else item.x
    pose = wall_pose(room, side, along, shape.size_m[1] / 2 + 0.002)
    return f.hang(class_name, room, pose, shape, z_m=z_m)


def decorate(f: FurniturePlacer, room: Room) -> None:
    """Hang windows on outer walls and pictures on any wall, clear of tall furniture and doors."""
    used = [wall_use(f, room, side) for side in range(4)]
    outer = f.bounds
    wall = floor_plans.WALL_HALF_M
    windows = 0
    for side in (int(k) for k in f.rng.permutation(4)):
        at = {WEST: room.x0, EAST: room.x1, SOUTH: room.y0, NORTH: room.y1}[side]
        edge = {
            WEST: outer[0] + wall,
            EAST: outer[2] - wall,
            SOUTH: outer[1] + wall,
            NORTH: outer[3] - wall,
        }[side]
        is_outer = abs(at - edge) < 1e-9
        if is_outer and windows < 2:
            shape = decoration_shapes.window(f.rng, f.palette)
            along = free_stretch(f, room, side, shape.size_m[0], used[side])
            if along is not None:
                f.hang("window", room, wall_pose(room, side, along, 0.0), shape, z_m=0.95)
                windows += 1
                used[side].append((along - shape.size_m[0] / 2, along + shape.size_m[0] / 2))
        shape = decoration_shapes.picture(f.rng, f.palette)
        along = free_stretch(f, room, side, shape.size_m[0] + 0.2, used[side])
        if along is not None and f.rng.random() < 0.8:
            pose = wall_pose(room, side, along, shape.size_m[1] / 2)
            f.hang("picture", room, pose, shape, z_m=1.65 - shape.size_m[2] / 2)


def wall_use(f: FurniturePlacer, room: Room, side: int) -> list[tuple[float, float]]:
    """Intervals along a wall that are occupied by doorways and tall furniture."""
    at = {WEST: room.x0, EAST: room.x1, SOUTH: room.y0, NORTH: room.y1}[side]
    axis = 0 if side in (WEST, EAST) else 1
    lo, hi = wall_range(room, side)
    used = [(a - 0.1, b + 0.1) for a, b in floor_plans.openings(f.doorways, axis, at, lo, hi)]
    for item in (*f.receptacles, *f.fixtures):
        if item.room != room.index or item.class_name == "rug":
            continue
        top = item.size_m[2] + (item.z_m if isinstance(item, Fixture) else 0.0)
        x, y, _ = wall_pose(room, side, item.y if axis == 0 else item.x, 0.0)
        off = abs(item.x - x) if axis == 0 else abs(item.y - y)
        if top > 1.15 and off < 0.75:
            along = item.y if axis == 0 else item.x
            half = max(item.size_m[0], item.size_m[1]) / 2 + 0.05
            used.append((along - half, along + half))
    return used


def free_stretch(
    f: FurniturePlacer, room: Room, side: int, width: float, used: list[tuple[float, float]]
) -> float | None:
    """Random centre of a free interval of that width along a wall; None if none is found."""
    lo, hi = wall_range(room, side)
    if hi - lo < width + 0.3:
        return None
    for _ in range(12):
        along = float(f.rng.uniform(lo + width / 2 + 0.12, hi - width / 2 - 0.12))
        if all(along + width / 2 < a or along - width / 2 > b for a, b in used):
            return along
    return None


_RECIPES: dict[str, Callable[[FurniturePlacer, Room], None]] = {
    "living room": _living_room,
    "kitchen": _kitchen,
    "bedroom": _bedroom,
    "office": _office,
    "bathroom": _bathroom,
    "dining room": _dining_room,
}
