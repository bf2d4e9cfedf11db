"""Draws a home: plan, furniture, things, settling, and the checks that make it solvable."""

import math
import zlib
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
from helios_core.errors import Internal, InvalidInput

from helios_sim.home import freespace, plan, recipes
from helios_sim.home.clutter import Clutter
from helios_sim.home.freespace import CELL_M
from helios_sim.home.furnish import Furnisher
from helios_sim.home.home import Home
from helios_sim.home.palette import Palette, draw_palette, tinted
from helios_sim.home.presets import HomePreset
from helios_sim.home.types import Rgb, Room, RoomStyle, SceneObject

_ATTEMPTS = 60
_SETTLE_S = 2.0
_MAX_DRIFT_M = 0.04
_MAX_TILT_COS = math.cos(math.radians(2))
_VIEW_CELLS = 24

_FLOORS: dict[str, str] = {"kitchen": "tiles", "bathroom": "tiles", "bedroom": "carpet"}
_FLOOR_COLORS: dict[str, tuple[Rgb, ...]] = {
    "planks": ((0.72, 0.53, 0.35), (0.58, 0.41, 0.27), (0.80, 0.66, 0.48)),
    "tiles": ((0.82, 0.81, 0.78), (0.68, 0.71, 0.73), (0.78, 0.71, 0.63)),
    "carpet": ((0.66, 0.62, 0.56), (0.52, 0.57, 0.63), (0.68, 0.57, 0.52)),
}


def generate_home(seed: int, preset: HomePreset) -> Home:
    """The home of a seed. The same seed and preset give the same home in every process.

    Draws until a home meets the preset's counts, everything stands firm, and every object and
    receptacle can be seen and reached. InvalidInput for a negative seed; Internal if no draw
    will do.
    """
    if seed < 0:
        raise InvalidInput(f"seed {seed} came; a seed of 0 or more is wanted")
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([zlib.crc32(preset.name.encode()), seed, attempt])
        home = _draw(rng, seed, preset)
        if home is not None:
            return home
    raise Internal(
        f"no home for seed {seed} of preset {preset.name!r} in {_ATTEMPTS} draws; "
        "take another seed, or loosen the preset's counts"
    )


def _draw(rng: np.random.Generator, seed: int, preset: HomePreset) -> Home | None:
    floor_plan = plan.draw_plan(rng, preset)
    if floor_plan is None:
        return None
    rooms, doorways = floor_plan
    palette = draw_palette(rng)
    furnisher = Furnisher(rooms, doorways, preset, palette, rng)
    for room in rooms:
        recipes.furnish(furnisher, room)
    classes = {item.class_name for item in furnisher.receptacles}
    lo, hi = preset.receptacles
    if not lo <= len(furnisher.receptacles) <= hi or len(classes) < preset.min_receptacle_classes:
        return None
    for room in rooms:
        recipes.decorate(furnisher, room)
    clutter = Clutter(furnisher)
    clutter.fill()
    start = _start_pose(furnisher)
    if start is None:
        return None
    home = Home(
        seed=seed,
        preset=preset,
        rooms=rooms,
        doorways=doorways,
        receptacles=tuple(furnisher.receptacles),
        objects=tuple(clutter.objects),
        fixtures=tuple(furnisher.fixtures),
        start_pose=start,
        bounds=furnisher.bounds,
        styles=tuple(_style(rng, room, palette) for room in rooms),
    )
    home = _settle(home, furnisher)
    object_classes = {thing.class_name for thing in home.objects}
    enough = len(home.objects) >= preset.objects[0]
    return home if enough and len(object_classes) >= preset.min_object_classes else None


def _style(rng: np.random.Generator, room: Room, palette: Palette) -> RoomStyle:
    pattern = _FLOORS.get(room.kind, "planks")
    colors = _FLOOR_COLORS[pattern]
    return RoomStyle(
        palette.wall(rng), pattern, tinted(colors[int(rng.integers(len(colors)))], rng, 0.03)
    )


