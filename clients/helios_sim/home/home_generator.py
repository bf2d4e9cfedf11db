"""Home generation: floor plan, furniture, objects, physics, and checks that tasks are solvable."""

import math
import zlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from helios_core.errors import Internal, InvalidInput

from helios_sim.home import (
    corridor_plans,
    floor_plans,
    freespace,
    physics_settling,
    room_recipes,
    room_recipes_ovmm,
)
from helios_sim.home.catalog import FurnitureModels
from helios_sim.home.color_palette import Palette, draw_palette, tinted
from helios_sim.home.distractor_placement import DistractorPlacer
from helios_sim.home.freespace import CELL_M
from helios_sim.home.furnished_floor import FurnishedFloor
from helios_sim.home.furniture_placement import FurniturePlacer
from helios_sim.home.generated_home import Home
from helios_sim.home.home_types import Rgb, Room, RoomStyle, SceneObject
from helios_sim.home.object_placement import ObjectPlacer
from helios_sim.home.presets import HomePreset

_ATTEMPTS = 60
_ROUNDS = 12
HIDDEN_SHARE = 0.3  # a hidden object is invisible from at least this share of the stands around it

_FLOORS: dict[str, str] = {"kitchen": "tiles", "bathroom": "tiles", "bedroom": "carpet"}
_FLOORS |= {"laundry room": "tiles", "hallway": "tiles"}
_FLOORS |= {"child's room": "carpet", "guest room": "carpet", "storage room": "tiles"}
_FLOOR_COLORS: dict[str, tuple[Rgb, ...]] = {
    "planks": ((0.72, 0.53, 0.35), (0.58, 0.41, 0.27), (0.80, 0.66, 0.48)),
    "tiles": ((0.82, 0.81, 0.78), (0.68, 0.71, 0.73), (0.78, 0.71, 0.63)),
    "carpet": ((0.66, 0.62, 0.56), (0.52, 0.57, 0.63), (0.68, 0.57, 0.52)),
}


def generate_home(
    seed: int, preset: HomePreset, furniture_models: FurnitureModels | None = None
) -> Home:
    """Home of a seed. The same seed and preset give the same home in every process.

    Furniture models change the furniture, and the preset's name to "ovmm-v1+…".

    Homes are drawn until one meets the preset's counts, all objects are at rest, and every object
    and receptacle is visible and within reach. Raises InvalidInput for a negative seed, Internal
    if no draw is valid.
    """
    if seed < 0:
        raise InvalidInput(f"seed {seed} came; a seed of 0 or more is wanted")
    if furniture_models is not None:
        preset = replace(preset, name=f"{preset.name}+{furniture_models.name}")
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([zlib.crc32(preset.name.encode()), seed, attempt])
        home = _draw(rng, seed, preset, furniture_models)
        if home is not None:
            return home
    raise Internal(
        f"no home for seed {seed} of preset {preset.name!r} in {_ATTEMPTS} draws; "
        "take another seed, or loosen the preset's counts"
    )


def _draw(
    rng: np.random.Generator,
    seed: int,
    preset: HomePreset,
    furniture_models: FurnitureModels | None,
) -> Home | None:
    layout = corridor_plans if preset.layout == "corridor" else floor_plans
    floor_plan = layout.draw_plan(rng, preset)
    if floor_plan is None:
        return None
    rooms, doorways = floor_plan
    palette = draw_palette(rng)
    furnisher = FurniturePlacer(rooms, doorways, preset, palette, rng)
    if furniture_models is not None:
        furnisher.catalog = furniture_models.applied_to(furnisher.catalog)
    (room_recipes_ovmm if preset.catalog == "ovmm" else room_recipes).furnish_all(furnisher)
    same_as = furnisher.catalog.ovmm_class
    classes = {same_as.get(item.class_name, item.class_name) for item in furnisher.receptacles}
    lo, hi = preset.receptacles
    if not lo <= len(furnisher.receptacles) <= hi or len(classes) < preset.min_receptacle_classes:
        return None
    for room in rooms:
        room_recipes.decorate(furnisher, room)
        if preset.catalog == "ovmm":
            room_recipes_ovmm.hang_more(furnisher, room)
    if preset.catalog == "ovmm":
        return _scattered(furnisher, seed)
    clutter = ObjectPlacer(furnisher)
    clutter.fill()
    home = _home(furnisher, seed, clutter.objects)
    if home is None:
        return None
    home = replace(
        home,
        objects=physics_settling.renumbered(physics_settling.settled(home, furnisher.passable())),
    )
    object_classes = {thing.class_name for thing in home.objects}
    enough = len(home.objects) >= preset.objects[0]
    return home if enough and len(object_classes) >= preset.min_object_classes else None