def _start_pose(furnisher: Furnisher) -> tuple[float, float, float] | None:
    """A pose with room to turn, looking along the longest free line of eight."""
    roomy = furnisher.passable() & (furnisher.clearance > furnisher.preset.robot_radius_m + 0.25)
    rows, columns = np.nonzero(roomy)
    if len(rows) == 0:
        return None
    k = int(furnisher.rng.integers(len(rows)))
    x_of, y_of = freespace.cell_centers(furnisher.bounds, CELL_M)
    x, y = float(x_of[columns[k]]), float(y_of[rows[k]])
    yaws = [turn * math.pi / 4 for turn in range(-3, 5)]
    return x, y, max(yaws, key=lambda yaw: _free_line_m(furnisher, x, y, yaw))


def _free_line_m(furnisher: Furnisher, x: float, y: float, yaw: float) -> float:
    length = 0.0
    while length < 12.0:
        px, py = x + length * math.cos(yaw), y + length * math.sin(yaw)
        if furnisher.clearance[freespace.cell_of(px, py, furnisher.bounds, CELL_M)] < CELL_M:
            break
        length += CELL_M
    return length


def _settle(home: Home, furnisher: Furnisher) -> Home:
    """Lets everything come to rest; keeps what stays upright in its place and can be seen."""
    model = home.spec(visuals=False).compile()
    data = mujoco.MjData(model)
    for _ in range(round(_SETTLE_S / model.opt.timestep)):
        mujoco.mj_step(model, data)
    passable = furnisher.passable()
    kept = []
    for thing in home.objects:
        body = data.body(thing.name)
        drift = float(np.linalg.norm(body.xpos - thing.position_m))
        up = float(body.xmat[8])
        yaw = math.atan2(float(body.xmat[3]), float(body.xmat[0]))
        # A ball has no upright.
        upright = up > _MAX_TILT_COS or (len(thing.shape.solids) == 1 and thing.shape.rolls)
        if drift > _MAX_DRIFT_M or not upright:
            continue
        x, y, z = (float(value) for value in body.xpos)
        rested = replace(thing, position_m=(x, y, z), yaw_rad=yaw)
        if _can_be_seen(rested, home, furnisher, passable, model, data):
            kept.append(rested)
    return replace(home, objects=_renumbered(kept))


def _can_be_seen(
    thing: SceneObject,
    home: Home,
    furnisher: Furnisher,
    passable: np.ndarray,
    model: mujoco.MjModel,
    data: mujoco.MjData,
) -> bool:
    """Whether a robot within reach has the object's middle or top in its line of sight."""
    receptacle = home.receptacle(thing.receptacle)
    near = passable & freespace.room_mask(home.rooms[receptacle.room], home.bounds, CELL_M)
    x_of, y_of = freespace.cell_centers(home.bounds, CELL_M)
    rows, columns = np.nonzero(near)
    away = np.hypot(x_of[columns] - thing.position_m[0], y_of[rows] - thing.position_m[1])
    in_reach = np.nonzero(away <= home.preset.reach_m - 0.05)[0]
    step = max(1, len(in_reach) // _VIEW_CELLS)
    for k in in_reach[::step]:
        eye = np.array([x_of[columns[k]], y_of[rows[k]], home.preset.camera_height_m])
        for lift in (0.0, 0.4):
            target = np.array(thing.position_m)
            target[2] += lift * thing.size_m[2]
            if _first_body(model, data, eye, target) == thing.name:
                return True
    return False


def _first_body(
    model: mujoco.MjModel, data: mujoco.MjData, eye: np.ndarray, target: np.ndarray
) -> str:
    """Name of the first body that a ray from the eye through the target meets."""
    geom = np.array([-1], dtype=np.int32)
    mujoco.mj_ray(model, data, eye, target - eye, None, 1, -1, geom)
    return model.body(model.geom_bodyid[geom[0]]).name if geom[0] >= 0 else ""


def _renumbered(things: Sequence[SceneObject]) -> tuple[SceneObject, ...]:
    """Names without gaps: mug_0, mug_1, …"""
    counts: dict[str, int] = {}
    named = []
    for thing in things:
        number = counts.get(thing.class_name, 0)
        counts[thing.class_name] = number + 1
        named.append(replace(thing, name=f"{thing.class_name.replace(' ', '_')}_{number}"))
    return tuple(named)