def _scattered(furnisher: FurniturePlacer, seed: int) -> Home | None:
    """Home whose objects are placed, settled and, where they fell, placed again.

    The furniture therefore does not depend on the physics. Exception: if `_ROUNDS` rounds do not
    place all objects, the result is None and the home is drawn again.
    """
    lo, hi = furnisher.preset.objects
    count = int(furnisher.rng.integers(lo, hi + 1))
    empty = _home(furnisher, seed, ())
    return None if empty is None else scattered(furnisher, empty, count)


def scattered(furnisher: FurnishedFloor, empty: Home, count: int) -> Home | None:
    """The home `empty` with `count` objects at rest; None if `_ROUNDS` rounds do not place them.

    `furnisher.preset` sets the number of classes and of hidden objects.
    """
    preset = furnisher.preset
    scatter = DistractorPlacer(furnisher)
    passable = furnisher.passable()
    for _ in range(_ROUNDS):
        scatter.top_up(count)
        home = replace(empty, objects=tuple(scatter.objects))
        scatter.keep(physics_settling.settled(home, passable))
        classes = {thing.class_name for thing in scatter.objects}
        if len(scatter.objects) < count or len(classes) < preset.min_object_classes:
            continue
        home = replace(empty, objects=tuple(scatter.objects))
        hidden = physics_settling.hidden_shares(home, passable) >= HIDDEN_SHARE
        if int(hidden.sum()) >= preset.hidden_objects:
            return replace(home, objects=physics_settling.renumbered(home.objects))
        scatter.hide_more(hidden)
    return None


def _home(furnisher: FurniturePlacer, seed: int, objects: Sequence[SceneObject]) -> Home | None:
    """Home of the placed furniture and these objects; None if there is no start pose."""
    start = start_pose(furnisher)
    if start is None:
        return None
    return Home(
        seed=seed,
        preset=furnisher.preset,
        rooms=furnisher.rooms,
        doorways=furnisher.doorways,
        receptacles=tuple(furnisher.receptacles),
        objects=tuple(objects),
        fixtures=tuple(furnisher.fixtures),
        start_pose=start,
        bounds=furnisher.bounds,
        styles=tuple(
            floor_style(furnisher.rng, room, furnisher.palette) for room in furnisher.rooms
        ),
    )


def floor_style(rng: np.random.Generator, room: Room, palette: Palette) -> RoomStyle:
    """Wall colour and floor of a room, drawn from the palette."""
    pattern = _FLOORS.get(room.kind, "planks")
    colors = _FLOOR_COLORS[pattern]
    return RoomStyle(
        palette.wall(rng), pattern, tinted(colors[int(rng.integers(len(colors)))], rng, 0.03)
    )


def start_pose(furnisher: FurnishedFloor) -> tuple[float, float, float] | None:
    """Random pose with space to turn, facing along the longest of eight free lines."""
    roomy = furnisher.passable() & (furnisher.clearance > furnisher.preset.robot_radius_m + 0.25)
    rows, columns = np.nonzero(roomy)
    if len(rows) == 0:
        return None
    k = int(furnisher.rng.integers(len(rows)))
    x_of, y_of = freespace.cell_centers(furnisher.bounds, CELL_M)
    x, y = float(x_of[columns[k]]), float(y_of[rows[k]])
    yaws = [turn * math.pi / 4 for turn in range(-3, 5)]
    return x, y, max(yaws, key=lambda yaw: _free_line_m(furnisher, x, y, yaw))


def _free_line_m(furnisher: FurnishedFloor, x: float, y: float, yaw: float) -> float:
    length = 0.0
    while length < 12.0:
        px, py = x + length * math.cos(yaw), y + length * math.sin(yaw)
        if furnisher.clearance[freespace.cell_of(px, py, furnisher.bounds, CELL_M)] < CELL_M:
            break
        length += CELL_M
    return length
